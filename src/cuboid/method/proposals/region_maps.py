"""A reduced picture as the loops over its regions need it, and the graph of its regions."""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.depth import DepthImage, shrunk
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.proposals.depth import WIDEST
from cuboid.method.proposals.edges import inverse_without_holes
from cuboid.method.proposals.kernels import hierarchy, leaves, sums

# Smoothing of color, and of depth over space (pixels) and depth (metres), before differences are taken.
COLOR_SIGMA_PX, DEPTH_WINDOW_PX, DEPTH_SIGMA_M, DEPTH_SIGMA_PX = 0.6, 5, 0.03, 2.0
# Readings are at least this far, metres.
NEAREST_READING_M = 0.15
# Places of the table of borders for each region: a planar graph has fewer than three borders a region.
PLACES_PER_REGION = 16

Int32Array = npt.NDArray[np.int32]


class Maps(NamedTuple):
    """A reduced picture, as the loops over it need it.

    Attributes
    ----------
    lab : (h, w, 3) float32
        CIE Lab, smoothed.
    depth_m : (h, w) float32
        Metres, smoothed, without holes.
    read : (h, w) bool
        Whether a pixel has a reading.
    normals : (h, w, 3) float32
    gradient : (h, w) float32
        Of the color, units of CIE Lab per pixel.
    bend : (h, w) float32
        Change of the normal, 0..1.
    """

    lab: Float32Array
    depth_m: Float32Array
    read: npt.NDArray[np.bool_]
    normals: Float32Array
    gradient: Float32Array
    bend: Float32Array


class ReducedFrame:
    """A frame as its regions are found in it and judged; its parts are computed when they are first used.

    Parameters
    ----------
    frame : Frame
    intrinsics : Intrinsics
        Of the frame.
    """

    def __init__(self, frame: Frame, intrinsics: Intrinsics) -> None:
        self.frame, self.intrinsics = frame, intrinsics

    @cached_property
    def _shrunk(self) -> tuple[DepthImage, int]:
        return shrunk(self.frame, self.intrinsics, WIDEST)

    @property
    def step(self) -> int:
        """Pixels of the frame for each pixel of the reduced picture, in both directions."""
        return self._shrunk[1]

    @property
    def shape(self) -> tuple[int, ...]:
        """Height and width of the reduced picture."""
        return self._shrunk[0].depth_m.shape

    @property
    def pinhole(self) -> Float64Array:
        """(4,) fx, fy, cx, cy of the reduced picture, pixels."""
        return np.array(self._shrunk[0].camera.pinhole)

    @cached_property
    def maps(self) -> Maps:
        """The maps of the reduced picture."""
        return maps_of(self.frame.color, *self._shrunk)


def maps_of(color: UInt8Array, depth: DepthImage, step: int) -> Maps:
    """Return the maps of a picture: its color (H, W, 3), and its depth, which is reduced by a step."""
    height, width = depth.depth_m.shape
    color = np.ascontiguousarray(color[: height * step, : width * step])
    small = cv2.resize(color, (width, height), interpolation=cv2.INTER_AREA) if step > 1 else color
    sharp = cv2.cvtColor(small.astype(np.float32) / np.float32(255.0), cv2.COLOR_RGB2LAB)
    lab: Float32Array = np.asarray(cv2.GaussianBlur(sharp, (0, 0), COLOR_SIGMA_PX), dtype=np.float32)
    inverse = inverse_without_holes(depth.depth_m)
    near = np.where(inverse > 0.0, 1.0 / np.maximum(inverse, 1e-3), 1.0).astype(np.float32)
    np.maximum(near, np.float32(NEAREST_READING_M), out=near)
    smooth: Float32Array = np.asarray(
        cv2.bilateralFilter(near, DEPTH_WINDOW_PX, DEPTH_SIGMA_M, DEPTH_SIGMA_PX), dtype=np.float32
    )
    rough = np.empty((height, width, 3), np.float32)
    leaves.surface_normals(smooth, *depth.camera.pinhole.tolist(), rough)
    normals: Float32Array = np.asarray(cv2.blur(rough, (3, 3)), dtype=np.float32)
    across, down = (cv2.Sobel(lab, cv2.CV_32F, *axes) / 4.0 for axes in ((1, 0), (0, 1)))
    gradient, bend = np.empty((height, width), np.float32), np.empty((height, width), np.float32)
    leaves.changes(across, down, normals, gradient, bend)
    return Maps(lab, smooth, depth.depth_m > 0, normals, gradient, bend)


def graph_of(labels: Int32Array, count: int, maps: Maps, camera: Float64Array) -> hierarchy.Graph:
    """Return the graph of disjoint regions.

    Parameters
    ----------
    labels : (h, w) int32
        Region of each pixel, 0..count-1.
    count : int
    maps : Maps
    camera : (4,) float64
        fx, fy, cx, cy, pixels.
    """
    over, boxes = empty_sums(count, labels.shape)
    sums.leaf_sums(labels, maps, camera, over, boxes)
    places = 1 << math.ceil(math.log2(PLACES_PER_REGION * count + 2))
    keys, numbers, ends = np.empty(places, np.int64), np.empty(places, np.int32), np.empty((places, 2), np.int32)
    borders = sums.number_borders(labels, keys, numbers, ends)
    over_borders = np.zeros((borders, 2, sums.LINK_SUMS))
    sums.border_sums(labels, maps, camera, keys, numbers, over_borders)
    return hierarchy.Graph(over, boxes, ends[:borders].copy(), over_borders)


def empty_sums(count: int, shape: tuple[int, ...]) -> tuple[Float64Array, Int32Array]:
    """Return the sums (count, PIXEL_SUMS) and rectangles (count, 4) of regions without pixels, in a picture (h, w)."""
    empty = np.array([shape[1], shape[0], 0, 0], np.int32)
    return np.zeros((count, sums.PIXEL_SUMS)), np.tile(empty, (count, 1))
