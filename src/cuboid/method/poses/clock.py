"""The clock of given poses: the constant offset between the times of poses and of images, from a recording itself.

A pose that is late by a time is the true pose of an earlier moment, so the relative pose of two frames is wrong
wherever the velocity changes between them. The offset is that for which relative poses agree best with the motions
found in the images (temporal calibration: Furgale, Rehder, Siegwart, "Unified temporal and spatial calibration for
multi-sensor systems", IROS 2013; Rehder, Siegwart, Furgale, T-RO 2016). Errors of the setup that look alike (depth
scale, a body other than the camera) are fitted along, and poses are smoothed: interpolation alone averages their noise
most between two samples, and would prefer such offsets.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.tolerances import MIN_SIGMA_M
from cuboid.ground.geometry.se3 import skew
from cuboid.method.poses.motions import FoundMotion

# Largest offset that is searched, and step of the search, seconds.
MAX_OFFSET_S, GRID_S = 0.15, 0.005
# Poses are smoothed with a Gaussian of this standard deviation: seconds, and steps between two poses.
SMOOTH_S, SMOOTH_STEPS = 0.03, 1.2
# A longer gap between two poses is not interpolated, seconds.
MAX_POSE_GAP_S = 0.12
# Damping of depth scale and body, metres squared: motions that do not determine them leave them at none.
DAMPING = 1e-4
# Smallest numbers of motions and of places in time that determine an offset.
MIN_MOTIONS, MIN_PLACES = 12, 8
# Parts of the time that are left out in turn for the interval (jackknife), and the 97.5 % point of its t-distribution.
PARTS, T_975 = 8, 2.365
# Offsets below this are not corrected, seconds: a hand at 0.25 m/s is 1 mm off.
MIN_OFFSET_S = 0.004
# The best offset outside this distance of the minimum, seconds, must have a loss larger by this fraction.
BESIDE_S, CLEARLY_LARGER = 0.05, 0.1
# The loss in other motions must fall by this many standard errors.
GAIN_ERRORS = 2.0
# Given poses are named if they explain less than this fraction of the points that the images' own motion explains:
# with exact poses it is 1, with noise of 5 mm .8, with rotations that shake by 0.5 degrees .5 to .7.
FITS_WORSE = 0.7
# A depth scale is named if it is off by this fraction, and by twice its interval: real ones that are right measure up
# to .027.
SCALE_OFF = 0.05
# Noise of rotations that is named, degrees: 3.5 mm at 2 m.
SHAKEN_DEG = 0.1
# Steps of the robust fits: weights settle in fewer.
FIT_ITERATIONS = 6


@dataclass(frozen=True, slots=True)
class PoseOffset:
    """The offset of the clock of poses: what is added to their times.

    Attributes
    ----------
    offset_s : float
        Seconds; positive if the stamps of the poses are too early.
    error_s : float
        Half of the 95 % interval, seconds.
    before_m, after_m : float
        Robust mean of the disagreement of relative poses and images, metres: without and with the offset, in motions to
        which it was not fitted.
    motions : int
        Number of motions.
    doubt : str
        Why the offset is not certain, in a few words; empty if it is.
    scale, scale_error : float
        Motions in the images are this times the given ones (1 if the depth scale is right); half of its 95 % interval.
    """

    offset_s: float
    error_s: float
    before_m: float
    after_m: float
    motions: int
    doubt: str
    scale: float
    scale_error: float

    @property
    def text(self) -> str:
        """The offset with its 95 % interval, in words."""
        side = "early" if self.offset_s > 0 else "late"
        return f"{1e3 * abs(self.offset_s):.0f} +- {1e3 * self.error_s:.0f} ms too {side}"


def pose_offset_of(
    times_s: Float64Array, T_world_camera: Float64Array, motions: Sequence[FoundMotion]
) -> PoseOffset | None:
    """Return the offset of the poses' clock; None if the motions do not determine any.

    Parameters
    ----------
    times_s : (N,) float64
        Times of the poses, seconds, increasing.
    T_world_camera : (N, 4, 4) float64
        The poses at these times.
    motions : sequence of FoundMotion
    """
    fit = _Fit(times_s, T_world_camera, motions)
    if len(fit.places) < MIN_MOTIONS or len(np.unique(fit.places)) < MIN_PLACES:
        return None
    losses = np.array([fit.loss(k) for k in range(len(fit.grid_s))])
    best = int(losses.argmin())
    offset_s = fit.refined(float(fit.grid_s[best]), np.ones(len(fit.places), bool))
    _, rank = np.unique(fit.places, return_inverse=True)
    (error_s, scale_error), scale = _errors(fit, offset_s, rank), 1.0 + fit.scale(offset_s, np.ones(len(rank), bool))
    before, after = _in_other_motions(fit, offset_s, rank)
    gain = np.bincount(rank, before - after)
    beside = losses[np.abs(fit.grid_s - offset_s) > BESIDE_S]
    doubt = ""
    if best in (0, len(losses) - 1) or beside.min() < (1.0 + CLEARLY_LARGER) * losses[best]:
        doubt = "no clear minimum"
    elif abs(offset_s) <= max(error_s, MIN_OFFSET_S):
        doubt = "none that matters"
    elif gain.mean() < GAIN_ERRORS * gain.std() / np.sqrt(len(gain)):
        doubt = "other frames do not agree better"
    before_m, after_m = (fit.scale_m * float(loss.mean()) for loss in (before, after))
    return PoseOffset(offset_s, error_s, before_m, after_m, len(rank), doubt, scale, scale_error)


def _errors(fit: _Fit, offset_s: float, rank: npt.NDArray[np.intp]) -> tuple[float, float]:
    """Return half of the 95 % intervals of offset and scale (jackknife): each part of the time is left out once."""
    part = rank * PARTS // (rank.max() + 1)
    without = [(fit.refined(offset_s, part != one, steps=2), fit.scale(offset_s, part != one)) for one in range(PARTS)]
    off = np.array(without) - np.mean(without, axis=0)
    error_s, scale_error = T_975 * np.sqrt((PARTS - 1) / PARTS * (off**2).sum(0))
    return float(error_s), float(scale_error)


def _in_other_motions(fit: _Fit, offset_s: float, rank: npt.NDArray[np.intp]) -> tuple[Float64Array, Float64Array]:
    """Return the loss of each motion without and with an offset that was fitted to the other half of the places."""
    before, after = np.zeros(len(rank)), np.zeros(len(rank))
    for half in (0, 1):
        fitted, other = rank % 2 == half, rank % 2 != half
        before[other] = fit.tested(0.0, fitted)[other]
        after[other] = fit.tested(fit.refined(offset_s, fitted), fitted)[other]
    return before, after


def scale_misfit(found: PoseOffset) -> str | None:
    """Return the warning that depth and given poses differ in scale; None if they agree."""
    off = abs(found.scale - 1.0)
    if off < SCALE_OFF or off < 2.0 * found.scale_error:
        return None
    return (
        f"depth and given camera poses differ in scale: frames a moment apart show {found.scale:.2f} +- "
        f"{found.scale_error:.2f} times the given motion; --depth-scale with {found.scale:.2f} times its value, if the "
        "depth is wrong"
    )


def misfit_of(T_world_camera: Float64Array, motions: Sequence[FoundMotion]) -> str | None:
    """Return the warning that given poses fit frames a moment apart clearly worse than the images' own motion.

    Parameters
    ----------
    T_world_camera : (N, 4, 4) float64
        The given poses of consecutive frames.
    motions : sequence of FoundMotion
    """
    if len(motions) < MIN_MOTIONS:
        return None
    by_given, by_found = (float(np.median([getattr(m, name) for m in motions])) for name in ("by_given", "by_found"))
    if by_given > FITS_WORSE * by_found:
        return None
    shake = np.degrees(shake_rad(T_world_camera))
    shaken = f"; their rotations shake by {shake:.1f} degrees" if shake > SHAKEN_DEG else ""
    return (
        f"the given poses fit frames a moment apart worse than poses from the images: {100 * by_given:.0f} % of the "
        f"points agree, instead of {100 * by_found:.0f} %{shaken}; try --poses corrected or estimated"
    )


def shake_rad(T_world_camera: Float64Array) -> float:
    """Return the standard deviation of noise in the rotation of poses (N, 4, 4), radians about each axis.

    From fourth differences, in which the motion of a hand at 30 Hz is below 0.05 degrees.
    """
    if len(T_world_camera) < 5:
        return 0.0
    R = T_world_camera[:, :3, :3]
    around = [Rotation.from_matrix(R[2:-2].transpose(0, 2, 1) @ R[k : len(R) - 4 + k]).as_rotvec() for k in range(5)]
    fourth = around[0] - 4.0 * around[1] - 4.0 * around[3] + around[4]
    return 1.4826 * float(np.median(np.abs(fourth))) / math.sqrt(1.0 + 16.0 + 36.0 + 16.0 + 1.0)


class _Fit:
    """Motions that lie inside the poses' time, and the disagreement of relative poses with them by offset."""

    def __init__(self, times_s: Float64Array, T_world_camera: Float64Array, motions: Sequence[FoundMotion]) -> None:
        self._times_s, self._T = times_s, T_world_camera
        self._width_s = max(SMOOTH_S, SMOOTH_STEPS * float(np.median(np.diff(times_s))))
        self.grid_s = np.arange(-round(MAX_OFFSET_S / GRID_S), round(MAX_OFFSET_S / GRID_S) + 1) * GRID_S
        inside = [m for m in motions if self._covers(m.first_s) and self._covers(m.second_s)]
        self.places = np.array([m.place for m in inside], np.int64)
        self._ends_s = np.array([(m.first_s, m.second_s) for m in inside]).reshape(-1, 2)
        self._found = np.array([m.T_second_first for m in inside]).reshape(-1, 4, 4)
        self._depth_m = np.array([m.depth_m for m in inside])
        if not inside:
            return
        self._setup = self._by_setup()
        self._grid = np.array([self.differences(offset_s) for offset_s in self.grid_s])
        sizes = np.linalg.norm(self._grid, axis=2)
        self.scale_m = max(1.4826 * float(np.median(sizes, axis=1).min()), MIN_SIGMA_M)

    def _covers(self, time_s: float) -> bool:
        """Return whether the poses have no gap around a time."""
        reach_s = MAX_OFFSET_S + 2.0 * self._width_s
        first, last = np.searchsorted(self._times_s, (time_s - reach_s, time_s + reach_s))
        if first == 0 or last == len(self._times_s):
            return False
        return bool(np.diff(self._times_s[first - 1 : last + 1]).max() <= MAX_POSE_GAP_S)

    def differences(self, offset_s: float) -> Float64Array:
        """Return found minus given motion (K, 6) with an offset, metres: rotations are multiplied by the depth."""
        first, second = (smoothed(self._times_s, self._T, self._ends_s[:, k] - offset_s, self._width_s) for k in (0, 1))
        R = second[:, :3, :3].transpose(0, 2, 1)
        turn = R @ first[:, :3, :3]
        shift = np.einsum("kij,kj->ki", R, first[:, :3, 3] - second[:, :3, 3])
        rotation = self._found[:, :3, :3] @ turn.transpose(0, 2, 1)
        moved = self._found[:, :3, 3] - np.einsum("kij,kj->ki", rotation, shift)
        return np.concatenate([moved, self._depth_m[:, None] * Rotation.from_matrix(rotation).as_rotvec()], axis=1)

    def _by_setup(self) -> Float64Array:
        """Return the derivatives (K, 6, 7) of the differences by depth scale and by body of the poses."""
        columns = np.zeros((len(self.places), 6, 7))
        for k, T in enumerate(self._found):
            R, t = T[:3, :3], T[:3, 3]
            columns[k, :3, 0] = t
            columns[k, :, 1:] = np.block([[R, skew(t) @ R], [np.zeros((3, 3)), R]]) - np.eye(6)
            columns[k, 3:] *= self._depth_m[k]
        return columns

    def _solved(
        self, differences: Float64Array, columns: Float64Array, used: npt.NDArray[np.bool_]
    ) -> tuple[Float64Array, Float64Array]:
        """Return the parameters that explain most of the used differences, robustly, and all remaining ones (K, 6)."""
        damping = np.full(columns.shape[2], DAMPING)
        damping[7:] = 1e-12
        weight, parameters = used.astype(np.float64), np.zeros(columns.shape[2])
        left = differences
        for _ in range(FIT_ITERATIONS):
            weighted = columns * weight[:, None, None]
            normal = np.einsum("kip,kiq->pq", weighted, columns) + np.diag(damping)
            parameters = np.linalg.solve(normal, np.einsum("kip,ki->p", weighted, differences))
            left = differences - columns @ parameters
            weight = used / (1.0 + (left**2).sum(1) / self.scale_m**2) ** 2
        return parameters, left

    def _losses(self, left: Float64Array) -> Float64Array:
        """Return the robust loss (K,) of remaining differences, 0..1 each (Geman, McClure 1985)."""
        square = (left**2).sum(1) / self.scale_m**2
        return np.asarray(square / (1.0 + square))

    def loss(self, k: int) -> float:
        """Return the mean loss at an offset of the grid."""
        _, left = self._solved(self._grid[k], self._setup, np.ones(len(self.places), bool))
        return float(self._losses(left).mean())

    def tested(self, offset_s: float, fitted: npt.NDArray[np.bool_]) -> Float64Array:
        """Return the loss (K,) at an offset, with the setup fitted to some motions."""
        differences = self.differences(offset_s)
        parameters, _ = self._solved(differences, self._setup, fitted)
        return self._losses(differences - self._setup @ parameters)

    def scale(self, offset_s: float, used: npt.NDArray[np.bool_]) -> float:
        """Return by which fraction found translations are larger than given ones, at an offset."""
        parameters, _ = self._solved(self.differences(offset_s), self._setup, used)
        return float(parameters[0])

    def refined(self, offset_s: float, used: npt.NDArray[np.bool_], steps: int = 4) -> float:
        """Return the offset by Gauss-Newton from a start."""
        for _ in range(steps):
            by_offset = (self.differences(offset_s + GRID_S) - self.differences(offset_s - GRID_S)) / (2 * GRID_S)
            columns = np.concatenate([self._setup, -by_offset[:, :, None]], axis=2)
            parameters, _ = self._solved(self.differences(offset_s), columns, used)
            offset_s = float(np.clip(offset_s + parameters[7], -MAX_OFFSET_S, MAX_OFFSET_S))
        return offset_s


def smoothed(times_s: Float64Array, T_world_camera: Float64Array, at_s: Float64Array, width_s: float) -> Float64Array:
    """Return poses (M, 4, 4) at some times, by a local parabola with Gaussian weights.

    Parameters
    ----------
    times_s : (N,) float64
        Increasing.
    T_world_camera : (N, 4, 4) float64
    at_s : (M,) float64
        Seconds.
    width_s : float
        Standard deviation of the weights, seconds.
    """
    count = len(times_s)
    nearest = np.searchsorted(times_s, at_s).clip(0, count - 1)
    reach = int(np.ceil(3.0 * width_s / float(np.median(np.diff(times_s)))))
    around = (nearest[:, None] + np.arange(-reach, reach + 1)).clip(0, count - 1)
    repeated = np.diff(around, axis=1, prepend=-1) == 0
    away_s = times_s[around] - at_s[:, None]
    weight = np.where(repeated, 0.0, np.exp(-0.5 * (away_s / width_s) ** 2))
    R_world = T_world_camera[:, :3, :3]
    base = R_world[nearest]
    turns = Rotation.from_matrix((base.transpose(0, 2, 1)[:, None] @ R_world[around]).reshape(-1, 3, 3)).as_rotvec()
    values = np.concatenate([T_world_camera[around, :3, 3], turns.reshape(*around.shape, 3)], axis=2)
    powers = np.stack([np.ones_like(away_s), away_s / width_s, (away_s / width_s) ** 2], axis=2)
    normal = np.einsum("mn,mnp,mnq->mpq", weight, powers, powers) + 1e-9 * np.eye(3)
    fitted = np.linalg.solve(normal, np.einsum("mn,mnp,mnc->mpc", weight, powers, values))[:, 0]
    T = np.tile(np.eye(4), (len(at_s), 1, 1))
    T[:, :3, :3] = base @ Rotation.from_rotvec(fitted[:, 3:]).as_matrix()
    T[:, :3, 3] = fitted[:, :3]
    return T
