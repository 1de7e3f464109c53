"""Names of objects: class scores of a detector, added up over sightings as log-odds.

A detector errs, and frames from one place err alike. So the n-th sighting from one direction counts 1/n of the first,
and each counts by how much of the object is seen. A class gains by scores above a neutral one and loses by lower ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Protocol, TypedDict

import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float32Array, Float64Array
from cuboid.core.results import NEXT_NAMES
from cuboid.detection.types import Detections
from cuboid.geometry.rectangles import fractions_inside, rect_iou_matrix
from cuboid.objects.entry import MapObject

# A detection shows an object when their rectangles overlap by this IoU: the same thing for people who judge detectors.
SAME_IOU = 0.5
# With more than this fraction of its rectangle in a detection of something larger, an object may be a part of that: it
# is then no evidence that the detector sees nothing else there.
INSIDE_FRACTION = 0.5
# Scores below this are not taken for a class at all: what detectors list begins here.
LEAST_SCORE = 0.05
# A score that says nothing for or against a class. What is not in the vocabulary gets scores around it in view after
# view (a lunch box as a cell phone: 0.08 to 0.4), what is gets more: mice 0.13 to 0.4, screens and books 0.8 to 0.9.
NEUTRAL_SCORE = 0.15
# Scores are taken as no surer than this.
MOST_SCORE = 0.99
# Log-odds that a class loses at most in a sighting: a small detector misses two of three things.
MISSED = 0.3
# Log-odds of "none that is known" before the first look.
PRIOR = 1.0
# Two directions are one while they are no farther apart than this, radians: a smaller turn shows the same side.
SAME_VIEW_RAD = 0.2
# Directions that are kept for an object: all around it there are some hundred at this angle, few are seen.
MAX_VIEWS = 64
# Classes that are kept for an object, the most likely ones.
MAX_CLASSES = 16
# A name is told when it is more likely than all others and none together.
MIN_NAME_SCORE = 0.5
# Classes whose probability is 0 with so many decimals are not told.
NAME_DIGITS = 2


class Nameable(Protocol):
    """Something that a detector names; attributes as of `MapObject`."""

    name_log_odds: dict[str, float]
    views: Float64Array

    @property
    def center(self) -> Float64Array:
        """Its middle in the map, (3,) metres."""


class Named(TypedDict):
    """What results say of an object's name; see `TrackedObject`."""

    name: str | None
    name_score: float | None
    names: tuple[tuple[str, float], ...]


def match_detections(found: Detections, rects_xyxy: Float64Array) -> npt.NDArray[np.intp]:
    """Return which object each detection shows, (N,), -1 none: the one whose rectangle overlaps it most, and enough.

    Parameters
    ----------
    found : Detections
    rects_xyxy : (M, 4) float64
        Of the objects in view, pixels.
    """
    if not len(found) or not len(rects_xyxy):
        return np.full(len(found), -1, np.intp)
    iou = rect_iou_matrix(found.boxes_xyxy.astype(np.float64), rects_xyxy)
    return np.where(iou.max(axis=1) >= SAME_IOU, iou.argmax(axis=1), -1)


def name_objects(found: Detections, seen: Sequence[tuple[MapObject, float, Float64Array]], eye: Float64Array) -> None:
    """Add what a detector sees in a frame to the evidence on names.

    Parameters
    ----------
    found : Detections
        Of the frame.
    seen : sequence of (MapObject, float, (4,) float64)
        The objects that the frame shows, visible fraction and rectangle of each.
    eye : (3,) float64
        Where the camera is, in the map.
    """
    rects = np.array([rect for _, _, rect in seen]).reshape(-1, 4)
    partner = match_detections(found, rects)
    inside = fractions_inside(rects, found.boxes_xyxy.astype(np.float64)).max(axis=1, initial=0.0)
    for k, (entry, visible, _) in enumerate(seen):
        likely = likely_classes(found.names, found.scores[partner == k].max(axis=0, initial=0.0))
        if likely or inside[k] <= INSIDE_FRACTION:
            add_evidence(entry, likely, visible, eye)


def likely_classes(names: Sequence[str], scores: Float32Array) -> dict[str, float]:
    """Return the classes that a detector lists, by scores (C,); the empty name is of no class."""
    return {names[c]: float(scores[c]) for c in np.flatnonzero(scores >= LEAST_SCORE).tolist() if names[c]}


def add_evidence(entry: Nameable, scores: Mapping[str, float], visible: float, eye: Float64Array) -> float:
    """Add a detector's scores for one object, none where it sees nothing there, to the evidence on its name.

    Returns how much the sighting counts, 0..1.

    Parameters
    ----------
    entry : MapObject
    scores : mapping of str to float
        By class, `LEAST_SCORE` and more; of other classes the detector sees nothing.
    visible : float
        Fraction of the object that is seen.
    eye : (3,) float64
        Where the camera is, in the map.
    """
    weight, before = visible * novelty(entry, eye), entry.name_log_odds
    entry.name_log_odds = _likely(
        {
            name: before.get(name, 0.0) + weight * score_gain(scores.get(name, 0.0))
            for name in sorted({*before, *scores})
        }
    )
    return weight


def merged_evidence(one: Mapping[str, float], other: Mapping[str, float]) -> dict[str, float]:
    """Return the evidence on the name of an object that was taken for two."""
    return _likely({name: one.get(name, 0.0) + other.get(name, 0.0) for name in sorted({*one, *other})})


def name_scores(log_odds: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return classes with their probabilities, the most likely first; the rest to 1 is that of none that is known."""
    values = np.array([*log_odds.values(), PRIOR])
    weights = np.exp(values - values.max())
    scores = (weights / weights.sum()).tolist()
    return sorted(zip(log_odds, scores, strict=False), key=lambda one: (-one[1], one[0]))


def chosen_name(classes: Sequence[tuple[str, float]]) -> Named:
    """Return the name of an object, where one class is likely enough, and the next likely ones.

    Parameters
    ----------
    classes : sequence of (str, float)
        With their probabilities, the most likely first.
    """
    scores = [one for one in classes if round(one[1], NAME_DIGITS) > 0.0]
    if not scores or scores[0][1] < MIN_NAME_SCORE:
        return Named(name=None, name_score=None, names=tuple(scores[:NEXT_NAMES]))
    (name, score), *rest = scores
    return Named(name=name, name_score=score, names=tuple(rest[:NEXT_NAMES]))


def score_gain(score: float) -> float:
    """Return the log-odds that a class gains by its score in a sighting."""
    bounded = min(max(score, LEAST_SCORE), MOST_SCORE)
    return max(_logit(bounded) - _logit(NEUTRAL_SCORE), -MISSED)


def _logit(score: float) -> float:
    return math.log(score / (1.0 - score))


def _likely(log_odds: Mapping[str, float]) -> dict[str, float]:
    """Return the most likely classes, the best first."""
    order = sorted(log_odds, key=lambda name: (-log_odds[name], name))
    return {name: log_odds[name] for name in order[:MAX_CLASSES]}


def novelty(entry: Nameable, eye: Float64Array) -> float:
    """Return how much a sighting from `eye` counts, 1/n for the n-th from one direction; the object remembers it."""
    toward = eye - entry.center
    direction = toward / max(float(np.linalg.norm(toward)), 1e-9)
    views = entry.views
    if len(views):
        cosine = views[:, :3] @ direction
        nearest = int(cosine.argmax())
        if cosine[nearest] >= math.cos(SAME_VIEW_RAD) or len(views) >= MAX_VIEWS:
            counted = views.copy()
            counted[nearest, 3] += 1.0
            entry.views = counted
            return float(1.0 / counted[nearest, 3])
    entry.views = np.vstack([views, [*direction, 1.0]])
    return 1.0
