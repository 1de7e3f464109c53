"""Finds the focal length, optical centre and depth scale for which the views of a recording are consistent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry import se3
from cuboid.inputs.calibration.comparing import CENTER_X, CENTER_Y, DEPTH, FOCAL
from cuboid.inputs.calibration.pairs import choose_pairs
from cuboid.inputs.calibration.solving import Problem, Solution
from cuboid.inputs.calibration.views import ScaledPinhole, build_view, factors

# Number of compared frames, and of consecutive frames in a group, for long recordings.
COMPARED_FRAMES = 64
GROUP_FRAMES = 8
# Camera motion from one chosen frame to the next, radians; a metre counts as a radian (objects are one to two metres
# away). Less in a short recording.
FRAME_STEP_RAD = 0.08
# Initial focal lengths, as logarithms relative to the start value: 0.74 to 1.35 times it.
TRIED = np.arange(-0.30, 0.301, 0.05)
# Initial depth scales, as logarithms: 0.67 to 1.49.
TRIED_DEPTHS, ALONE = np.arange(-0.40, 0.401, 0.08), np.zeros(1)
# Maximum numbers of Gauss-Newton steps.
COARSE_STEPS, FINE_STEPS = 20, 12
# Fitted parameters by source of poses: with poses estimated from the same frames, only the focal length.
FOCAL_ONLY, WITH_CENTER = (FOCAL,), (FOCAL, CENTER_X, CENTER_Y)
WITH_DEPTH = (*WITH_CENTER, DEPTH)
# Minimum number of pairs of views for a result.
MIN_PAIRS = 12
# The depth scale is corrected only if it is off by more than this fraction and by ERRORS standard errors: lens
# distortion and drifting poses cause apparent errors of up to 2 %.
DEPTH_SCALE_OFF, ERRORS = 0.03, 3.0
# In addition, the disagreement of the views must be at most this factor times that with the old scale, with poses
# corrected for each: a camera that mostly turns has short translations, which drift makes too long or too short.
AS_GOOD = 1.07
# Errors that the spread between parts of a recording does not show (residual lens distortion, rolling shutter, depth
# and color at different times): fraction, pixels, pixels, fraction.
MIN_ERROR = np.array([0.005, 0.5, 0.5, 0.003])
# Maximum relative standard error of a usable focal length.
WORST_FOCAL_ERROR = 0.03


@dataclass(frozen=True, slots=True)
class CalibrationResult:
    """The intrinsics that were found, with standard errors.

    Attributes
    ----------
    start, intrinsics : Intrinsics
        Intrinsics before and after; the ratio of fx and fy is kept.
    depth_scale : float
        True metres per metre of depth as read; 1 unless another scale is clearly better.
    focal_error : float
        Relative standard error of the focal length.
    center_error_px : (float, float)
    measured_depth_scale, depth_scale_error : float
        The best-fitting depth scale, and its standard error.
    pose_error_m, pose_error_rad : float
        Error of the relative pose of two compared views; NaN for estimated poses.
    gap_before_m, gap_after_m : float
        Median difference of depth between views, with uncorrected poses.
    frames, pairs : int
        Numbers of compared frames and pairs.
    """

    start: Intrinsics
    intrinsics: Intrinsics
    depth_scale: float
    focal_error: float
    center_error_px: tuple[float, float]
    measured_depth_scale: float
    depth_scale_error: float
    pose_error_m: float
    pose_error_rad: float
    gap_before_m: float
    gap_after_m: float
    frames: int
    pairs: int


def calibrate(frames: Iterable[Frame], start: Intrinsics, *, estimated: bool = False) -> CalibrationResult:
    """Find the pinhole for which frames are consistent.

    Points of each frame are warped into others by the poses; with the correct pinhole, depth and brightness agree
    there. Poses may have errors of a few centimetres: the relative pose of each pair is corrected slightly
    (`cuboid.inputs.calibration.solving`).

    Parameters
    ----------
    frames : iterable of Frame
        Frames with poses; about 64 from a moving camera, see `spread_out`.
    start : Intrinsics
        Start value; the true focal length must be 0.74 to 1.35 times this one.
    estimated : bool
        Whether the poses come from these frames and this pinhole: then only the focal length is fitted. Such poses do
        not determine the metric scale, and absorb a shift of the optical centre.

    Raises
    ------
    InputError
        The frames overlap too little, or do not determine the focal length.
    """
    coarse_by, fine_by = factors(start.width)
    coarse_views, fine_views = [], []
    for frame in frames:  # one at a time: frames take more memory than their views
        coarse_views.append(build_view(frame, coarse_by))
        fine_views.append(build_view(frame, fine_by))
    begin = ScaledPinhole.of(start)
    pairs = choose_pairs(coarse_views, begin.resized(coarse_by))
    if len(pairs) < MIN_PAIRS:
        raise InputError(
            f"only {len(pairs)} pairs of {len(coarse_views)} frames see the same from places far enough apart, "
            f"at least {MIN_PAIRS} are needed: the camera must go around things, or turn"
        )
    coarse, fine = Problem(coarse_views, pairs, coarse_by), Problem(fine_views, pairs, fine_by)
    measured, measured_error = 1.0, float("nan")
    if estimated:
        pinhole = coarse.solve(begin, FOCAL_ONLY, COARSE_STEPS, trusting=False).pinhole
        found = fine.solve(pinhole, FOCAL_ONLY, FINE_STEPS, trusting=False)
    else:
        pinhole = coarse.solve(_tried(coarse, begin), FOCAL_ONLY, COARSE_STEPS).pinhole
        pinhole = coarse.solve(pinhole, WITH_CENTER, COARSE_STEPS).pinhole
        found = fine.solve(pinhole, WITH_CENTER, FINE_STEPS)
        pinhole = coarse.solve(_tried(coarse, begin, TRIED_DEPTHS), WITH_DEPTH, COARSE_STEPS).pinhole
        scaled = fine.solve(pinhole, WITH_DEPTH, FINE_STEPS)
        measured, measured_error = scaled.pinhole.depth_scale, float(errors_of(scaled)[DEPTH])
        if is_scale_off(scaled, found, ERRORS):
            found = scaled
    return CalibrationResult(
        start=start,
        intrinsics=_certain_intrinsics(found, start),
        depth_scale=found.pinhole.depth_scale,
        focal_error=float(errors_of(found)[FOCAL]),
        center_error_px=(float(errors_of(found)[CENTER_X]), float(errors_of(found)[CENTER_Y])),
        measured_depth_scale=measured,
        depth_scale_error=measured_error,
        pose_error_m=float("nan") if estimated else float(found.pose_error[0]),
        pose_error_rad=float("nan") if estimated else float(found.pose_error[1]),
        gap_before_m=coarse.typical_gap_m(begin),
        gap_after_m=coarse.typical_gap_m(found.pinhole),
        frames=len(coarse_views),
        pairs=len(pairs),
    )


def is_scale_off(scaled: Solution, found: Solution, errors: float) -> bool:
    """Return whether a solution with another depth scale shows that the scale in use is off.

    Parameters
    ----------
    scaled, found : Solution
        Solutions with the depth scale fitted, and as it is.
    errors : float
        Number of standard errors by which the scale must be off.
    """
    as_good = scaled.disagreement < AS_GOOD * found.disagreement
    off = abs(float(np.log(scaled.pinhole.depth_scale)))
    return as_good and off > max(DEPTH_SCALE_OFF, errors * float(errors_of(scaled)[DEPTH]))


def best_of_tried(
    problem: Problem, pinhole: ScaledPinhole, focals: Float64Array, depths: Float64Array = ALONE, *, every: int = 1
) -> ScaledPinhole:
    """Return the best of several pinholes, by the agreement of every n-th pair of views.

    `focals` (F,) and `depths` (D,) are logarithms of focal lengths and depth scales relative to the pinhole's own.
    """
    candidates = [
        replace(pinhole, fx=pinhole.fx * grown, fy=pinhole.fy * grown, depth_scale=pinhole.depth_scale * scaled)
        for scaled in np.exp(depths)
        for grown in np.exp(focals)
    ]
    return min(candidates, key=lambda candidate: problem.disagreement(candidate, every))


def spread_out(T_world_camera: Mapping[int, Float64Array], count: int = COMPARED_FRAMES) -> list[int]:
    """Return the frames to compare: the camera moves between them, and the frames of a group overlap.

    Parameters
    ----------
    T_world_camera : mapping of int to (4, 4) float64
        Poses of the frames that have one.
    count : int
        Maximum number of frames.

    Returns
    -------
    list of int
        Frame numbers, increasing.
    """
    poses = sorted(T_world_camera.items())
    if not poses:
        return []
    motions = [se3.inverse(a) @ b for (_, a), (_, b) in pairwise(poses)]
    travelled = np.cumsum([0.0, *(se3.angle(T) + float(np.linalg.norm(T[:3, 3])) for T in motions)])
    step = max(min(FRAME_STEP_RAD, float(travelled[-1]) / count), 1e-9)
    _, first = np.unique(np.floor(travelled / step), return_index=True)
    chosen = [poses[k][0] for k in first]
    if len(chosen) <= count:
        return chosen
    starts = np.linspace(0, len(chosen) - GROUP_FRAMES, count // GROUP_FRAMES).round().astype(int)
    return [chosen[k] for k in sorted({k for start in starts for k in range(start, start + GROUP_FRAMES)})]


def _tried(coarse: Problem, begin: ScaledPinhole, depths: Float64Array = ALONE) -> ScaledPinhole:
    return best_of_tried(coarse, begin, TRIED, depths, every=3)


def _certain_intrinsics(found: Solution, start: Intrinsics) -> Intrinsics:
    """Return the intrinsics; raise InputError if the focal length is too uncertain."""
    pinhole, error = found.pinhole, errors_of(found)[FOCAL]
    if error > WORST_FOCAL_ERROR:
        raise InputError(
            f"the recording does not tell the focal length: {pinhole.fx:.0f} px fits best, but within "
            f"{100 * error:.0f} % only; the camera must go around things, or turn"
        )
    return replace(start, fx=pinhole.fx, fy=pinhole.fy, cx=pinhole.cx, cy=pinhole.cy)


def errors_of(found: Solution) -> Float64Array:
    """Return standard errors, with `MIN_ERROR` included."""
    errors: Float64Array = np.hypot(found.error, MIN_ERROR)
    return errors
