"""Comparison of found and drawn rectangles in one frame: true, false, or counting neither way."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.rectangles import fractions_inside, rect_iou_matrix
from cuboid.lab.evaluation.keyframes import Keyframe
from cuboid.lab.evaluation.matching import match

# Minimum visible fraction of an object that must be found.
MIN_VISIBLE = 0.3
# A found rectangle counts neither way if at least this fraction of it lies in a place that counts neither way.
LIES_IN_FRACTION = 0.5

BoolArray = npt.NDArray[np.bool_]


class Outcome(Enum):
    """The verdict on a found rectangle."""

    TRUE = "true"  # pairs with a drawn rectangle that counts
    FALSE = "false"
    IGNORED = "ignored"  # lies in an ignored rectangle
    HARDLY_VISIBLE = "hardly visible"  # pairs with, or lies in, a rectangle of a hardly visible object
    IN_GROUP = "in group"  # lies in a group, and may be one of its objects


@dataclass(frozen=True, slots=True)
class FrameJudgement:
    """The result of comparing a frame's found and drawn rectangles at one IoU threshold.

    Attributes
    ----------
    counts : (G,) bool
        Drawn rectangles that must be found.
    partner : (G,) int64
        Index of the found rectangle of each drawn one; -1 if there is none.
    outcomes : tuple of Outcome
        Outcome of each found rectangle, (P,).
    iou : (G, P) float64
    """

    counts: BoolArray
    partner: npt.NDArray[np.int64]
    outcomes: tuple[Outcome, ...]
    iou: Float64Array

    @property
    def found(self) -> BoolArray:
        """Drawn rectangles that must be found and are found, (G,)."""
        found: BoolArray = self.counts & (self.partner >= 0)
        return found


def judge_frame(keyframe: Keyframe, found_xyxy: Float64Array, threshold: float) -> FrameJudgement:
    """Judge the rectangles that were found in a frame.

    Drawn and found rectangles are paired one to one, to maximise first the number of pairs that reach the threshold,
    then the sum of IoU. A found rectangle without a partner counts neither way if at least half of it lies in an
    ignored rectangle, in the rectangle of a hardly visible object, or in a group; otherwise it is false.

    Parameters
    ----------
    keyframe : Keyframe
        With G drawn rectangles.
    found_xyxy : (P, 4) float64
        Pixels of the recording's full size.
    threshold : float
        Minimum IoU of a pair.
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
