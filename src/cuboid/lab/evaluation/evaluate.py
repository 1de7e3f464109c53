"""Evaluation of a result against ground truth, with all metrics that both allow."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.geometry.se3 import transform
from cuboid.lab.evaluation.alignment import in_world_of
from cuboid.lab.evaluation.boxes import (
    THRESHOLDS,
    MapQuality,
    ObjectBox,
    ProposalQuality,
    map_quality,
    proposal_quality,
)
from cuboid.lab.evaluation.clear import Clear, Pairs, clear, correspondences
from cuboid.lab.evaluation.events import EventQuality, event_quality, labels_on_agents, objects_of_labels
from cuboid.lab.evaluation.hota import Hota, hota
from cuboid.lab.evaluation.labels import (
    ObjectLabels,
    Reidentification,
    consistency,
    object_labels,
    purity,
    reidentification,
    timelines,
)
from cuboid.lab.evaluation.matching import FrameOverlap
from cuboid.lab.evaluation.names import NameQuality, name_quality
from cuboid.lab.evaluation.points import HeatQuality, heat_quality, read_labelled_cloud
from cuboid.lab.evaluation.relations import RelationsAt, relation_quality
from cuboid.lab.evaluation.reliability import NO_OBJECT, Reliability, reliability, right_labels
from cuboid.lab.evaluation.result import BoxRows, IntArray, Result, read_result
from cuboid.lab.evaluation.scope import FOUND_IOU, Scope
from cuboid.lab.evaluation.truth import Truth, read_truth
from cuboid.results.files import Results, read_map
from cuboid.results.files.text import plain

FORMAT, VERSION = "cuboid-evaluation", 1


@dataclass(frozen=True, slots=True)
class Identity:
    """Quality of labels over time.

    Attributes
    ----------
    hota : Hota
    at : tuple of Clear
        CLEAR MOT and IDF1 at IoU 0.25 and 0.5.
    reidentification : tuple of Reidentification
        Re-identification by length of absence.
    label_purity, label_consistency : float or None
        Fraction of sightings whose label belongs mostly to their object; fraction with their object's most frequent
        label.
    labels_per_object : float or None
        Mean number of labels over the objects that were found.
    median_frames_to_first_label : float or None
        Median over the objects that were found.
    reliability : tuple of Reliability
        Reliability of the probability of labels at IoU 0.25 and 0.5.
    """

    hota: Hota
    at: tuple[Clear, ...]
    reidentification: tuple[Reidentification, ...]
    label_purity: float | None
    label_consistency: float | None
    labels_per_object: float | None
    median_frames_to_first_label: float | None
    reliability: tuple[Reliability, ...]


@dataclass(frozen=True, slots=True)
class ObjectOutcome:
    """The scores of one judged object.

    Attributes
    ----------
    id : int
    name : str
    box : ObjectBox or None
        Box of the object in the map; None if no box has an IoU of 0.25 or more with it.
    labels : ObjectLabels or None
        None if the truth has no visibility.
    """

    id: int
    name: str
    box: ObjectBox | None
    labels: ObjectLabels | None


@dataclass(frozen=True, slots=True)
class Evaluation:
    """All results of `evaluate`.

    Attributes
    ----------
    result, truth : str
        Paths of the compared files.
    frames_judged, frames_skipped : int
        Number of judged frames, and of frames that the tracker got but could not use.
    map : MapQuality
    identity : Identity or None
        None if the truth has no visibility.
    proposals : ProposalQuality or None
        None if the truth has no visibility, or if the result has no boxes of single frames.
    objects : tuple of ObjectOutcome
        Judged objects, by id.
    heat : HeatQuality or None
        None without a labelled cloud.
    names : NameQuality or None
        None if no detector named objects.
    events : EventQuality or None
        None if the truth has no events or no visibility.
    relations : tuple of RelationsAt or None
        Scores of each kind of relation; None if the truth has no relations, or if the result is no folder of `cuboid
        track`.
    """

    result: str
    truth: str
    frames_judged: int
    frames_skipped: int
    map: MapQuality
    identity: Identity | None
    proposals: ProposalQuality | None
    objects: tuple[ObjectOutcome, ...]
    heat: HeatQuality | None
    names: NameQuality | None = None
    events: EventQuality | None = None
    relations: tuple[RelationsAt, ...] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return everything, ready for JSON: numbers have six decimals, undefined values are None."""
        optional = ("names", "events", "relations")
        document = {name: value for name, value in asdict(self).items() if value is not None or name not in optional}
        return {"format": FORMAT, "version": VERSION, **plain(document)}


def evaluate(
    result: Result | PathLike,
    truth: Truth | PathLike,
    *,
    cloud: PathLike | None = None,
    trajectory: PathLike | None = None,
) -> Evaluation:
    """Evaluate a result against ground truth.

    Parameters
    ----------
    result : Result or path
        A result folder, or a CSV with the boxes of any other tracker.
    truth : Truth or path
        A truth file, or a folder with a `truth.json`.
    cloud : path, optional
        A labelled point cloud, to evaluate the heat of the map.
    trajectory : path, optional
        True camera poses in the TUM format, to align the result with the world of the truth. If the result's poses were
        estimated, a `true_trajectory.txt` beside the truth is used by default.

    Raises
    ------
    InputError
        A file cannot be used, or result and truth are of different recordings.
    """
    result = result if isinstance(result, Result) else read_result(result)
    truth = truth if isinstance(truth, Truth) else read_truth(truth)
    result = in_world_of(result, truth.path, None if trajectory is None else as_path(trajectory))
    frames = _judged_frames(result, truth)
    scope = Scope(truth, frames)
    quality, boxes = map_quality(scope, result.objects)
    label_of = {item.id: box.label for item, box in zip(scope.objects, boxes, strict=True) if box is not None}
    labels: list[ObjectLabels | None] = [None] * len(boxes)
    identity, proposals, events = None, None, None
    if scope.shown is not None:
        overlaps = scope.frame_overlaps(result.tracks)
        pairs = {threshold: correspondences(overlaps, threshold) for threshold in THRESHOLDS}
        events = None if truth.events is None else _events(scope, truth, result, overlaps, pairs[FOUND_IOU])
        identity, labels[:] = _identity(scope, result, overlaps, pairs)
        proposals = _proposals(scope, result.proposals)
    return Evaluation(
        result=str(result.path),
        truth=truth.name,
        frames_judged=len(frames),
        frames_skipped=result.skipped,
        map=quality,
        identity=identity,
        proposals=proposals,
        objects=tuple(
            ObjectOutcome(item.id, item.name, box, item_labels)
            for item, box, item_labels in zip(scope.objects, boxes, labels, strict=True)
        ),
        heat=None if cloud is None else _heat(result, cloud, truth),
        names=name_quality(result.path, [(item.id, item.name, label_of.get(item.id)) for item in scope.objects]),
        events=events,
        relations=_relations(result, truth, label_of),
    )


def _judged_frames(result: Result, truth: Truth) -> IntArray:
    """Return the frames that the tracker used, or all frames of the truth if the result does not list them."""
    frame_count = truth.frames
    if result.frames is not None:
        frames = result.frames
    elif frame_count is not None:
        frames = np.arange(frame_count)
    else:
        frames = np.unique(result.tracks.frame)
    last = max(frames.max(initial=-1), result.tracks.frame.max(initial=-1))
    if frame_count is not None and last >= frame_count:
        raise InputError(f"{result.path}: has frame {last}, but {truth.path} is of a recording of {frame_count} frames")
    return frames


def _identity(
    scope: Scope, result: Result, frames: Sequence[FrameOverlap], pairs: Mapping[float, Sequence[Pairs]]
) -> tuple[Identity, list[ObjectLabels]]:
    names = np.unique(result.tracks.label)
    lines = timelines(frames, pairs[FOUND_IOU], len(scope.objects), names)
    labels = object_labels(lines)
    found = [item for item in labels if item.labels]
    waits = [item.frames_to_first_label for item in found if item.frames_to_first_label is not None]
    identity = Identity(
        hota=hota(frames, len(scope.objects), len(names)),
        at=tuple(clear(frames, pairs[threshold], threshold) for threshold in THRESHOLDS),
        reidentification=reidentification(lines),
        label_purity=purity(lines),
        label_consistency=consistency(lines),
        labels_per_object=float(np.mean([len(item.labels) for item in found])) if found else None,
        median_frames_to_first_label=float(np.median(waits)) if waits else None,
        reliability=tuple(
            reliability(right_labels(*_labels_and_objects(frames, pairs[threshold], names)), result.probability)
            for threshold in THRESHOLDS
        ),
    )
    return identity, labels


def _labels_and_objects(
    frames: Sequence[FrameOverlap], pairs: Sequence[Pairs], names: IntArray
) -> tuple[IntArray, IntArray]:
    """Return label (N,) and object (N,), or `NO_OBJECT`, of all judged sightings."""
    rows = []
    for frame, frame_pairs in zip(frames, pairs, strict=True):
        object_of = {number: item for item, number in frame_pairs}
        rows += [(names[number], object_of.get(number, NO_OBJECT)) for number in frame.found.tolist()]
    label, item = np.array(rows, np.int64).reshape(-1, 2).T
    return label, item


def _events(
    scope: Scope, truth: Truth, result: Result, frames: Sequence[FrameOverlap], pairs: Sequence[Pairs]
) -> EventQuality:
    tracks, names = result.tracks, np.unique(result.tracks.label).tolist()
    ids = [item.id for item in scope.objects]
    objects = {names[k]: number for k, number in objects_of_labels(frames, pairs, ids).items()}
    counted = {names[k] for frame in frames for k in frame.found.tolist()}
    paired = Counter(names[label] for frame_pairs in pairs for _, label in frame_pairs)
    aside = [label for label in names if label not in counted]
    quality = event_quality(truth, objects, aside, result.events)
    return replace(quality, agent_labels=labels_on_agents(truth, tracks, scope.frames, paired))


def _proposals(scope: Scope, rows: BoxRows | None) -> ProposalQuality | None:
    if rows is None:
        return None
    return proposal_quality(scope.frame_overlaps(rows), int(np.isin(rows.frame, scope.frames).sum()))


def _relations(result: Result, truth: Truth, label_of: dict[int, int]) -> tuple[RelationsAt, ...] | None:
    if truth.relations is None or not result.path.is_dir():
        return None
    run = Results(result.path)
    return relation_quality(truth, run.relations, label_of, run.planes, run.walls, result.T_truth_result)


def _heat(result: Result, cloud: PathLike, truth: Truth) -> HeatQuality:
    if result.map_points is None:
        raise InputError(f"{result.path}: has no point map to compare with {cloud}")
    points = read_map(result.map_points)
    xyz = transform(result.T_truth_result, points.xyz)
    return heat_quality(xyz, points.heat, read_labelled_cloud(cloud), truth)
