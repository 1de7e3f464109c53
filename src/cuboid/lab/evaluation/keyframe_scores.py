"""Figures over all keyframes: recall, precision, labels over time, and the recall of each stage of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.evaluation.average_precision import average_precision
from cuboid.lab.evaluation.clear import clear
from cuboid.lab.evaluation.funnel import NO_RECTS, Stage
from cuboid.lab.evaluation.keyframes import DrawnObject, Keyframe
from cuboid.lab.evaluation.matching import FrameOverlap, ratio
from cuboid.lab.evaluation.rectangles import BoolArray, FrameJudgement, Outcome, judge_frame
from cuboid.lab.evaluation.reliability import NO_OBJECT, Reliability, reliability, right_labels
from cuboid.lab.evaluation.result import IntArray, RectRows

# IoU thresholds; the first one is reported first, and is used for pictures and tables.
THRESHOLDS = (0.5, 0.25)
# Outcomes of sightings that count neither way.
ASIDE = (Outcome.IGNORED, Outcome.HARDLY_VISIBLE, Outcome.IN_GROUP)


@dataclass(frozen=True, slots=True)
class JudgedFrame:
    """A frame with its annotations and results.

    Attributes
    ----------
    keyframe : Keyframe
    sightings : RectRows
        Labelled rectangles of the result in the frame.
    probability : (P,) float64
        Probability of each sighting; NaN where the result gives none.
    at : tuple of FrameJudgement
        Judgements of the sightings, one per threshold.
    stages : mapping of str to (G,) bool
        Drawn rectangles that each available stage has at the first threshold, by the stage's short name.
    """

    keyframe: Keyframe
    sightings: RectRows
    probability: Float64Array
    at: tuple[FrameJudgement, ...]
    stages: Mapping[str, BoolArray]


@dataclass(frozen=True, slots=True)
class ScoresAt:
    """The scores of the labelled sightings at one IoU.

    Attributes
    ----------
    threshold : float
    recall, precision : float or None
        found / rectangles; found / (found + false). None if the denominator is 0.
    rectangles, found : int
        Drawn rectangles that count, and found ones among them.
    false : int
        Sightings that pair with no drawn rectangle.
    neither : mapping of str to int
        Sightings that count neither way, by reason.
    objects, objects_found : int
        Objects with a rectangle that counts; those found in one frame or more.
    one_label : float or None
        Fraction of pairs with the object's most frequent label, over objects found more than once.
    idf1 : float or None
        IDF1 for the best one-to-one pairing of objects with labels (Ristani et al., ECCV workshops 2016).
    ap : float or None
        Average precision of the sightings, ranked by probability; None without objects or without probabilities.
    reliability : Reliability
        Reliability of the probability of the labels with a true or false sighting.
    """

    threshold: float
    recall: float | None
    precision: float | None
    rectangles: int
    found: int
    false: int
    neither: Mapping[str, int]
    objects: int
    objects_found: int
    one_label: float | None
    idf1: float | None
    ap: float | None
    reliability: Reliability


@dataclass(frozen=True, slots=True)
class RecallAt:
    """Number of drawn rectangles that a stage has at one IoU threshold."""

    threshold: float
    found: int
    recall: float | None


@dataclass(frozen=True, slots=True)
class StageRecall:
    """The drawn rectangles that a stage of a run has.

    Attributes
    ----------
    name, short : str
    per_frame : float or None
        Mean number of the stage's rectangles per judged frame.
    at : tuple of RecallAt
        Recall at each threshold; empty if the rectangles are not available.
    reason : str
        Reason why they are not available.
    """

    name: str
    short: str
    per_frame: float | None
    at: tuple[RecallAt, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class DrawnOutcome:
    """The scores of one object, at the first threshold.

    Attributes
    ----------
    id : int
    name : str
    group : bool
    rectangles : int
        Number of drawn rectangles that count.
    stages : mapping of str to int
        Number of these that each available stage has, by the stage's short name.
    labels : tuple of int
        Labels of the sightings that found the object, in order.
    """

    id: int
    name: str
    group: bool
    rectangles: int
    stages: Mapping[str, int]
    labels: tuple[int, ...]


def judge(
    keyframes: Sequence[Keyframe], sightings: RectRows, probability: Float64Array, stages: Sequence[Stage]
) -> tuple[tuple[JudgedFrame, ...], tuple[StageRecall, ...]]:
    """Judge the sightings (N,) of each keyframe, with their probability (N,), and the rectangles of each stage."""
    judged = [_judge_stage(stage, keyframes) for stage in stages]
    frames = []
    for t, keyframe in enumerate(keyframes):
        in_frame = sightings.frame == keyframe.frame
        rows = RectRows(sightings.frame[in_frame], sightings.label[in_frame], sightings.rects_xyxy[in_frame])
        reached = {stage.short: of[0][t].found for stage, of in zip(stages, judged, strict=True) if of}
        at = tuple(judge_frame(keyframe, rows.rects_xyxy, threshold) for threshold in THRESHOLDS)
        frames.append(JudgedFrame(keyframe, rows, probability[in_frame], at, reached))
    return tuple(frames), tuple(_recall(stage, of, keyframes) for stage, of in zip(stages, judged, strict=True))


def _judge_stage(stage: Stage, keyframes: Sequence[Keyframe]) -> list[list[FrameJudgement]]:
    """Return the judgements of all frames for each threshold; none if the stage is not available."""
    rects = stage.rects_xyxy
    if rects is None:
        return []
    return [[judge_frame(item, rects.get(item.frame, NO_RECTS), t) for item in keyframes] for t in THRESHOLDS]


def _recall(stage: Stage, judged: Sequence[Sequence[FrameJudgement]], keyframes: Sequence[Keyframe]) -> StageRecall:
    if stage.rects_xyxy is None:
        return StageRecall(stage.name, stage.short, None, (), stage.reason)
    at = []
    for threshold, frames in zip(THRESHOLDS, judged, strict=True):
        found = sum(int(frame.found.sum()) for frame in frames)
        at.append(RecallAt(threshold, found, ratio(found, sum(int(frame.counts.sum()) for frame in frames))))
    rects = sum(len(stage.rects_xyxy.get(item.frame, NO_RECTS)) for item in keyframes)
    return StageRecall(stage.name, stage.short, ratio(rects, len(keyframes)), tuple(at), "")


def scores_at(frames: Sequence[JudgedFrame], k: int, probability: Mapping[int, float]) -> ScoresAt:
    """Return the figures at threshold number `k`; `probability` is that of each label."""
    at = [frame.at[k] for frame in frames]
    outcomes = Counter(outcome for judgement in at for outcome in judgement.outcomes)
    rectangles, found = sum(int(one.counts.sum()) for one in at), sum(int(one.found.sum()) for one in at)
    false = outcomes[Outcome.FALSE]
    labels = _labels(frames, k)
    repeated = [found_labels for found_labels in labels.values() if len(found_labels) > 1]
    return ScoresAt(
        threshold=THRESHOLDS[k],
        recall=ratio(found, rectangles),
        precision=ratio(found, found + false),
        rectangles=rectangles,
        found=found,
        false=false,
        neither={outcome.value: outcomes[outcome] for outcome in ASIDE},
        objects=len(labels),
        objects_found=sum(len(found_labels) > 0 for found_labels in labels.values()),
        one_label=ratio(sum(max(Counter(found_labels).values()) for found_labels in repeated), sum(map(len, repeated))),
        idf1=_idf1(frames, k),
        ap=_average_precision(frames, k, rectangles),
        reliability=reliability(right_labels(*_labels_and_objects(frames, k)), probability),
    )


def ranking(frames: Sequence[JudgedFrame], k: int) -> tuple[Float64Array, BoolArray]:
    """Return probability (N,), NaN where unknown, and rightness (N,) of all true and false sightings."""
    rows = [
        (p, outcome is Outcome.TRUE)
        for frame in frames
        for p, outcome in zip(frame.probability.tolist(), frame.at[k].outcomes, strict=True)
        if outcome not in ASIDE
    ]
    return np.array([p for p, _ in rows], np.float64), np.array([right for _, right in rows], bool)


def _average_precision(frames: Sequence[JudgedFrame], k: int, rectangles: int) -> float | None:
    probability, right = ranking(frames, k)
    unranked = len(probability) > 0 and bool(np.isnan(probability).all())
    return None if unranked else average_precision(probability, right, rectangles)


def _labels_and_objects(frames: Sequence[JudgedFrame], k: int) -> tuple[IntArray, IntArray]:
    """Return label (N,) and object (N,), or `NO_OBJECT`, of all true and false sightings."""
    label: list[int] = []
    item: list[int] = []
    for frame in frames:
        pairs = zip(frame.at[k].partner.tolist(), frame.keyframe.drawn, strict=True)
        object_of = {partner: drawn.id for partner, drawn in pairs}
        for n, outcome in enumerate(frame.at[k].outcomes):
            if outcome not in ASIDE:
                label.append(int(frame.sightings.label[n]))
                item.append(object_of.get(n, NO_OBJECT))
    return np.array(label, np.int64), np.array(item, np.int64)


def _labels(frames: Sequence[JudgedFrame], k: int) -> dict[int, list[int]]:
    """Return the found labels, frame by frame, of each object with a rectangle that counts."""
    labels: dict[int, list[int]] = {}
    for frame in frames:
        for drawn, counts, partner in zip(frame.keyframe.drawn, frame.at[k].counts, frame.at[k].partner, strict=True):
            if counts:
                found_labels = labels.setdefault(drawn.id, [])
                if partner >= 0:
                    found_labels.append(int(frame.sightings.label[partner]))
    return labels


def _idf1(frames: Sequence[JudgedFrame], k: int) -> float | None:
    """Return IDF1 over rectangles that are visible enough, and sightings that are true or false."""
    ids = {name: i for i, name in enumerate(sorted({drawn.id for frame in frames for drawn in frame.keyframe.drawn}))}
    names = np.unique([label for frame in frames for label in frame.sightings.label])
    overlaps = []
    for frame in frames:
        at = frame.at[k]
        judged = [n for n, outcome in enumerate(at.outcomes) if outcome not in ASIDE]
        items = np.array([ids[drawn.id] for drawn in frame.keyframe.drawn], np.int64)[at.counts]
        label = np.searchsorted(names, frame.sightings.label[judged])
        overlaps.append(FrameOverlap(frame.keyframe.frame, items, label, at.iou[at.counts][:, judged]))
    return clear(overlaps, [[] for _ in overlaps], THRESHOLDS[k]).idf1


def outcomes_of(objects: Sequence[DrawnObject], frames: Sequence[JudgedFrame]) -> tuple[DrawnOutcome, ...]:
    """Return the outcome of each object with a rectangle that counts."""
    labels = _labels(frames, 0)
    stages = frames[0].stages
    outcomes = []
    for item in objects:
        drawn = [(frame, i, rect.id) for frame in frames for i, rect in enumerate(frame.keyframe.drawn)]
        places = [(frame, i) for frame, i, identity in drawn if identity == item.id and frame.at[0].counts[i]]
        if places:
            found_at = {short: sum(int(frame.stages[short][i]) for frame, i in places) for short in stages}
            shown = tuple(dict.fromkeys(labels[item.id]))
            group = any(frame.keyframe.drawn[i].group for frame, i in places)
            outcomes.append(DrawnOutcome(item.id, item.name, group, len(places), found_at, shown))
    return tuple(outcomes)
