"""Detections as evidence for the names of objects with depth, and that two of them are one, or two.

One detection over two touching objects, which shows neither of them alone, is a vote that they are one. Two detections,
each of which shows one of the two, are a vote that they are two. The votes have the log-odds of segments; see
`affinity`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.tolerances import DRIFT_M
from cuboid.ground.geometry.rectangles import fractions_inside, rect_iou_matrix
from cuboid.method.detection.types import Detections
from cuboid.method.objects.affinity import DIFFERENT_LOG_ODDS, SAME_LOG_ODDS
from cuboid.method.objects.distances import touch
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.naming import INSIDE_FRACTION, SAME_IOU, likely_classes, match_detections
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.visibility import Visibility


def name_objects(
    found: Detections, visible: Sequence[tuple[MapObject, Visibility]], store: ObjectStore, eye: Float64Array
) -> None:
    """Add a detector's result for a frame to the evidence for names.

    Parameters
    ----------
    found : Detections
        Detections in the frame.
    visible : sequence of (MapObject, Visibility)
        The visible objects of the map.
    store : ObjectStore
        The store that contains them.
    eye : (3,) float64
        Position of the camera in the map.
    """
    rects = np.array([view.rect_xyxy for _, view in visible]).reshape(-1, 4)
    partner = match_detections(found, rects)
    inside = fractions_inside(rects, found.boxes_xyxy.astype(np.float64)).max(axis=1, initial=0.0)
    for k, (entry, view) in enumerate(visible):
        likely = likely_classes(found.names, found.scores[partner == k].max(axis=0, initial=0.0))
        if likely or inside[k] <= INSIDE_FRACTION:
            store.add_name_evidence(entry, likely, view.visible, eye)


def add_votes(
    found: Detections, visible: Sequence[tuple[MapObject, Visibility]], store: ObjectStore, weight: float
) -> None:
    """Add the votes of a frame's detections to the affinities of objects that were seen side by side.

    Parameters
    ----------
    found : Detections
    visible : sequence of (MapObject, Visibility)
        The visible objects of the map.
    store : ObjectStore
        The store that contains them.
    weight : float
        Weight of the frame, 0..1: the novelty of `ObjectStore.add_pair_evidence`.
    """
    shown = [(entry, view.rect_xyxy) for entry, view in visible if view.seen and len(entry.points)]
    if len(shown) < 2 or not len(found):
        return
    boxes, rects = found.boxes_xyxy.astype(np.float64), np.array([rect for _, rect in shown])
    iou, inside = rect_iou_matrix(boxes, rects), fractions_inside(rects, boxes)
    detection = _detection_of_each(iou)
    for a, b in combinations(range(len(shown)), 2):
        first, second = shown[a][0], shown[b][0]
        if store.affinity.of(first.number, second.number) is None:
            continue
        apart = detection[a] >= 0 and detection[b] >= 0
        if (apart or _shows_both(boxes, rects[[a, b]], iou[:, [a, b]], inside[[a, b]])) and touch(
            first.points, second.points, DRIFT_M
        ):
            log_odds = DIFFERENT_LOG_ODDS if apart else SAME_LOG_ODDS
            store.add_pair_evidence(first, second, log_odds, novelty=weight)


def _detection_of_each(iou: Float64Array) -> npt.NDArray[np.intp]:
    """Return the detection that shows each object best and no other object better, (M,), -1: none.

    `iou` (N, M) is that of the detections with the rectangles of the objects.
    """
    best = iou.argmax(axis=0)
    each = np.arange(iou.shape[1])
    return np.where((iou[best, each] >= SAME_IOU) & (iou[best].argmax(axis=1) == each), best, -1)


def _shows_both(boxes: Float64Array, pair: Float64Array, iou: Float64Array, inside: Float64Array) -> bool:
    """Return whether a detection shows two objects together, and neither of them alone.

    Parameters
    ----------
    boxes : (N, 4) float64
        Rectangles of the detections.
    pair : (2, 4) float64
        Rectangles of the two objects.
    iou : (N, 2) float64
        Of each detection with each of the two.
    inside : (2, N) float64
        Fraction of each of the two inside each detection.
    """
    both = np.concatenate([pair[:, :2].min(axis=0), pair[:, 2:].max(axis=0)])
    together = rect_iou_matrix(boxes, both[None])[:, 0]
    return bool(((together >= SAME_IOU) & (iou.max(axis=1) < SAME_IOU) & (inside.min(axis=0) > INSIDE_FRACTION)).any())
