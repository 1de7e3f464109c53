"""Names of objects: class scores of a detector, accumulated over sightings as log-odds.

Errors of a detector are correlated between frames from one direction. Therefore the n-th sighting from one direction
has 1/n of the weight of the first, and each sighting is weighted by the visible fraction of the object. A class gains
from scores above a neutral one and loses from lower ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TypedDict

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.results import NEXT_NAMES
from cuboid.ground.geometry.rectangles import rect_iou_matrix
from cuboid.method.detection.types import Detections

# A detection shows an object if their rectangles overlap by this IoU: the usual threshold in detector benchmarks.
SAME_IOU = 0.5
# An object with more than this fraction of its rectangle in a larger detection may be a part of that detection: then
# it is no evidence that the detector sees nothing else there.
INSIDE_FRACTION = 0.5
# Scores below this are ignored: detectors list classes from about this score on.
MIN_CLASS_SCORE = 0.05
# A score that is no evidence for or against a class. Objects outside the vocabulary get scores around it again and
# again (a lunch box as a cell phone: 0.08 to 0.4), others get more: mice 0.13 to 0.4, screens and books 0.8 to 0.9.
NEUTRAL_SCORE = 0.15
# Scores are clipped to this.
MAX_SCORE = 0.99
# Largest loss of log-odds of a class in a sighting: a small detector misses two of three objects.
MISSED = 0.3
# Log-odds of "no known class" before the first sighting.
PRIOR = 1.0
# Directions of view within this angle are the same, radians: a smaller change shows the same side.
SAME_VIEW_RAD = 0.2
# Largest number of directions per object: about a hundred of this width exist, and few of them are used.
MAX_DIRECTIONS = 64
# Largest number of classes per object; the most likely ones are kept.
MAX_CLASSES = 16
# An object gets a name if the probability of the class is at least this.
MIN_NAME_SCORE = 0.5
# Classes whose probability rounds to 0 at this number of decimals are not reported.
NAME_DIGITS = 2


class Named(TypedDict):
    """The name fields of results; see `TrackedObject`."""

    name: str | None
    name_score: float | None
    names: tuple[tuple[str, float], ...]


def match_detections(found: Detections, rects_xyxy: Float64Array) -> npt.NDArray[np.intp]:
    """Return the object that each detection shows, (N,), -1: none: the one with the largest overlap, if it is enough.

    Parameters
    ----------
    found : Detections
    rects_xyxy : (M, 4) float64
        Rectangles of the visible objects, pixels.
    """
    if not len(found) or not len(rects_xyxy):
        return np.full(len(found), -1, np.intp)
    iou = rect_iou_matrix(found.boxes_xyxy.astype(np.float64), rects_xyxy)
    return np.where(iou.max(axis=1) >= SAME_IOU, iou.argmax(axis=1), -1)


def likely_classes(names: Sequence[str], scores: Float32Array) -> dict[str, float]:
    """Return the classes whose scores (C,) a detector would list; a class with an empty name is ignored."""
    return {names[c]: float(scores[c]) for c in np.flatnonzero(scores >= MIN_CLASS_SCORE).tolist() if names[c]}


def with_scores(log_odds: Mapping[str, float], scores: Mapping[str, float], weight: float) -> dict[str, float]:
    """Return the evidence for a name after a sighting, with the classes' scores and a weight of 0..1."""
    return _likely(
        {
            name: log_odds.get(name, 0.0) + weight * score_gain(scores.get(name, 0.0))
            for name in sorted({*log_odds, *scores})
        }
    )


def merged_evidence(first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
    """Return the evidence for the name of an object that was tracked as two."""
    return _likely({name: first.get(name, 0.0) + second.get(name, 0.0) for name in sorted({*first, *second})})


def name_scores(log_odds: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return classes with their probabilities, most likely first; the remainder to 1 belongs to unknown classes."""
    values = np.array([*log_odds.values(), PRIOR])
    weights = np.exp(values - values.max())
    scores = (weights / weights.sum()).tolist()
    return sorted(zip(log_odds, scores, strict=False), key=lambda item: (-item[1], item[0]))


def chosen_name(classes: Sequence[tuple[str, float]]) -> Named:
    """Return the name of an object, if one class is likely enough, and the next likely classes.

    Parameters
    ----------
    classes : sequence of (str, float)
        Classes with their probabilities, most likely first.
    """
    scores = [item for item in classes if round(item[1], NAME_DIGITS) > 0.0]
    if not scores or scores[0][1] < MIN_NAME_SCORE:
        return Named(name=None, name_score=None, names=tuple(scores[:NEXT_NAMES]))
    (name, score), *rest = scores
    return Named(name=name, name_score=score, names=tuple(rest[:NEXT_NAMES]))


def score_gain(score: float) -> float:
    """Return the log-odds that a class gains from its score in a sighting."""
    bounded = min(max(score, MIN_CLASS_SCORE), MAX_SCORE)
    return max(_logit(bounded) - _logit(NEUTRAL_SCORE), -MISSED)


def _logit(score: float) -> float:
    return math.log(score / (1.0 - score))


def _likely(log_odds: Mapping[str, float]) -> dict[str, float]:
    """Return the most likely classes, best first."""
    order = sorted(log_odds, key=lambda name: (-log_odds[name], name))
    return {name: log_odds[name] for name in order[:MAX_CLASSES]}


def counted_view(views: Float64Array, toward: Float64Array) -> tuple[Float64Array, float]:
    """Count a sighting from a direction; return all directions (V, 4), and its weight: 1/n for the n-th one.

    Parameters
    ----------
    views : (V, 4) float64
        Directions so far (unit vectors), with the number of times for each.
    toward : (3,) float64
        From the object to the camera, any length.
    """
    direction = toward / max(float(np.linalg.norm(toward)), 1e-9)
    if len(views):
        cosine = views[:, :3] @ direction
        nearest = int(cosine.argmax())
        if cosine[nearest] >= math.cos(SAME_VIEW_RAD) or len(views) >= MAX_DIRECTIONS:
            counted = views.copy()
            counted[nearest, 3] += 1.0
            return counted, float(1.0 / counted[nearest, 3])
    return np.vstack([views, [*direction, 1.0]]), 1.0
