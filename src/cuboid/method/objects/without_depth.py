"""Objects without depth: rectangles of a detector, tracked with the poses and triangulated.

A screen, a keyboard or a black box may have few depth readings, and so no voxels and no label, but a detector finds it.
A detection whose rectangle has few readings starts an object without depth, or is a sighting of one. The position is
the intersection of the rays through the detections; the size is that of the rectangles at this distance. The object is
confirmed when its hits outweigh the detections missed at its position, and retired otherwise. Where there is depth,
depth decides: a rectangle that is half full of readings starts nothing and is not reported.

An object without depth that repeatedly has the rectangle of a labelled object of the map is that object. The older
label stays, and where the map's object has few readings, the rectangle of the object without depth is used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.results import Sighting
from cuboid.ground.core.tolerances import NEAREST_M
from cuboid.ground.geometry.rectangles import rect_iou_matrix
from cuboid.ground.geometry.se3 import transform
from cuboid.method.detection.types import Detections
from cuboid.method.objects.box_without_depth import Planes, box_of, united
from cuboid.method.objects.confirmation import READ_FRACTION, is_certain, prevails
from cuboid.method.objects.entry import MapObject, ObjectWithoutDepth
from cuboid.method.objects.naming import MISSED, SAME_IOU, likely_classes, score_gain
from cuboid.method.objects.rectangles import (
    distance_of,
    is_cut_off,
    match_views,
    predict,
    ray_through,
    read_fraction,
    size_at,
)
from cuboid.method.objects.retirement import is_unlikely
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.visibility import Visibility

# A detection is a sighting of an object without depth if its rectangle overlaps the predicted one by this IoU: at first
# positions along the line of sight, and sizes, are inaccurate.
FOLLOW_IOU = 0.3
# Smallest visible fraction of an object that is reported as seen, and of one that counts as missed if not detected.
SEEN_FRACTION, MISSED_FRACTION = 0.3, 0.5
# Frames in which an object without depth and an object of the map must have the same rectangle to be merged.
MIN_MEETINGS = 2
# Log-odds of a hit in addition to its score: false detections seldom repeat at the same position.
HIT = 0.7
# Largest number of objects without depth; the most likely ones are kept.
MAX_WITHOUT_DEPTH = 64
# Standard deviations: of the direction to an object, radians, and as a fraction of its angular size; of its distance
# from readings in or around its rectangle, as a fraction of the distance.
DIRECTION_RAD, DIRECTION_SIZE, READ_DISTANCE_FRACTION = 0.01, 0.1, 0.2


class WithoutDepth:
    """Finds and tracks the objects without depth in the detections of frames; the store contains them.

    Parameters
    ----------
    store : ObjectStore
    config : TrackerConfig
        Largest distance at which an object without depth starts, and probabilities of objects with a label.
    """

    def __init__(self, store: ObjectStore, config: TrackerConfig) -> None:
        self._store, self._config = store, config
        # Rectangles of the objects hit in the last frame, by number, until the sightings of the frame are reported.
        self._hit: dict[int, Float64Array] = {}

    def confirmed(self) -> list[ObjectWithoutDepth]:
        """Return the certain objects with a label of their own, by label."""
        found = [o for o in self._store.detected() if o.confirmed and not o.partner and is_certain(o)]
        found += [
            o for o in self._store.by_regions() if o.confirmed and prevails(o, self._store.rivals_of(o), self._config)
        ]
        return sorted(found, key=lambda o: o.label)

    def retire(self, label: int) -> bool:
        """Retire an object because a user asks for it; return whether one had the label."""
        found = [o for o in self._store.without_depth() if o.label == label]
        self._store.retire_all(found)
        return len(found) > 0

    def merge(self, label: int, other: int, planes: Planes) -> int:
        """Merge two labelled objects because a user says that they are one; return the older label, which stays.

        Parameters
        ----------
        label, other : int
            At least one of them is that of an object of `confirmed`.
        planes : Planes
        """
        older, younger = sorted((label, other))
        by_label = {entry.label: entry for entry in self.confirmed()}
        if older in by_label and younger in by_label:
            kept, gone = by_label[older], by_label[younger]
            self._store.merge_without_depth(kept, gone, united(kept, gone, planes))
            return older
        entry = by_label.get(older) or by_label[younger]
        partner = next(o for o in self._store.confirmed() if o.label in (older, younger))
        self._store.merge_names(partner, entry)
        self._store.join_map(entry, partner)
        return partner.label

    def update(self, found: Detections, visible: Sequence[tuple[MapObject, Visibility]], seen: Observation) -> None:
        """Update the objects with the detections in a frame.

        Parameters
        ----------
        found : Detections
        visible : sequence of (MapObject, Visibility)
            The visible objects of the map.
        seen : Observation
        """
        boxes = found.boxes_xyxy.astype(np.float64)
        entries = self._store.detected()
        views = [predict(entry.center, entry.size_m, seen) for entry in entries]
        partner = match_views(views, boxes, FOLLOW_IOU)
        self._hit = {}
        for k, (entry, view) in enumerate(zip(entries, views, strict=True)):
            if k in partner:
                self._add_hit(entry, found, partner[k], seen)
            elif view is not None and view.visible >= MISSED_FRACTION and view.read < READ_FRACTION:
                self._store.add_evidence(entry, -MISSED * view.visible)
        shown_xyxy = np.array([view.rect_xyxy for view in views if view is not None]).reshape(-1, 4)
        for k in sorted({*range(len(boxes))} - {*partner.values()}):
            self._start(found, k, shown_xyxy, seen)
        self._join_map([(entry, view) for entry, view in visible if entry.confirmed])
        merge_doubles(self._store, self._store.detected(), self._hit, seen)
        self._retire_unlikely()
        for entry in self._store.detected():
            if not entry.confirmed and not entry.partner and is_certain(entry):
                self._store.confirm(entry)

    def _add_hit(self, entry: ObjectWithoutDepth, found: Detections, k: int, seen: Observation) -> None:
        store, box, scores = self._store, found.boxes_xyxy[k].astype(np.float64), found.scores[k]
        weight = store.add_name_evidence(entry, likely_classes(found.names, scores), 1.0, seen.eye)
        store.add_evidence(entry, weight * (HIT + score_gain(float(scores.max()))))
        store.add_hit(entry, read_fraction(box, seen), seen.keyframe)
        self._add_ray(entry, box, seen, weight)
        z = float(transform(seen.T_camera_world, entry.center)[2])
        if z > NEAREST_M and not is_cut_off(box, seen):
            store.add_size(entry, size_at(box, z, seen), float(np.linalg.norm(entry.center - seen.eye)), weight)
        self._hit[entry.number] = box

    def _add_ray(self, entry: ObjectWithoutDepth, box: Float64Array, seen: Observation, weight: float) -> None:
        """Update an object's position with the ray through a detection, and with the distance from readings at it."""
        direction, size_rad = ray_through(box, seen)
        distance_m = max(float(np.linalg.norm(entry.center - seen.eye)), NEAREST_M)
        along = np.outer(direction, direction)
        across = np.eye(3) - along
        precision = weight / (distance_m * max(DIRECTION_RAD, DIRECTION_SIZE * size_rad)) ** 2
        information, vector = precision * across, precision * (across @ seen.eye)
        read_m = distance_of(box, seen)
        if read_m is not None:
            precision = weight / (READ_DISTANCE_FRACTION * read_m) ** 2
            information = information + precision * along
            vector = vector + precision * (along @ (seen.eye + read_m * direction))
        self._store.add_ray(entry, information, vector)

    def _start(self, found: Detections, k: int, shown_xyxy: Float64Array, seen: Observation) -> None:
        """Start an object if a detection is not cut off, has few readings, and overlaps no known object."""
        box = found.boxes_xyxy[k].astype(np.float64)
        if read_fraction(box, seen) >= READ_FRACTION or is_cut_off(box, seen):
            return
        if len(shown_xyxy) and rect_iou_matrix(box[None], shown_xyxy).max() >= SAME_IOU:
            return
        read_m = distance_of(box, seen)
        if read_m is None or read_m > self._config.max_depth_m:
            return
        direction, _ = ray_through(box, seen)
        guess = 1e-6 * np.eye(3)  # makes the position defined before the first ray; the rays outweigh it
        entry = self._store.add_without_depth(guess, guess @ (seen.eye + read_m * direction), seen.frame)
        self._add_hit(entry, found, k, seen)

    def _join_map(self, shown: Sequence[tuple[MapObject, Visibility]]) -> None:
        """Join objects that repeatedly have the rectangle of a labelled object of the map with that object."""
        entries = [entry for entry in self._store.detected() if not entry.partner]
        for entry, partner in met_in_map(self._store, entries, self._hit, shown):
            self._store.join_map(entry, partner)

    def _retire_unlikely(self) -> None:
        """Retire unlikely objects, and the least likely ones beyond the limit."""
        entries = self._store.detected()
        likely = [o for o in entries if not is_unlikely(o)]
        retire_others(self._store, entries, sorted(likely, key=lambda o: (-bool(o.label), -o.log_odds, o.number)))

    def sightings(
        self, shown: Sequence[Sighting], seen: Observation, planes: Planes, min_probability: float
    ) -> tuple[Sighting, ...]:
        """Return the sightings of a frame, including those of objects without depth, by label.

        Objects with a lower probability than `min_probability`, 0..1, are left out.
        """
        found = {sighting.label: sighting for sighting in shown}
        others = np.array([sighting.rect_xyxy for sighting in shown]).reshape(-1, 4)
        for entry in self._store.detected():
            partner = self._partner_of(entry)
            certain = is_certain(entry) and (entry.label or partner)
            view = predict(entry.center, entry.size_m, seen) if certain else None
            if view is None or view.visible < SEEN_FRACTION or view.read >= READ_FRACTION:
                continue
            rect = self._hit.get(entry.number, view.rect_xyxy)
            if partner is not None:
                if partner.score >= min_probability:
                    values = partner.label, partner.box, None, view.visible, rect
                    old = found.get(partner.label, Sighting(*values, probability=partner.score))
                    found[partner.label] = replace(old, rect_xyxy=rect)
            elif not len(others) or rect_iou_matrix(rect[None], others).max() < SAME_IOU:
                self._store.record_seen([entry], seen.frame)
                values = entry.label, box_of(entry, planes)[0], None, view.visible, rect
                found[entry.label] = Sighting(*values, probability=entry.score)
        self._hit = {}
        return tuple(found[label] for label in sorted(found))

    def _partner_of(self, entry: ObjectWithoutDepth) -> MapObject | None:
        """Return the object of the map that an object is; undo this if that one has been retired."""
        if entry.partner and (entry.partner not in self._store or not self._store[entry.partner].confirmed):
            self._store.leave_map(entry)
        return self._store[entry.partner] if entry.partner else None


def met_in_map(
    store: ObjectStore,
    entries: Sequence[ObjectWithoutDepth],
    hit: Mapping[int, Float64Array],
    shown: Sequence[tuple[MapObject, Visibility]],
) -> list[tuple[ObjectWithoutDepth, MapObject]]:
    """Count the entries that have the rectangle of a labelled object of the map; return those that did so repeatedly.

    Parameters
    ----------
    store : ObjectStore
    entries : sequence of ObjectWithoutDepth
    hit : mapping of int to (4,) float64
        Rectangles that were found in this frame, by the number of the entry.
    shown : sequence of (MapObject, Visibility)
        The labelled objects of the map that the frame shows.
    """
    rects = np.array([view.rect_xyxy for _, view in shown]).reshape(-1, 4)
    found = []
    for entry in entries if shown else ():
        if entry.number not in hit:
            continue
        iou = rect_iou_matrix(hit[entry.number][None], rects)[0]
        k = int(iou.argmax())
        if iou[k] >= SAME_IOU and store.count_meeting(entry, shown[k][0]) >= MIN_MEETINGS:
            found.append((entry, shown[k][0]))
    return found


def merge_doubles(
    store: ObjectStore, entries: Sequence[ObjectWithoutDepth], hit: dict[int, Float64Array], seen: Observation
) -> None:
    """Merge entries with the same predicted rectangle; the older label, or else the older object, stays.

    Parameters
    ----------
    store : ObjectStore
    entries : sequence of ObjectWithoutDepth
    hit : dict of int to (4,) float64
        Rectangles that were found in this frame, by the number of the entry; the one that stays gets that of the other.
    seen : Observation
    """
    kept: list[ObjectWithoutDepth] = []
    rects = np.zeros((0, 4))
    for entry in sorted(entries, key=lambda o: (o.label or np.inf, o.number)):
        view = predict(entry.center, entry.size_m, seen)
        if view is None:
            continue
        iou = rect_iou_matrix(view.rect_xyxy[None], rects)[0]
        if iou.max(initial=0.0) >= SAME_IOU:
            other = kept[int(iou.argmax())]
            if entry.number in hit:
                hit.setdefault(other.number, hit[entry.number])
            store.merge_without_depth(other, entry)
            continue
        kept.append(entry)
        rects = np.concatenate([rects, view.rect_xyxy[None]])


def retire_others(
    store: ObjectStore, entries: Sequence[ObjectWithoutDepth], best: Sequence[ObjectWithoutDepth]
) -> None:
    """Retire the entries that are not among the first `MAX_WITHOUT_DEPTH` of the best."""
    kept = {entry.number for entry in best[:MAX_WITHOUT_DEPTH]}
    store.retire_all([entry for entry in entries if entry.number not in kept])
