"""Found rectangles against drawn ones, a frame at a time: which pair, which are false, which count neither way."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float64Array
from cuboid.evaluation.keyframes import Keyframe
from cuboid.evaluation.matching import match
from cuboid.geometry.rectangles import fractions_inside, rect_iou_matrix

# An object of which less than this fraction is visible need not be found.
MIN_VISIBLE = 0.3
# Found where at least this fraction of it lies in a place that counts neither way, a rectangle does so as well.
LIES_IN_FRACTION = 0.5

BoolArray = npt.NDArray[np.bool_]


class Outcome(Enum):
    """The verdict on a found rectangle."""

    TRUE = "true"  # pairs with a drawn rectangle that counts
    FALSE = "false"
    IGNORED = "ignored"  # lies in an ignored rectangle
    HARDLY_VISIBLE = "hardly visible"  # pairs with, or lies in, one of which too little is seen
    IN_GROUP = "in group"  # lies in a group, of which it may be one thing


@dataclass(frozen=True, slots=True)
class FrameJudgement:
    """A frame's found rectangles against its drawn ones at one IoU.

    Attributes
    ----------
    counts : (G,) bool
        Drawn rectangles that must be found.
    partner : (G,) int64
        The found rectangle of each drawn one; -1 where there is none.
    outcomes : tuple of Outcome
        Of each found rectangle, (P,).
    iou : (G, P) float64
    """

    counts: BoolArray
    partner: npt.NDArray[np.int64]
    outcomes: tuple[Outcome, ...]
    iou: Float64Array

    @property
    def found(self) -> BoolArray:
        """Drawn rectangles that must be found and are, (G,)."""
        found: BoolArray = self.counts & (self.partner >= 0)
        return found


def judge_frame(keyframe: Keyframe, found_xyxy: Float64Array, threshold: float) -> FrameJudgement:
    """Judge the rectangles that were found in a frame.

    Drawn and found ones are paired one to one: as many pairs as reach the threshold, and among those the largest
    sum of IoU. A found one without a partner counts neither way where half of it or more lies in an ignored
    rectangle, in a drawn one of which too little is visible, or in a group; else it is false.

    Parameters
    ----------
    keyframe : Keyframe
        With G drawn rectangles.
    found_xyxy : (P, 4) float64
        Pixels of the recording's full size.
    threshold : float
        Least IoU of a pair.
    """
    drawn = keyframe.rects_xyxy
    counts = np.array([item.visible >= MIN_VISIBLE for item in keyframe.drawn], bool)
    group = np.array([item.group for item in keyframe.drawn], bool)
    iou = rect_iou_matrix(drawn, found_xyxy)
    inside = fractions_inside(found_xyxy, drawn) >= LIES_IN_FRACTION
    ignored: BoolArray = np.any(fractions_inside(found_xyxy, keyframe.ignored) >= LIES_IN_FRACTION, axis=1)
    partner = np.full(len(drawn), -1, np.int64)
    outcomes = [
        _without_partner(bool(ignored[k]), bool(inside[k, ~counts].any()), bool(inside[k, group].any()))
        for k in range(len(found_xyxy))
    ]
    for i, k in match(iou, threshold):
        partner[i] = k
        outcomes[k] = Outcome.TRUE if counts[i] else Outcome.HARDLY_VISIBLE
    return FrameJudgement(counts, partner, tuple(outcomes), iou)


def _without_partner(ignored: bool, hardly_visible: bool, in_group: bool) -> Outcome:
    if ignored:
        return Outcome.IGNORED
    if hardly_visible:
        return Outcome.HARDLY_VISIBLE
    return Outcome.IN_GROUP if in_group else Outcome.FALSE
