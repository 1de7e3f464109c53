"""Similarity of two objects, seconds or days apart and in different light: size, and colors from bottom to top."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.geometry.box import Box
from cuboid.method.objects.entry import MapObject

# Number of layers, over the height of an object, whose colors are compared.
LAYERS = 3
# Standard deviations of one object between two visits: of the logarithm of a side, of lightness (the light may
# change), and of a and b (CIE L*a*b*).
SIZE_SIGMA, LIGHT_SIGMA, COLOR_SIGMA = 0.2, 20.0, 7.0

# Smallest similarity, 0..1, of a moved object to its earlier state, and the smallest ratio to any other similarity.
MIN_SIMILARITY, MIN_SIMILARITY_RATIO = 0.2, 1.5

ColorProfile = npt.NDArray[np.float64]


def similarity(profile: ColorProfile, box: Box, other_profile: ColorProfile, other_box: Box) -> float:
    """Return the similarity of two objects, 0..1, in size and in colors from bottom to top."""
    sides = np.log(_sides(box) / _sides(other_box)) / SIZE_SIGMA
    off = (profile - other_profile) / np.array([LIGHT_SIGMA, COLOR_SIGMA, COLOR_SIGMA])
    return float(np.exp(-0.5 * ((sides**2).mean() + (off**2).mean())))


def most_similar(scores: Sequence[float]) -> int | None:
    """Return the index of the object with the highest similarity; None if it is too low or not clearly the highest."""
    if not scores:
        return None
    best = int(np.argmax(scores))
    others = max((score for k, score in enumerate(scores) if k != best), default=0.0)
    return best if scores[best] >= MIN_SIMILARITY and scores[best] >= MIN_SIMILARITY_RATIO * others else None


def color_profile_of(entry: MapObject) -> ColorProfile:
    """Return the colors (LAYERS, 3) of an object from bottom to top, as L*, a*, b*."""
    lab = _lab(entry.colors)
    height = (entry.points.astype(np.float64) - entry.box.center) @ entry.box.rotation[:, 2]
    height_fraction = height / max(float(entry.box.size[2]), 1e-6) + 0.5
    layer = np.clip((height_fraction * LAYERS).astype(int), 0, LAYERS - 1)
    whole = lab.mean(0) if len(lab) else np.zeros(3)
    return np.array([lab[layer == k].mean(0) if (layer == k).any() else whole for k in range(LAYERS)])


def _lab(rgb: UInt8Array) -> Float64Array:
    lab: Float64Array = np.zeros((len(rgb), 3))
    if len(rgb):
        lab[:] = cv2.cvtColor(np.ascontiguousarray(rgb[None], np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)[0]
    return lab


def _sides(box: Box) -> Float64Array:
    """Return the sides of a box: the longer and the shorter side of its footprint, and its height."""
    return np.asarray(np.maximum([box.size[:2].max(), box.size[:2].min(), box.size[2]], 0.005), np.float64)
