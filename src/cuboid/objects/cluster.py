"""The points of an object as a rigid cluster that is followed from frame to frame, by shape and color."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cuboid.core.frame import Float32Array, Float64Array, UInt8Array
from cuboid.core.limits import SAMPLE_POINTS
from cuboid.core.tolerances import BIAS_M, DRIFT_M, MIN_READINGS
from cuboid.core.working import WorkingImage
from cuboid.poses.alignment import Points, Prior, Reference, align
from cuboid.poses.pyramid import LEVELS, Level, build_levels

# Points that tell the normal of the surface around one.
NEIGHBOURS = 12
# A point hides those that lie farther away in the same cell of this many pixels.
CELL_PX = 3
# From one frame to the next an object goes on as before, but for this, metres and radians.
UNSTEADY_M, UNSTEADY_RAD = 0.03, 0.15
# The search begins at this level of the picture, and ends at the finest.
COARSEST = 1
# It is found where this fraction of those of its points that nothing hides lie on what is seen, and ...
MIN_ON_SURFACE = 0.6
# ... this fraction of all that would be seen if nothing hid them do.
MIN_SEEN = 0.25


@dataclass(frozen=True, slots=True)
class Fit:
    """Where a cluster was found: T_now_start (4, 4) in the world, and how sure that is, 0..1."""

    T_now_start: Float64Array
    score: float


class Cluster:
    """The side of an object that a camera sees, as rigid points with normals and intensities.

    Parameters
    ----------
    points : (N, 3) float32
        World, metres.
    colors : (N, 3) uint8
    image : WorkingImage
    T_world_camera : (4, 4) float64
        Of a camera that sees it.
    """

    def __init__(
        self, points: Float32Array, colors: UInt8Array, image: WorkingImage, T_camera_world: Float64Array
    ) -> None:
        some = slice(None, None, 1 + len(points) // (4 * SAMPLE_POINTS))
        points, colors = points[some].astype(np.float64), colors[some]
        in_camera = points @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]
        ahead = _in_front(in_camera, image)
        normals = _normals(in_camera)[ahead] @ T_camera_world[:3, :3]
        intensity = colors[ahead].astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)
        one = Points(
            points[ahead].astype(np.float32), normals.astype(np.float32), intensity, np.zeros(len(intensity), np.int32)
        )
        self._reference = Reference((one,) * LEVELS, 1)
        self._size = len(intensity)

    def find(self, levels: tuple[Level, ...], T_camera_world: Float64Array, expected: Float64Array) -> Fit | None:
        """Return where a frame shows the cluster, near to where it is expected, T_now_start (4, 4); None for nowhere.

        Parameters
        ----------
        levels : tuple of Level
            The picture in all sizes, see `levels_of`.
        T_camera_world : (4, 4) float64
        expected : (4, 4) float64
        """
        if self._size < MIN_READINGS:
            return None
        T = T_camera_world @ expected
        prior = Prior(T, np.diag([UNSTEADY_M**-2.0] * 3 + [UNSTEADY_RAD**-2.0] * 3))
        found = align(self._reference, levels, T, prior, coarsest=COARSEST)
        seen = found.points / self._size
        if found.inliers < MIN_ON_SURFACE or seen < MIN_SEEN:
            return None
        return Fit(np.linalg.inv(T_camera_world) @ found.T_camera_reference, min(1.0, found.inliers))


def levels_of(image: WorkingImage) -> tuple[Level, ...]:
    """Return a working image in all sizes, as an alignment needs it."""
    import cv2

    gray = np.asarray(cv2.cvtColor(image.color, cv2.COLOR_RGB2GRAY), np.uint8)
    return build_levels(gray, np.ascontiguousarray(image.depth_m), image.camera)


def _in_front(points: Float64Array, image: WorkingImage) -> np.ndarray:
    """Return which points (N, 3), in the camera, no other one of them hides."""
    c = image.camera
    z = np.maximum(points[:, 2], DRIFT_M)
    u, v = (points[:, 0] / z * c.fx / CELL_PX).astype(np.int64), (points[:, 1] / z * c.fy / CELL_PX).astype(np.int64)
    _, cell = np.unique(np.stack([u, v], 1), axis=0, return_inverse=True)
    cell = cell.ravel()
    nearest = np.full(cell.max(initial=0) + 1, np.inf)
    np.minimum.at(nearest, cell, points[:, 2])
    return np.flatnonzero(points[:, 2] <= nearest[cell] + 2 * BIAS_M)


def _normals(points: Float64Array) -> Float64Array:
    """Return the normals (N, 3) of the surface at points (N, 3) in the camera; they face it."""
    _, near = cKDTree(points).query(points, min(NEIGHBOURS, len(points)))
    around = points[near.reshape(len(points), -1)]
    around = around - around.mean(1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    normals = vectors[:, :, 0]
    return np.asarray(np.where(((normals * points).sum(1) > 0)[:, None], -normals, normals))
