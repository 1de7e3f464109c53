"""Correction of boxes that are too large because they enclose the depth noise of faces."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.tolerances import JUMP_SIGMAS, MIN_SIGMA_M
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.kernels.extents import side_layers

# A side moves by at most this fraction of the size of the box.
MAX_MOVE_FRACTION = 0.2


def to_faces(box: Box, points: Float64Array, trust: Float64Array, noise_m: float, top_alone: bool) -> Box:
    """Return a box whose sides lie in the middle of the seen faces, not at the outer end of their noise.

    A flat face is a dense layer of points beneath its side, with few points below that layer. The side moves to the
    middle of the layer, by less the more points lie below. At a side that was not seen, the density is even and the
    side stays.

    Parameters
    ----------
    box : Box
    points : (N, 3) float64
        World, metres.
    trust : (N,) float64
    noise_m : float
        Standard deviation of the points of a face, metres.
    top_alone : bool
        Move only the top: the sides are known more exactly.
    """
    layers = np.empty((5, 3))
    half = box.size / 2.0
    band = JUMP_SIGMAS * max(noise_m, MIN_SIGMA_M)
    side_layers(points, trust, box.center, np.ascontiguousarray(box.rotation), half, band, layers)
    outer, depth, inner = layers.T
    weight = np.maximum(outer, 1e-12)
    moved = depth / weight * np.maximum(0.0, 1.0 - inner / weight)
    if top_alone:
        moved[:4] = 0.0
    moved = np.minimum(moved, MAX_MOVE_FRACTION * box.size[[0, 0, 1, 1, 2]])
    high = half - moved[[0, 2, 4]]
    low = half - np.array([moved[1], moved[3], 0.0])
    size, center = high + low, box.center + box.rotation @ ((high - low) / 2.0)
    return lengthwise(Box(center, size, box.rotation))


def lengthwise(box: Box) -> Box:
    """Return the same box with its longer level side first."""
    if box.size[0] >= box.size[1]:
        return box
    # A rotation by 90 degrees keeps the axes right-handed.
    turned = np.column_stack([box.rotation[:, 1], -box.rotation[:, 0], box.rotation[:, 2]])
    return Box(box.center, box.size[[1, 0, 2]], turned)
