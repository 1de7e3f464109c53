"""A quick check whether the intrinsics in use are clearly worse than similar ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.inputs.calibration.calibrate import FOCAL_ONLY, MIN_ERROR, MIN_PAIRS, WITH_CENTER, best_of_tried, spread_out
from cuboid.inputs.calibration.comparing import FOCAL
from cuboid.inputs.calibration.pairs import choose_pairs
from cuboid.inputs.calibration.solving import Problem
from cuboid.inputs.calibration.views import ScaledPinhole, build_view, factors

# Number of examined frames of a run with given poses, and with estimated poses, which carry less information; minimum
# number of frames for a check.
FRAMES, FRAMES_ESTIMATED, MIN_FRAMES = 24, 48, 8
# Focal lengths that are tried, as logarithms relative to the one in use.
TRIED = np.arange(-0.20, 0.201, 0.05)
STEPS = 12
# The focal length counts as wrong if it is off by this fraction and by four standard errors: at 1 m the edge of an
# image is then 2 cm off, which begins to double objects; ignored lens distortion causes 2 or 3 %, and with estimated
# poses, which determine the focal length less well, the rolling shutter of a hand-held camera causes 3.6 %.
CLEARLY_OFF, CLEARLY_OFF_ESTIMATED = 0.04, 0.05
CLEARLY_ERRORS = 4.0
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
    """

    wrong: bool
    focal: float | None
    focal_error: float | None


UNKNOWN = Verdict(False, None, None)


def quick_check(frames: Iterable[Frame], intrinsics: Intrinsics, *, estimated: bool = False) -> Verdict:
    """Check whether the intrinsics in use are clearly worse than similar ones.

    Parameters
    ----------
    frames : iterable of Frame
        Frames with poses; about 24, or 48 if they were estimated, that overlap from different places (`spread_out`)
        take less than a second.
    intrinsics : Intrinsics
        Intrinsics in use for these frames.
    estimated : bool
        Whether the poses come from these frames and these intrinsics.

    Returns
    -------
    Verdict
        `wrong` is False if the frames do not determine the focal length.
    """
    factor, _ = factors(intrinsics.width)
    views = [build_view(frame, factor) for frame in frames]
    in_use = ScaledPinhole.of(intrinsics)
    pairs = choose_pairs(views, in_use.resized(factor))
    if len(pairs) < MIN_PAIRS:
        return UNKNOWN
    problem = Problem(views, pairs, factor)
    begin = in_use if estimated else best_of_tried(problem, in_use, TRIED)
    found = problem.solve(begin, FOCAL_ONLY if estimated else WITH_CENTER, STEPS, trusting=not estimated)
    off = float(np.log(found.pinhole.fx / in_use.fx))
    error = float(np.hypot(found.error[FOCAL], MIN_ERROR[FOCAL]))
    least = CLEARLY_OFF_ESTIMATED if estimated else CLEARLY_OFF
    clear = abs(off) > max(least, CLEARLY_ERRORS * error)
    if clear:
        before = problem.solve(in_use, (), STEPS, trusting=not estimated).disagreement
        clear = found.disagreement < (1 - CLEARLY_BETTER) * before
    return Verdict(clear, found.pinhole.fx, error)


def intrinsics_warning(
    read: Callable[[int], Frame],
    intrinsics: Intrinsics,
    T_world_camera: Mapping[int, Float64Array],
    *,
    estimated: bool,
) -> str | None:
    """Return a one-line warning if intrinsics similar to those of a run are clearly better, else None.

    Parameters
    ----------
    read : callable
        Returns a frame by its number; raises FrameError if it cannot be used.
    intrinsics : Intrinsics
        Intrinsics of the frames.
    T_world_camera : mapping of int to (4, 4) float64
        Poses of the frames that were used.
    estimated : bool
        Whether the poses come from these frames and these intrinsics.
    """
    if len(T_world_camera) < MIN_FRAMES:
        return None
    frames = spread_out(T_world_camera, FRAMES_ESTIMATED if estimated else FRAMES)
    verdict = quick_check(_posed(read, T_world_camera, frames), intrinsics, estimated=estimated)
    if not verdict.wrong or verdict.focal is None or verdict.focal_error is None:
        return None
    return (
        f"the focal length in use, {intrinsics.fx:.1f} px, is off: the frames fit together clearly better with "
        f"{verdict.focal:.0f} +- {max(1.0, verdict.focal_error * verdict.focal):.0f} px; objects may be doubled or of "
        f"a wrong size; 'cuboid calibrate' finds the intrinsics, --intrinsics takes them"
    )


def _posed(
    read: Callable[[int], Frame], T_world_camera: Mapping[int, Float64Array], frames: Iterable[int]
) -> Iterator[Frame]:
    for index in frames:
        with suppress(FrameError):
            yield replace(read(index), T_world_camera=T_world_camera[index])
