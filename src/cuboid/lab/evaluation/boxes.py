"""Evaluation of the final map of objects, and of the boxes of single frames, against the true objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.overlap import overlap_min_matrix
from cuboid.lab.evaluation.average_precision import average_precision
from cuboid.lab.evaluation.matching import FrameOverlap, match, ratio
from cuboid.lab.evaluation.result import MapBoxes
from cuboid.lab.evaluation.scope import FOUND_IOU, BoolArray, Scope, counted

THRESHOLDS = (0.25, 0.5)
# Minimum common fraction of the smaller of two boxes for a box and an object to belong together. Hoover et al. 1996
# require a tolerance above 0.5 to compare regions; at 0.5 each box has one object.
MIN_COMMON_FRACTION = 0.5
_ORDERS = tuple(permutations(range(3)))


@dataclass(frozen=True, slots=True)
class MapAt:
    """The map at one IoU threshold.

    Attributes
    ----------
    threshold : float
        Minimum IoU of a pair.
    found, missed, wrong : int
        Objects paired with a box, objects without a box, boxes without an object.
    precision, recall, f1 : float or None
        None where nothing is judged.
    ap : float or None
        Average precision, with the boxes ranked by score.
    mean_iou, center_error_cm, size_error_cm : float or None
        Means over the pairs.
    """

    threshold: float
    found: int
    missed: int
    wrong: int
    precision: float | None
    recall: float | None
    f1: float | None
    ap: float | None
    mean_iou: float | None
    center_error_cm: float | None
    size_error_cm: float | None


@dataclass(frozen=True, slots=True)
class ObjectBox:
    """The box that an object has in the map.

    Attributes
    ----------
    label : int
    iou, center_error_cm, size_error_cm : float
    """

    label: int
    iou: float
    center_error_cm: float
    size_error_cm: float


@dataclass(frozen=True, slots=True)
class MapQuality:
    """Quality of the map of objects.

    Attributes
    ----------
    objects : int
        Number of objects to be found.
    boxes : int
        Number of boxes in the map, including those that count neither way ("3D proposals a scene" of Pahwa et al.
        2017).
    counted : int
        Number of boxes that are judged.
    at : tuple of MapAt
        Scores at each of `THRESHOLDS`.
    fragments : int
        Additional boxes of objects that have more than one.
    merges : int
        Additional objects in boxes that contain more than one.
    false_alarms : int
        Judged boxes that lie on no object at all.
    wrong_labels : tuple of int
        Labels of the judged boxes that pair with no object at IoU 0.25.
    """

    objects: int
    boxes: int
    counted: int
    at: tuple[MapAt, ...]
    fragments: int
    merges: int
    false_alarms: int
    wrong_labels: tuple[int, ...]


def map_quality(scope: Scope, found: MapBoxes) -> tuple[MapQuality, list[ObjectBox | None]]:
    """Compare the map with the truth.

    Returns
    -------
    MapQuality
    list of ObjectBox or None
        For each judged object its box at IoU 0.25 or more.
    """
    must = scope.must_map()
    lie = scope.boxes(found.boxes)
    counts = counted(lie.iou[:, must].T, lie.left_out | lie.on_judged[:, ~must].any(1))
    boxes, truth, iou = found.boxes[counts], scope.packed[must], lie.iou[counts][:, must]
    score = found.score[counts]
    center, size = center_errors(boxes, truth), size_errors(boxes, truth)
    fragments, merges, alarms = fragments_and_merges(boxes, truth, iou)
    labels, pairs = found.label[counts], match(iou, FOUND_IOU)
    quality = MapQuality(
        objects=int(must.sum()),
        boxes=len(found.label),
        counted=int(counts.sum()),
        at=tuple(_map_at(threshold, iou, score, center, size) for threshold in THRESHOLDS),
        fragments=fragments,
        merges=merges,
        false_alarms=alarms,
        wrong_labels=tuple(np.delete(labels, [i for i, _ in pairs]).tolist()),
    )
    of_object: list[ObjectBox | None] = [None] * len(must)
    for i, j in pairs:
        of_object[int(np.flatnonzero(must)[j])] = ObjectBox(
            int(labels[i]), float(iou[i, j]), float(center[i, j]), float(size[i, j])
        )
    return quality, of_object


def _map_at(
    threshold: float, iou: Float64Array, score: Float64Array, center: Float64Array, size: Float64Array
) -> MapAt:
    pairs = match(iou, threshold)
    hits, (boxes, objects) = len(pairs), iou.shape
    i, j = np.array(pairs, np.int64).reshape(-1, 2).T
    return MapAt(
        threshold=threshold,
        found=hits,
        missed=objects - hits,
        wrong=boxes - hits,
        precision=ratio(hits, boxes),
        recall=ratio(hits, objects),
        f1=ratio(2 * hits, boxes + objects),
        ap=average_precision(score, hits_by_score(iou, score, threshold), objects),
        mean_iou=ratio(iou[i, j].sum(), hits),
        center_error_cm=ratio(center[i, j].sum(), hits),
        size_error_cm=ratio(size[i, j].sum(), hits),
    )


def hits_by_score(iou: Float64Array, score: Float64Array, threshold: float) -> BoolArray:
    """Return which boxes find an object, (N,), where the boxes choose in the order of falling score.

    Each box is matched with the unmatched object that it overlaps most, if their IoU is at least `threshold` (Lin et
    al., ECCV 2014).

    Parameters
    ----------
    iou : (N, G) float64
    score : (N,) float64
    threshold : float
    """
    hit = np.zeros(len(iou), bool)
    if iou.shape[1] == 0:
        return hit
    order = np.argsort(-score, kind="stable")
    free = np.ones(iou.shape[1], bool)
    for box in order:
        open_iou = np.where(free, iou[box], -1.0)
        best = int(open_iou.argmax())
        if open_iou[best] >= threshold:
            hit[box], free[best] = True, False
    return hit


def center_errors(boxes: Float64Array, truth: Float64Array) -> Float64Array:
    """Return the distances (N, G) between centres in centimetres."""
    return np.asarray(np.linalg.norm(boxes[:, None, :3] - truth[None, :, :3], axis=2) * 100.0)


def size_errors(boxes: Float64Array, truth: Float64Array) -> Float64Array:
    """Return the mean differences (N, G) of the three side lengths in centimetres.

    Sides are compared along the best-matching axes, since length and width of a box may be exchanged.
    """
    axes, true_axes = boxes[:, 6:].reshape(-1, 3, 3), truth[:, 6:].reshape(-1, 3, 3)
    agree = np.abs(np.einsum("nai,gaj->ngij", axes, true_axes))  # i: axis of the box, j: of the object
    rows = np.arange(3)
    fit = np.stack([agree[..., rows, order].sum(-1) for order in _ORDERS], axis=-1)
    sides = np.stack([truth[:, 3:6][:, order] for order in _ORDERS])  # (6, G, 3)
    chosen = sides[fit.argmax(-1), np.arange(len(truth))]
    return np.asarray(np.abs(boxes[:, None, 3:6] - chosen).mean(-1) * 100.0)


def fragments_and_merges(boxes: Float64Array, truth: Float64Array, iou: Float64Array) -> tuple[int, int, int]:
    """Return fragments, merges and false alarms among judged boxes (N, 15), with truth (M, 15) and IoU (N, M).

    A box and an object belong together if they share at least half of the smaller one. Fragments are additional boxes
    of an object, where each box is counted with the object that it overlaps most. Merges are additional objects of
    which a box contains at least half. A box that belongs to no object is a false alarm. After over- and
    under-segmentation and noise in Hoover et al., "An Experimental Comparison of Range Image Segmentation Algorithms",
    PAMI 1996.
    """
    if not (len(boxes) and len(truth)):
        return 0, 0, len(boxes)
    together = (overlap_min_matrix(boxes, truth) >= MIN_COMMON_FRACTION) | (iou >= FOUND_IOU)
    on_object = together.any(1)
    best = np.where(together, iou, -1.0).argmax(1)[on_object]
    per_object = np.bincount(best, minlength=len(truth))
    volume, true_volume = boxes[:, 3:6].prod(1)[:, None], truth[:, 3:6].prod(1)[None]
    common = iou / (1.0 + iou) * (volume + true_volume)  # iou = common / (volume + true_volume - common)
    objects_in_box = (common >= MIN_COMMON_FRACTION * true_volume).sum(1)
    return (
        int(np.maximum(per_object - 1, 0).sum()),
        int(np.maximum(objects_in_box - 1, 0).sum()),
        int((~on_object).sum()),
    )


@dataclass(frozen=True, slots=True)
class ProposalsAt:
    """Scores of the boxes of single frames at one IoU threshold, over all judged frames.

    Attributes
    ----------
    threshold : float
    precision, recall, f1 : float or None
    """

    threshold: float
    precision: float | None
    recall: float | None
    f1: float | None


@dataclass(frozen=True, slots=True)
class ProposalQuality:
    """Quality of the 3D boxes of single frames, before matching.

    Attributes
    ----------
    per_frame : float or None
        Mean number of boxes per judged frame, including those that count neither way.
    at : tuple of ProposalsAt
        Scores at each of `THRESHOLDS`.
    """

    per_frame: float | None
    at: tuple[ProposalsAt, ...]


def proposal_quality(frames: Sequence[FrameOverlap], boxes: int) -> ProposalQuality:
    """Return the quality of the boxes of single frames; `boxes` is their number in all judged frames."""
    objects = sum(len(frame.truth) for frame in frames)
    judged = sum(len(frame.found) for frame in frames)
    at = []
    for threshold in THRESHOLDS:
        hits = sum(len(match(frame.iou, threshold)) for frame in frames)
        at.append(ProposalsAt(threshold, ratio(hits, judged), ratio(hits, objects), ratio(2 * hits, judged + objects)))
    return ProposalQuality(ratio(boxes, len(frames)), tuple(at))
