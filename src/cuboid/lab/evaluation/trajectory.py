"""Evaluation of an estimated camera path against the true one: absolute error, drift, coverage.

ATE and RPE after Sturm, Engelhard, Endres, Burgard, Cremers, "A Benchmark for the Evaluation of RGB-D SLAM Systems",
IROS 2012; the motion that aligns the estimate with the truth after Umeyama, "Least-Squares Estimation of Transformation
Parameters Between Two Point Patterns", PAMI 1991, without scale: depth cameras measure in metres.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.paths import PathLike
from cuboid.ground.geometry.se3 import assembled
from cuboid.lab.evaluation.timed_poses import TimedPoses, read_poses
from cuboid.results.files.text import plain

FORMAT, VERSION = "cuboid-trajectory-evaluation", 1

# Maximum time difference of a pair of poses, seconds: the limit of the TUM benchmark's own tools.
MAX_PAIR_S = 0.02
# Minimum number of pairs: fewer can always be aligned without error.
FEWEST_PAIRS = 3
# Tolerance of the length of a stretch of one second or one metre, as a fraction, where poses are sparse.
STRETCH_SLACK = 0.5

IntArray = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Errors:
    """Figures of one kind of error.

    Attributes
    ----------
    rmse, mean, median, max : float
    """

    rmse: float
    mean: float
    median: float
    max: float

    @classmethod
    def of(cls, values: Float64Array) -> Errors:
        """Return the figures of at least one error, (N,)."""
        rmse = float(np.sqrt(np.mean(np.square(values))))
        return cls(rmse, float(values.mean()), float(np.median(values)), float(values.max()))


@dataclass(frozen=True, slots=True)
class Drift:
    """The relative pose error: the drift over a stretch of the path.

    Attributes
    ----------
    stretches : int
        Number of compared stretches.
    translation_cm, rotation_deg : Errors or None
        Error per second, or per metre; None if the path is too short for a stretch.
    """

    stretches: int
    translation_cm: Errors | None
    rotation_deg: Errors | None


@dataclass(frozen=True, slots=True)
class TrajectoryErrors:
    """All results for an estimated path.

    Attributes
    ----------
    estimate, truth : str
        Names of the compared paths.
    estimate_poses, truth_poses, pairs : int
        Number of poses of both, and of pairs.
    limit_s : float
        Maximum time difference of a pair, seconds.
    coverage : float
        Fraction of true poses with an estimate near their time: at most half of the estimate's median interval away.
    length_m : float
        Length of the true path through the pairs.
    duration_s : float
        Time from the first pair to the last.
    ate_cm : Errors
        Distances of the positions after the best-fitting rigid motion.
    per_second, per_metre : Drift
    T_truth_estimate : (4, 4) float64
        The best-fitting rigid motion.
    times_s : (P,) float64
    true_xyz, estimated_xyz : (P, 3) float64
        Positions of the pairs in the world of the truth, metres.
    """

    estimate: str
    truth: str
    estimate_poses: int
    truth_poses: int
    pairs: int
    limit_s: float
    coverage: float
    length_m: float
    duration_s: float
    ate_cm: Errors
    per_second: Drift
    per_metre: Drift
    T_truth_estimate: Float64Array
    times_s: Float64Array
    true_xyz: Float64Array
    estimated_xyz: Float64Array

    @property
    def error_m(self) -> Float64Array:
        """Distance (P,) of each pair's positions."""
        distances_m: Float64Array = np.linalg.norm(self.true_xyz - self.estimated_xyz, axis=1)
        return distances_m

    def to_dict(self) -> dict[str, Any]:
        """Return the figures, ready for JSON: six decimals, None where something is undefined."""
        document = {"format": FORMAT, "version": VERSION}
        for name, value in asdict(self).items():
            if name not in ("times_s", "true_xyz", "estimated_xyz"):
                document[name] = plain(value)
        return document


def evaluate_trajectory(
    estimate: TimedPoses | PathLike, truth: TimedPoses | PathLike, *, limit_s: float = MAX_PAIR_S
) -> TrajectoryErrors:
    """Compare an estimated camera path with the true one.

    Parameters
    ----------
    estimate, truth : TimedPoses or path
        Paths, each in its own world; see `read_poses` for the possible forms.
    limit_s : float
        Maximum time difference of a pair, seconds.

    Raises
    ------
    InputError
        A file cannot be used, or the two have fewer than three times in common.
    """
    found = estimate if isinstance(estimate, TimedPoses) else read_poses(estimate)
    true_poses = truth if isinstance(truth, TimedPoses) else read_poses(truth)
    a, b = associate(found.times_s, true_poses.times_s, limit_s)
    if len(a) < FEWEST_PAIRS:
        raise InputError(
            f"{found.path} and {true_poses.path} have {len(a)} times in common (within {limit_s:g} s), at least "
            f"{FEWEST_PAIRS} are needed: {_span(found)} against {_span(true_poses)}"
        )
    times_s, T_est, T_true = found.times_s[a], found.T_world_camera[a], true_poses.T_world_camera[b]
    motion = rigid_fit(T_true[:, :3, 3], T_est[:, :3, 3])
    placed = T_est[:, :3, 3] @ motion[:3, :3].T + motion[:3, 3]
    steps_m = np.linalg.norm(np.diff(T_true[:, :3, 3], axis=0), axis=1)
    path_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    within_s = max(limit_s, found.interval_s / 2)
    return TrajectoryErrors(
        estimate=str(found.path),
        truth=str(true_poses.path),
        estimate_poses=len(found),
        truth_poses=len(true_poses),
        pairs=len(a),
        limit_s=limit_s,
        coverage=float(np.mean(_nearest_away(true_poses.times_s, found.times_s) <= within_s * (1 + 1e-6))),
        length_m=float(path_m[-1]),
        duration_s=float(times_s[-1] - times_s[0]),
        ate_cm=Errors.of(100.0 * np.linalg.norm(T_true[:, :3, 3] - placed, axis=1)),
        per_second=drift(T_est, T_true, times_s, within_s),
        per_metre=drift(T_est, T_true, path_m, float(steps_m.max())),
        T_truth_estimate=motion,
        times_s=times_s,
        true_xyz=T_true[:, :3, 3],
        estimated_xyz=placed,
    )


def associate(a_s: Float64Array, b_s: Float64Array, limit_s: float) -> tuple[IntArray, IntArray]:
    """Return indices (K,) of mutually nearest times of a (N,) and b (M,), seconds, both increasing, within a limit."""
    to_b, to_a = _nearest(a_s, b_s), _nearest(b_s, a_s)
    indices_a = np.arange(len(a_s))
    # 1e-9: tolerance for decimal times whose difference equals the limit
    paired = (to_a[to_b] == indices_a) & (np.abs(a_s - b_s[to_b]) <= limit_s + 1e-9)
    return indices_a[paired], to_b[paired]


def rigid_fit(xyz_a: Float64Array, xyz_b: Float64Array) -> Float64Array:
    """Return the rigid T_a_b (4, 4) with the least squared distance between points (N, 3) of a and b."""
    mean_a, mean_b = xyz_a.mean(0), xyz_b.mean(0)
    left, _, right = np.linalg.svd((xyz_a - mean_a).T @ (xyz_b - mean_b))
    rotation = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    return assembled(rotation, mean_a - rotation @ mean_b)


def drift(T_est: Float64Array, T_true: Float64Array, travelled: Float64Array, within: float) -> Drift:
    """Compare each stretch of length 1 of the two paths.

    Parameters
    ----------
    T_est, T_true : (N, 4, 4) float64
        T_world_camera of the pairs.
    travelled : (N,) float64
        Position of each pose along the path, increasing: seconds or metres.
    within : float
        Tolerance of the length of a stretch; the error is divided by the actual length.

    Returns
    -------
    Drift
    """
    ends = _nearest(travelled + 1.0, travelled)
    begins = np.arange(len(travelled))
    length = travelled[ends] - travelled[begins]
    usable = np.abs(length - 1.0) <= min(within * (1 + 1e-6), STRETCH_SLACK)
    begins, ends, length = begins[usable], ends[usable], length[usable]
    if not len(begins):
        return Drift(0, None, None)
    moved = _relative(T_est[begins], T_est[ends])
    error = _relative(_relative(T_true[begins], T_true[ends]), moved)
    shift_cm = 100.0 * np.linalg.norm(error[:, :3, 3], axis=1)
    turned_deg = np.degrees(Rotation.from_matrix(error[:, :3, :3]).magnitude())
    return Drift(len(begins), Errors.of(shift_cm / length), Errors.of(turned_deg / length))


def _relative(T_world_a: Float64Array, T_world_b: Float64Array) -> Float64Array:
    """Return T_a_b (N, 4, 4)."""
    return np.asarray(np.linalg.solve(T_world_a, T_world_b))


def _nearest(values: Float64Array, among: Float64Array) -> IntArray:
    """Return for each value the index of the nearest among increasing values, the earlier one in a tie."""
    after = np.clip(np.searchsorted(among, values), 1, max(len(among) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(among) - 1)
    return np.where(values - among[before] <= among[after] - values, before, after)


def _nearest_away(values: Float64Array, among: Float64Array) -> Float64Array:
    return np.abs(values - among[_nearest(values, among)])


def _span(poses: TimedPoses) -> str:
    return f"{len(poses)} poses from {poses.times_s[0]:.3f} to {poses.times_s[-1]:.3f} s"
