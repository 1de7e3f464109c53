"""One supporting plane: its moments, its position, and the area that it covers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.state import TRANSIENT, WatchedRecord
from cuboid.ground.core.tolerances import DRIFT_M, DRIFT_RAD, JUMP_M, MIN_SIGMA_M, SIGMAS
from cuboid.method.surfaces.grid import GroundPlan

Keyframes = npt.NDArray[np.int64]

# A horizontal cell belongs to a plane if it is within this distance, metres, or within three standard deviations.
ON_PLANE_M = 0.02
# Legs and sides that carry a plane end at most this far below it, metres: the thickness of a board plus drift.
REACH_M = 2.0 * DRIFT_M
# Errors of neighbouring cells are correlated: the cells of a frame count as this fraction of their number.
INDEPENDENT_FRACTION = 0.1
# Prior of the deviation of a plane in a frame from its place in the map: pose drift.
_PRIOR = np.diag([DRIFT_RAD**-2, DRIFT_RAD**-2, DRIFT_M**-2])
# Prior of the slope: a residual of 1 cm has the same weight as a slope of 2 degrees.
_LEVEL = JUMP_M**2 / 0.035**2 * np.eye(2) * JUMP_M


@dataclass(slots=True, eq=False)
class Plane(WatchedRecord):
    """A tracked plane; its moments are in the plan frame, weighted by area over variance.

    Attributes
    ----------
    index : int
        Index among the planes; -1 for a removed plane.
    identity : int
        Permanent number of the plane, never reused.
    weight : float
        Sum of the weights of its points.
    mean : (3,) float64
        Mean of its points.
    scatter : (3, 3) float64
        Weighted sum of the outer products of its points' offsets from the mean.
    normal : (3,) float64
    offset : float
        Points p of the plane have normal.p + offset = 0.
    frames : int
        Number of frames that saw it.
    last_frame : int
        Last frame that saw it.
    in_use : bool
        Whether objects may stand on it.
    plan : GroundPlan
        The area that it covers.
    absorbed_by : Plane or None
        The plane that absorbed this one.
    keyframes : (K,) int64
        Keyframes that saw it.
    keyframe_moments : (K, 13) float64
        Weight, mean and scatter of the points seen from each keyframe; the plane's moments combine all of them.
    first_frame : int
        First frame that saw it.
    """

    index: int = -1
    identity: int = -1
    weight: float = 0.0
    mean: Float64Array = field(default_factory=lambda: np.zeros(3))
    scatter: Float64Array = field(default_factory=lambda: np.zeros((3, 3)))
    normal: Float64Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    offset: float = 0.0
    frames: int = 0
    last_frame: int = 0
    in_use: bool = False
    plan: GroundPlan = field(default_factory=GroundPlan)
    absorbed_by: Plane | None = field(default=None, metadata=TRANSIENT)
    keyframes: Keyframes = field(default_factory=lambda: np.zeros(0, np.int64))
    keyframe_moments: Float64Array = field(default_factory=lambda: np.zeros((0, 13)))
    first_frame: int = 0

    def add(self, points: Float64Array, weights: Float64Array, keyframe: int = 0) -> None:
        """Add points (N, 3) of the plane, seen from a keyframe."""
        w = float(weights.sum())
        mean = weights @ points / w
        centred = points - mean
        step = mean - self.mean
        total = self.weight + w
        scatter = (centred * weights[:, None]).T @ centred
        self._add_moments(np.array([keyframe]), np.concatenate([[w], mean, scatter.ravel()])[None])
        self.scatter += scatter + np.outer(step, step) * (self.weight * w / total)
        self.mean = self.mean + step * (w / total)
        self.weight = total

    def absorb(self, other: Plane) -> None:
        """Merge another plane that is a duplicate of this one."""
        self._add_moments(other.keyframes, other.keyframe_moments)
        step = other.mean - self.mean
        total = self.weight + other.weight
        self.scatter += other.scatter + np.outer(step, step) * (self.weight * other.weight / total)
        self.mean = self.mean + step * (other.weight / total)
        self.weight = total
        self.frames = max(self.frames, other.frames)
        self.last_frame = max(self.last_frame, other.last_frame)
        self.first_frame = min(self.first_frame, other.first_frame)
        self.in_use |= other.in_use
        self.fit()
        self.plan.absorb(other.plan)
        other.absorbed_by = self

    def fit(self) -> None:
        """Compute normal and offset: a horizontal plane, tilted only as far as its points require.

        The slope (a, b) of height over the plan minimises the weighted squared residual plus a prior of 2 degrees,
        which a narrow or noisy plane cannot overcome.
        """
        s = self.scatter / max(self.weight, 1e-12)
        slope = np.linalg.solve(s[:2, :2] + _LEVEL, s[:2, 2])
        normal = np.array([-slope[0], -slope[1], 1.0])
        self.normal = normal / math.sqrt(normal.dot(normal))
        self.offset = -float(self.normal @ self.mean)

    def _add_moments(self, keyframes: Keyframes, moments: Float64Array) -> None:
        """Add the moments (N, 13) of points that keyframes (N,) saw."""
        for keyframe, row in zip(keyframes, moments, strict=True):
            index = np.flatnonzero(self.keyframes == keyframe)
            if len(index):
                self.keyframe_moments[index[0]] = _combined(np.stack([self.keyframe_moments[index[0]], row]))
            else:
                self.keyframes = np.append(self.keyframes, keyframe)
                self.keyframe_moments = np.concatenate([self.keyframe_moments, row[None]])

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> bool:
        """Move the plane with the keyframes that saw it; return whether any of these moved.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old in the plan frame for each keyframe that moved.
        """
        moving = np.array([k for k, keyframe in enumerate(self.keyframes.tolist()) if keyframe in moved], np.int64)
        if not len(moving):
            return False
        motions = {keyframe: moved[keyframe] for keyframe in self.keyframes[moving].tolist()}
        self.plan.apply_correction(motions, self.normal, self.offset)
        T = np.array(list(motions.values()))
        R, moments = T[:, :3, :3], self.keyframe_moments[moving]
        moments[:, 1:4] = np.einsum("kij,kj->ki", R, moments[:, 1:4]) + T[:, :3, 3]
        moments[:, 4:] = (R @ moments[:, 4:].reshape(-1, 3, 3) @ R.transpose(0, 2, 1)).reshape(-1, 9)
        self.keyframe_moments[moving] = moments
        whole = _combined(self.keyframe_moments)
        self.mean, self.scatter = whole[1:4], whole[4:].reshape(3, 3)
        self.fit()
        return True

    def height(self, points: Float64Array) -> Float64Array:
        """Return the heights (N,) of points (N, 3) above the plane."""
        return points @ self.normal + self.offset

    def adapted(self, points: Float64Array, sigma_m: Float64Array) -> Float64Array:
        """Return normal and offset, (4,), adapted to a frame's points (N, 3) within the limits of pose drift.

        The fit is a ridge regression with one reweighting; `sigma_m` (N,) are the standard deviations of the points.
        """
        middle = points.mean(0)
        design = points - middle
        design[:, 2] = 1.0
        residual = self.height(points)
        finest_m = SIGMAS * MIN_SIGMA_M
        weights = 1.0 / (sigma_m**2 + finest_m**2)
        solution: Float64Array = np.zeros(3)
        for _ in range(2):
            w = (
                INDEPENDENT_FRACTION
                * weights
                / (1.0 + ((residual - design @ solution) / (SIGMAS * sigma_m + finest_m)) ** 2)
            )
            solution = np.asarray(np.linalg.solve(design.T @ (design * w[:, None]) + _PRIOR, design.T @ (w * residual)))
        normal = self.normal - np.array([solution[0], solution[1], 0.0])
        offset = self.offset - solution[2] + float(solution[:2] @ middle[:2])
        return np.append(normal, offset) / math.sqrt(normal.dot(normal))


def _combined(moments: Float64Array) -> Float64Array:
    """Return the combined moments (13,) (weight, mean, scatter) of the moments of all keyframes (K, 13)."""
    weights = moments[:, 0]
    weight = weights.sum()
    mean = weights @ moments[:, 1:4] / weight
    distance = moments[:, 1:4] - mean
    scatter = moments[:, 4:].sum(0) + ((distance * weights[:, None]).T @ distance).ravel()
    return np.concatenate([[weight], mean, scatter])
