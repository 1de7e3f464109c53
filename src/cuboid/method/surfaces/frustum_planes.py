"""The supporting planes in the camera's frustum, cropped to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.method.surfaces.grid import CELL_M, Places, window_intersection
from cuboid.method.surfaces.plane import Plane


@dataclass(frozen=True, slots=True)
class FrustumPlanes:
    """The K planes in view over the visible ground, as `assign_planes` needs them.

    Attributes
    ----------
    planes : list of Plane
    numbers : (K,) int32
        Indices among all planes, ascending.
    window : (4,) int64
        First cell of the ground, and the cell after the last.
    ground : (K, N, M) uint8
        Cells covered by planes in use, 1 or 0.
    seen : (K, N, M) int32
        Zeros: buffer for the readings of this frame.
    """

    planes: list[Plane]
    numbers: npt.NDArray[np.int32]
    window: Places
    ground: UInt8Array
    seen: npt.NDArray[np.int32]

    @property
    def identities(self) -> npt.NDArray[np.int64]:
        """Permanent numbers of the planes, (K,), ascending."""
        return np.array([plane.identity for plane in self.planes], dtype=np.int64)

    @property
    def origin(self) -> Float64Array:
        """Plan coordinates (2,) of the corner of the first cell, metres."""
        return np.asarray(self.window[:2] * CELL_M, dtype=np.float64)


def crop_planes(planes: list[Plane], window: Places) -> FrustumPlanes:
    """Crop the ground plan of each plane to a window (4,) of cells."""
    shape = (len(planes), *(window[2:] - window[:2]))
    ground = np.zeros(shape, np.uint8)
    for layer, plane in zip(ground, planes, strict=True):
        if plane.in_use:
            plane.plan.refresh_if_late()
            plan_part, layer_part = window_intersection(plane.plan.window, window)
            layer[layer_part] = plane.plan.covered[plan_part]
    numbers = np.array([plane.index for plane in planes], np.int32)
    return FrustumPlanes(planes, numbers, window, ground, np.zeros(shape, np.int32))


def frustum(camera: Intrinsics, depth_m: float) -> Float64Array:
    """Return the camera centre and the image corners at a depth (5, 3): the frustum of readings up to there."""
    u, v = np.array([0, camera.width - 1]) - camera.cx, np.array([0, camera.height - 1]) - camera.cy
    corners = [[x / camera.fx * depth_m, y / camera.fy * depth_m, depth_m] for x in u for y in v]
    return np.array([[0.0, 0.0, 0.0], *corners])
