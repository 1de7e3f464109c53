"""The points of an object as a rigid cluster that is followed from frame to frame, by shape and color."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.tolerances import BIAS_M, DRIFT_M, MIN_READINGS
from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry.se3 import inverse, transform
from cuboid.method.objects.kernels.clusters import score_shifts
from cuboid.method.poses.alignment import Points, Prior, Reference, align
from cuboid.method.poses.pyramid import PYRAMID_LEVELS, Level

# Number of points from which the normal at a point is computed.
NORMAL_NEIGHBOURS = 12
# A point hides the farther points in the same cell of the image; side of a cell, pixels.
HIDING_CELL_PX = 3
# Standard deviations of the motion of an object from the predicted one in a frame, metres and radians.
UNSTEADY_M, UNSTEADY_RAD = 0.03, 0.15
# Step between the tried places around the expected one, metres: an alignment finds smaller shifts.
TRIED_M = 0.02
# A reading lies on a point within this distance and its noise, metres. Two colors agree within this number of levels:
# light changes as an object turns.
ON_M, MAX_COLOR_CHANGE = 0.01, 48
# If the balance of a place exceeds this, no other place is tried.
CLEAR_BALANCE = 0.6
# An object is found if this fraction of its points that nothing hides agree with the frame, ...
MIN_AGREE = 0.6
# ... and this fraction of all points that face the camera.
MIN_SEEN_FRACTION = 0.25


@dataclass(frozen=True, slots=True)
class Fit:
    """The place where a cluster was found: T_now_start (4, 4) in the world, with a confidence, 0..1.

    `balance` is the fraction of its points that the frame confirms, minus the fraction that it sees through.
    """

    T_now_start: Float64Array
    score: float
    balance: float


class Cluster:
    """The side of an object that a camera sees, as rigid points with normals and colors.

    Parameters
    ----------
    points : (N, 3) float32
        World, metres.
    colors : (N, 3) uint8
    image : WorkingImage
    T_camera_world : (4, 4) float64
        Of a camera that sees it.
    noise_per_m : float
        Standard deviation of depth is this times z squared.
    """

    def __init__(
        self,
        points: Float32Array,
        colors: UInt8Array,
        image: WorkingImage,
        T_camera_world: Float64Array,
        noise_per_m: float,
    ) -> None:
        sampled = slice(None, None, 1 + len(points) // (2 * SAMPLE_POINTS))
        in_camera = transform(T_camera_world, points[sampled])
        ahead = _in_front(in_camera, image)
        normals = (_normals(in_camera)[ahead] @ T_camera_world[:3, :3]).astype(np.float32)
        self._colors = np.ascontiguousarray(colors[sampled][ahead])
        intensity = self._colors.astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)
        self._points = Points(
            np.ascontiguousarray(points[sampled][ahead]), normals, intensity, np.zeros(len(intensity), np.int32)
        )
        self._reference = Reference((self._points,) * PYRAMID_LEVELS, 1)
        self._noise_per_m = noise_per_m

    def find(self, seen: Observation, levels: tuple[Level, ...], expected: Float64Array, reach_m: float) -> Fit | None:
        """Return the place of the cluster in a frame, near the expected one; None if it is not found.

        Parameters
        ----------
        seen : Observation
        levels : tuple of Level
            Image pyramid of the frame; see `pyramid.levels_of`.
        expected : (4, 4) float64
            T_now_start.
        reach_m : float
            Largest distance from the expected place, metres.
        """
        if len(self._colors) < MIN_READINGS:
            return None
        fit = self._aligned(seen, levels, expected)
        if fit is not None and fit.balance > CLEAR_BALANCE:
            return fit
        steps = np.arange(-int(np.ceil(reach_m / TRIED_M)), 1 + int(np.ceil(reach_m / TRIED_M))) * TRIED_M
        shifts = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
        shifts = shifts[np.argsort((shifts**2).sum(1), kind="stable")]
        counts = self._counts(seen, expected, shifts)
        best = expected.copy()
        best[:3, 3] += shifts[np.argmax(counts[:, 0] - counts[:, 1])]
        fits = [fit, self._aligned(seen, levels, best)]
        return max((found for found in fits if found is not None), key=lambda found: found.balance, default=None)

    def _aligned(self, seen: Observation, levels: tuple[Level, ...], start: Float64Array) -> Fit | None:
        """Return the place that an alignment finds from a start, T_now_start (4, 4); None if it does not fit."""
        T = seen.T_camera_world @ start
        prior = Prior(T, np.diag([UNSTEADY_M**-2.0] * 3 + [UNSTEADY_RAD**-2.0] * 3))
        found = align(self._reference, levels, T, prior, coarsest=1)
        return self.fit_at(seen, inverse(seen.T_camera_world) @ found.T_camera_reference)

    def fit_at(self, seen: Observation, T_now_start: Float64Array) -> Fit | None:
        """Return how well the cluster fits a frame after a motion (4, 4); None if it does not."""
        agree, passed, shown = self._counts(seen, T_now_start, np.zeros((1, 3)))[0].tolist()
        if agree < MIN_AGREE * (agree + passed) or agree < MIN_SEEN_FRACTION * max(shown, MIN_READINGS):
            return None
        return Fit(T_now_start, agree / (agree + passed), (agree - passed) / len(self._colors))

    def _counts(self, seen: Observation, T: Float64Array, shifts: Float64Array) -> npt.NDArray[np.int64]:
        counts, image = np.empty((len(shifts), 3), np.int64), seen.image
        points = transform(T, self._points.points).astype(np.float32)
        normals = (self._points.normals @ T[:3, :3].T).astype(np.float32)
        view, T_camera = (image.depth_m, image.color), np.ascontiguousarray(seen.T_camera_world)
        limits = ON_M, self._noise_per_m, MAX_COLOR_CHANGE
        score_shifts(points, normals, self._colors, shifts, view, image.camera.pinhole, T_camera, *limits, counts)
        return counts


def _in_front(points: Float64Array, image: WorkingImage) -> npt.NDArray[np.int64]:
    """Return the indices of the points (N, 3), in the camera frame, that no other point hides."""
    c = image.camera
    z = np.maximum(points[:, 2], DRIFT_M)
    u, v = (
        (points[:, 0] / z * c.fx / HIDING_CELL_PX).astype(np.int64),
        (points[:, 1] / z * c.fy / HIDING_CELL_PX).astype(np.int64),
    )
    _, cell = np.unique(np.stack([u, v], 1), axis=0, return_inverse=True)
    cell = cell.ravel()
    nearest = np.full(cell.max(initial=0) + 1, np.inf)
    np.minimum.at(nearest, cell, points[:, 2])
    return np.flatnonzero(points[:, 2] <= nearest[cell] + 2 * BIAS_M)


def _normals(points: Float64Array) -> Float64Array:
    """Return the normals (N, 3) of the surface at points (N, 3) in the camera; they face it."""
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(points).query(points, min(NORMAL_NEIGHBOURS, len(points)))
    neighbours = points[nearest.reshape(len(points), -1)]
    neighbours = neighbours - neighbours.mean(1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", neighbours, neighbours))
    normals = vectors[:, :, 0]
    return np.asarray(np.where(((normals * points).sum(1) > 0)[:, None], -normals, normals))
