"""A quick check whether the intrinsics or the depth scale in use are clearly worse than similar ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.inputs.calibration.calibrate import (
    DEPTH_SCALE_OFF,
    FOCAL_ONLY,
    MIN_PAIRS,
    TRIED_DEPTHS,
    WITH_CENTER,
    WITH_DEPTH,
    best_of_tried,
    errors_of,
    is_scale_off,
    spread_out,
)
from cuboid.inputs.calibration.comparing import DEPTH, FOCAL
from cuboid.inputs.calibration.pairs import SHORT_MOTIONS_RAD, choose_pairs
from cuboid.inputs.calibration.solving import Problem
from cuboid.inputs.calibration.views import ScaledPinhole, build_view, factors
from cuboid.inputs.readers.usable import posed_frames

# Number of examined frames of a run with given poses, and with estimated poses, which carry less information; minimum
# number of frames for a check.
EXAMINED_FRAMES, EXAMINED_FRAMES_ESTIMATED, MIN_FRAMES = 24, 48, 8
# Focal lengths that are tried, as logarithms relative to the one in use.
TRIED = np.arange(-0.20, 0.201, 0.05)
FIT_STEPS = 12
# The focal length counts as wrong if it is off by this fraction and by CLEARLY_ERRORS standard errors: at 1 m the edge
# of an image is then 2 cm off, which begins to double objects; ignored lens distortion causes 2 or 3 %, and with
# estimated poses, which determine the focal length less well, the rolling shutter of a hand-held camera causes 3.6 %.
CLEARLY_OFF, CLEARLY_OFF_ESTIMATED = 0.04, 0.05
CLEARLY_ERRORS = 4.0
# The same of a short run, whose small motions tell less: 20 frames of a real kitchen were off by 7 %.
CLEARLY_OFF_SHORT = 0.12
# Maximum relative standard error of a depth scale that counts: half of the smallest error that is named. Where given
# poses drift by centimetres, as those of a desk at hand, the scale is uncertain by 3 % or more.
WORST_SCALE_ERROR = 0.5 * DEPTH_SCALE_OFF
# In addition, the disagreement of the views must be lower by this fraction than with the one in use, with poses
# corrected for each.
CLEARLY_BETTER = 0.05


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result of a quick check.

    Attributes
    ----------
    wrong : bool
        Whether another focal length is clearly better than the one in use.
    focal : float or None
        The best-fitting fx, pixels; None if too few frames overlap.
    focal_error : float or None
        Relative standard error of `focal`.
    depth_scale : float or None
        True metres per metre of depth, if the depth scale in use is clearly wrong.
    depth_scale_error : float or None
        Relative standard error of `depth_scale`.
    """

    wrong: bool
    focal: float | None
    focal_error: float | None
    depth_scale: float | None = None
    depth_scale_error: float | None = None


UNKNOWN = Verdict(False, None, None)


def quick_check(frames: Iterable[Frame], intrinsics: Intrinsics, *, estimated: bool = False) -> Verdict:
    """Check whether the intrinsics or the depth scale in use are clearly worse than similar ones.

    Parameters
    ----------
    frames : iterable of Frame
        Frames with poses; about 24, or 48 if they were estimated, that overlap from different places (`spread_out`)
        take about a second.
    intrinsics : Intrinsics
        Intrinsics in use for these frames.
    estimated : bool
        Whether the poses come from these frames and these intrinsics; then they agree with any depth scale.

    Returns
    -------
    Verdict
        `wrong` is False if the frames do not determine the focal length.
    """
    factor, _ = factors(intrinsics.width)
    views = [build_view(frame, factor) for frame in frames]
    in_use = ScaledPinhole.of(intrinsics)
    small = in_use.resized(factor)
    pairs = choose_pairs(views, small)
    short = estimated and len(pairs) < MIN_PAIRS
    if short:
        pairs = choose_pairs(views, small, SHORT_MOTIONS_RAD)
    if len(pairs) < MIN_PAIRS:
        return UNKNOWN
    problem = Problem(views, pairs, factor)
    if estimated:
        found = scaled = problem.solve(in_use, FOCAL_ONLY, FIT_STEPS, trusting=False)
        scale_off = False
    else:
        found = problem.solve(best_of_tried(problem, in_use, TRIED), WITH_CENTER, FIT_STEPS)
        scaled = problem.solve(best_of_tried(problem, in_use, TRIED, TRIED_DEPTHS, every=3), WITH_DEPTH, FIT_STEPS)
        scale_off = is_scale_off(scaled, found, CLEARLY_ERRORS) and float(errors_of(scaled)[DEPTH]) <= WORST_SCALE_ERROR
        found = scaled if scale_off else found
    error = float(errors_of(found)[FOCAL])
    # a wrong depth scale can look like a wrong focal length: this one is off with any depth scale
    off = min(abs(float(np.log(one.pinhole.fx / in_use.fx))) for one in (found, scaled))
    least = CLEARLY_OFF_SHORT if short else CLEARLY_OFF_ESTIMATED if estimated else CLEARLY_OFF
    focal_off = off > max(least, CLEARLY_ERRORS * error)
    if focal_off or scale_off:
        before = problem.solve(in_use, (), FIT_STEPS, trusting=not estimated).disagreement
        clear = found.disagreement < (1 - CLEARLY_BETTER) * before
        focal_off, scale_off = focal_off and clear, scale_off and clear
    if not scale_off:
        return Verdict(focal_off, found.pinhole.fx, error)
    return Verdict(focal_off, found.pinhole.fx, error, found.pinhole.depth_scale, float(errors_of(found)[DEPTH]))


def intrinsics_warning(
    read: Callable[[int], Frame],
    intrinsics: Intrinsics,
    T_world_camera: Mapping[int, Float64Array],
    depth_units_per_metre: float | None = None,
) -> str | None:
    """Return a one-line warning if intrinsics or a depth scale similar to those of a run are clearly better, else None.

    Parameters
    ----------
    read : callable
        Returns a frame by its number; raises FrameError if it cannot be used.
    intrinsics : Intrinsics
        Intrinsics of the frames.
    T_world_camera : mapping of int to (4, 4) float64
        Poses of the frames that were used.
    depth_units_per_metre : float, optional
        Depth units per metre in use, for given poses; None: the poses come from these frames and these intrinsics.
    """
    if len(T_world_camera) < MIN_FRAMES:
        return None
    estimated = depth_units_per_metre is None
    frames = spread_out(T_world_camera, EXAMINED_FRAMES_ESTIMATED if estimated else EXAMINED_FRAMES)
    verdict = quick_check(posed_frames(read, T_world_camera, frames), intrinsics, estimated=estimated)
    better = "the frames fit together clearly better with"
    if depth_units_per_metre is not None and verdict.depth_scale is not None:
        units = depth_units_per_metre / verdict.depth_scale
        in_use = f"the depth scale of {depth_units_per_metre:g} units per metre"
        if verdict.wrong:
            return (
                f"{in_use} and the focal length in use, {intrinsics.fx:.1f} px, are off: {better} {units:.4g} units "
                f"and {verdict.focal:.0f} px; 'cuboid calibrate' finds both, --intrinsics takes them"
            )
        spread = units * (verdict.depth_scale_error or 0.0)
        return (
            f"{in_use} is off: {better} {units:.4g} ± {spread:.2g}, if the given poses are in metres; all sizes are "
            f"wrong by this factor; run again with --depth-scale {units:.4g}"
        )
    if not verdict.wrong or verdict.focal is None or verdict.focal_error is None:
        return None
    return (
        f"the focal length in use, {intrinsics.fx:.1f} px, is off: {better} {verdict.focal:.0f} ± "
        f"{max(1.0, verdict.focal_error * verdict.focal):.0f} px; objects may be doubled or of a wrong size; "
        "'cuboid calibrate' finds the intrinsics, --intrinsics takes them"
    )
