"""A quick look whether the intrinsics in use are clearly worse than others nearby."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.calibration.calibrate import LEAST_ERROR, LEAST_PAIRS, WITH_CENTER, best_of_tried
from cuboid.calibration.comparing import FOCAL
from cuboid.calibration.pairs import choose_pairs
from cuboid.calibration.solving import Problem
from cuboid.calibration.views import Pinhole, build_view, factors
from cuboid.frame import Frame, Intrinsics

# More frames are not looked at.
FRAMES = 24
# Focal lengths that are tried, as logarithms beside the one in use.
TRIED = np.arange(-0.20, 0.201, 0.05)
STEPS = 12
# The focal length counts as wrong if it is off by this share and by four standard errors: at 1 m the edge of an image
# is then 2 cm off, which begins to double objects; a lens taken for a pinhole makes 2 or 3 %.
CLEARLY_OFF = 0.04
CLEARLY_ERRORS = 4.0
# And the views must disagree less by this share than with the one in use, poses mended for each.
CLEARLY_BETTER = 0.05


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a quick look found.

    Attributes
    ----------
    wrong : bool
        Whether another focal length is clearly better than the one in use.
    focal : float or None
        The fx that fits best, pixels; None where too few frames see the same to tell.
    focal_error : float or None
        Standard error of it, as a share.
    """

    wrong: bool
    focal: float | None
    focal_error: float | None


UNKNOWN = Verdict(False, None, None)


def quick_check(frames: Sequence[Frame], intrinsics: Intrinsics) -> Verdict:
    """Tell whether the intrinsics in use are clearly worse than others nearby, in less than a second.

    Parameters
    ----------
    frames : sequence of Frame
        With poses, given or estimated; up to 24 of them are used, evenly spread.
    intrinsics : Intrinsics
        Those in use, of these frames.

    Returns
    -------
    Verdict
        Not wrong where the frames do not tell.
    """
    posed = [frame for frame in frames if frame.T_world_camera is not None]
    chosen = sorted({round(k) for k in np.linspace(0, len(posed) - 1, FRAMES)} if posed else ())
    factor, _ = factors(intrinsics.width)
    views = [build_view(posed[k], factor) for k in chosen]
    in_use = Pinhole.of(intrinsics)
    pairs = choose_pairs(views, in_use.resized(factor))
    if len(pairs) < LEAST_PAIRS:
        return UNKNOWN
    problem = Problem(views, pairs, factor)
    best = best_of_tried(problem, in_use, TRIED)
    found = problem.solve(best, WITH_CENTER, STEPS)
    off = float(np.log(found.pinhole.fx / in_use.fx))
    error = float(np.hypot(found.error[FOCAL], LEAST_ERROR[FOCAL]))
    before, after = problem.solve(in_use, (), STEPS).disagreement, found.disagreement
    clear = abs(off) > max(CLEARLY_OFF, CLEARLY_ERRORS * error) and after < (1 - CLEARLY_BETTER) * before
    return Verdict(clear, found.pinhole.fx, error)
