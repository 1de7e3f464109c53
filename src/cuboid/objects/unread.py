"""Objects without depth readings: rectangles of a detector, tracked with the poses and triangulated.

A screen, a keyboard or a black box may have few depth readings, and so no voxels and no label, but a detector finds it.
A detection whose rectangle has few readings starts an unread object, or is a sighting of one. Its position is the
intersection of the rays through its detections; its size is that of its rectangles at this distance. The object is
confirmed when its hits outweigh the detections missed at its position, and removed otherwise. Where there is depth,
depth decides: a rectangle that is half full of readings starts nothing and is not reported.

An unread object that repeatedly has the rectangle of a labelled object of the map is that object. The older label
stays, and where the map's object has few readings, the rectangle of the unread object is used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy

import numpy as np

from cuboid.core.frame import Float64Array
from cuboid.core.observation import Observation
from cuboid.core.results import Sighting
from cuboid.core.tolerances import NEAREST_M
from cuboid.detection.types import Detections
from cuboid.geometry.rectangles import rect_iou_matrix
from cuboid.geometry.se3 import transform
from cuboid.objects.affinity import CERTAIN_LOG_ODDS, MAX_LOG_ODDS
from cuboid.objects.entry import MapObject
from cuboid.objects.naming import MISSED, SAME_IOU, add_evidence, likely_classes, merged_evidence, score_gain
from cuboid.objects.rectangles import (
    Predicted,
    distance_of,
    is_cut_off,
    predict,
    ray_through,
    read_fraction,
    shifted_iou,
    size_at,
)
from cuboid.objects.store import ObjectStore
from cuboid.objects.unread_object import READ_FRACTION, Planes, UnreadObject, absorb, box_of
from cuboid.objects.visibility import Visibility

# A detection is a sighting of an unread object if its rectangle overlaps the predicted one by this IoU: at first
# positions along the line of sight, and sizes, are inaccurate.
FOLLOW_IOU = 0.3
# Smallest visible fraction of an object that is reported as seen, and of one that counts as missed if not detected.
SEEN_FRACTION, LOOKED_FRACTION = 0.3, 0.5
# Frames in which an unread object and an object of the map must have the same rectangle to be merged.
MIN_MEETINGS = 2
# An unread object without a label is removed below these log-odds.
DROPPED = -1.0
# Log-odds of a hit in addition to its score: false detections seldom repeat at the same position.
HIT = 0.7
# Largest number of unread objects; the most likely ones are kept.
MAX_THINGS = 64
# Standard deviations: of the direction to an object, radians, and as a fraction of its angular size; of its distance
# from readings in or around its rectangle, as a fraction of the distance.
DIRECTION_RAD, DIRECTION_SIZE, DISTANCE = 0.01, 0.1, 0.2
# Factor on the information of earlier hits with each new one: poses drift, and the position with them.
FADING = 0.9


class UnreadMap:
    """All objects without depth readings.

    Parameters
    ----------
    store : ObjectStore
        Gives labels, and contains the objects of the map.
    far_m : float
        Largest distance at which an unread object starts, metres.
    """

    def __init__(self, store: ObjectStore, far_m: float) -> None:
        self._store, self._far_m = store, far_m
        self._things: list[UnreadObject] = []
        self._next_number = 1
        # Rectangles of the objects hit in the last frame, by number, until the sightings of the frame are reported.
        self._hit: dict[int, Float64Array] = {}

    def state(self) -> tuple[UnreadObject, ...]:
        """Return copies of the current objects; later updates do not change them."""
        return tuple([copy(one) for one in self._things])

    def restore(self, things: Sequence[UnreadObject]) -> None:
        """Continue from a state."""
        self._things = list(things)
        self._next_number = 1 + max((one.number for one in things), default=0)

    def forget(self, label: int) -> bool:
        """Remove an object because a user asks for it; return whether one had the label."""
        left = [one for one in self._things if one.label != label]
        found = len(left) < len(self._things)
        self._things = left
        return found

    def confirmed(self) -> list[UnreadObject]:
        """Return the certain objects with a label of their own, by label."""
        return sorted((o for o in self._things if o.label and not o.partner and o.is_sure), key=lambda o: o.label)

    def merge(self, label: int, other: int, planes: Planes) -> int:
        """Merge two labelled objects because a user says that they are one; return the older label, which stays.

        Parameters
        ----------
        label, other : int
            At least one of them is that of an object of `confirmed`.
        planes : Planes
        """
        older, younger = sorted((label, other))
        things = {one.label: one for one in self.confirmed()}
        if older in things and younger in things:
            kept, gone = things[older], things[younger]
            absorb(kept, gone, planes)
            kept.merged_labels = sorted({*kept.merged_labels, *gone.merged_labels, younger})
            self._things.remove(gone)
            return older
        thing = things.get(older) or things[younger]
        entry = next(one for one in self._store.confirmed() if one.label in (older, younger))
        entry.name_log_odds = merged_evidence(entry.name_log_odds, thing.name_log_odds)
        self._join_map(thing, entry)
        return entry.label

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
        views = [predict(one.center, one.size_m, seen) for one in self._things]
        partner = self._assigned(boxes, views)
        self._hit = {}
        for k, (one, view) in enumerate(zip(self._things, views, strict=True)):
            if k in partner:
                self._add_hit(one, found, partner[k], seen)
            elif view is not None and view.visible >= LOOKED_FRACTION and view.read < READ_FRACTION:
                one.log_odds -= MISSED * view.visible
        shown_xyxy = np.array([view.rect_xyxy for view in views if view is not None]).reshape(-1, 4)
        for k in sorted({*range(len(boxes))} - {*partner.values()}):
            self._begin(found, k, shown_xyxy, seen)
        self._meet([(entry, view) for entry, view in visible if entry.confirmed])
        self._merge_doubles(seen)
        self._end()
        for one in self._things:
            if not one.label and not one.partner and one.is_sure:
                one.label = self._store.next_label()

    @staticmethod
    def _assigned(boxes: Float64Array, views: Sequence[Predicted | None]) -> dict[int, int]:
        """Return the detection of each object, by its index in the list: pairs with the largest overlap first."""
        iou = np.array([shifted_iou(view, boxes) for view in views]).reshape(len(views), len(boxes))
        found: dict[int, int] = {}
        taken: set[int] = set()
        for flat in np.argsort(-iou, axis=None, kind="stable").tolist():
            i, k = divmod(flat, len(boxes))
            if iou[i, k] < FOLLOW_IOU:
                break
            if i not in found and k not in taken:
                found[i] = k
                taken.add(k)
        return found

    def _add_hit(self, one: UnreadObject, found: Detections, k: int, seen: Observation) -> None:
        box, scores = found.boxes_xyxy[k].astype(np.float64), found.scores[k]
        weight = add_evidence(one, likely_classes(found.names, scores), 1.0, seen.eye)
        one.log_odds = min(MAX_LOG_ODDS, one.log_odds + weight * (HIT + score_gain(float(scores.max()))))
        one.hits, one.keyframe = one.hits + 1, seen.keyframe
        one.read += (read_fraction(box, seen) - one.read) / one.hits
        self._add_ray(one, box, seen, weight)
        z = float(transform(seen.T_camera_world, one.center)[2])
        if z > NEAREST_M and not is_cut_off(box, seen):
            one.add_size(size_at(box, z, seen), float(np.linalg.norm(one.center - seen.eye)), weight)
        self._hit[one.number] = box

    @staticmethod
    def _add_ray(one: UnreadObject, box: Float64Array, seen: Observation, weight: float) -> None:
        """Update an object's position with the ray through a detection, and with the distance from readings at it."""
        direction, size_rad = ray_through(box, seen)
        distance_m = max(float(np.linalg.norm(one.center - seen.eye)), NEAREST_M)
        along = np.outer(direction, direction)
        across = np.eye(3) - along
        sure = weight / (distance_m * max(DIRECTION_RAD, DIRECTION_SIZE * size_rad)) ** 2
        information, vector = sure * across, sure * (across @ seen.eye)
        read_m = distance_of(box, seen)
        if read_m is not None:
            near = weight / (DISTANCE * read_m) ** 2
            information, vector = information + near * along, vector + near * (along @ (seen.eye + read_m * direction))
        one.information = FADING * one.information + information
        one.vector = FADING * one.vector + vector

    def _begin(self, found: Detections, k: int, shown_xyxy: Float64Array, seen: Observation) -> None:
        """Start an object if a detection is not cut off, has few readings, and overlaps no known object."""
        box = found.boxes_xyxy[k].astype(np.float64)
        if read_fraction(box, seen) >= READ_FRACTION or is_cut_off(box, seen):
            return
        if len(shown_xyxy) and rect_iou_matrix(box[None], shown_xyxy).max() >= SAME_IOU:
            return
        read_m = distance_of(box, seen)
        if read_m is None or read_m > self._far_m:
            return
        direction, _ = ray_through(box, seen)
        guess = 1e-6 * np.eye(3)  # makes the position defined before the first ray; the rays outweigh it
        one = UnreadObject(self._next_number, seen.frame, seen.frame, guess, guess @ (seen.eye + read_m * direction))
        self._next_number += 1
        self._things.append(one)
        self._add_hit(one, found, k, seen)

    def _meet(self, shown: Sequence[tuple[MapObject, Visibility]]) -> None:
        """Merge objects that repeatedly have the rectangle of a labelled object of the map into that object."""
        rects = np.array([view.rect_xyxy for _, view in shown]).reshape(-1, 4)
        for one in self._things:
            if one.partner or one.number not in self._hit or not shown:
                continue
            iou = rect_iou_matrix(self._hit[one.number][None], rects)[0]
            k = int(iou.argmax())
            if iou[k] < SAME_IOU:
                continue
            entry = shown[k][0]
            one.meetings = {**one.meetings, entry.number: one.meetings.get(entry.number, 0) + 1}
            if one.meetings[entry.number] >= MIN_MEETINGS:
                self._join_map(one, entry)

    def _join_map(self, one: UnreadObject, entry: MapObject) -> None:
        """Merge an object into an object of the map."""
        one.partner = entry.number
        if one.label:
            self._store.take_label(entry, one.label, one.merged_labels, one.first_frame)
            one.label, one.merged_labels = entry.label, []

    def _merge_doubles(self, seen: Observation) -> None:
        """Merge two objects with the same rectangle; the older label, or else the older object, stays."""
        kept: list[tuple[UnreadObject, Predicted | None]] = []
        for one in sorted(self._things, key=lambda o: (o.label or np.inf, o.number)):
            view = predict(one.center, one.size_m, seen)
            shown = [(other, theirs) for other, theirs in kept if theirs is not None]
            if view is not None and shown:
                iou = rect_iou_matrix(view.rect_xyxy[None], np.array([theirs.rect_xyxy for _, theirs in shown]))[0]
                if iou.max() >= SAME_IOU:
                    other = shown[int(iou.argmax())][0]
                    other.name_log_odds = merged_evidence(other.name_log_odds, one.name_log_odds)
                    if one.label and not one.partner:
                        other.merged_labels = sorted({*other.merged_labels, *one.merged_labels, one.label})
                    other.log_odds, other.hits = max(other.log_odds, one.log_odds), max(other.hits, one.hits)
                    continue
            kept.append((one, view))
        self._things = sorted((one for one, _ in kept), key=lambda o: o.number)

    def _end(self) -> None:
        """Remove unlikely objects, and the least likely ones beyond the limit."""
        alive = [o for o in self._things if o.log_odds > (-CERTAIN_LOG_ODDS if o.label else DROPPED)]
        best = sorted(alive, key=lambda o: (-bool(o.label), -o.log_odds, o.number))[:MAX_THINGS]
        self._things = sorted(best, key=lambda o: o.number)

    def sightings(self, shown: Sequence[Sighting], seen: Observation, planes: Planes) -> tuple[Sighting, ...]:
        """Return the sightings of a frame, including those of objects without depth readings, by label."""
        found = {one.label: one for one in shown}
        others = np.array([one.rect_xyxy for one in shown]).reshape(-1, 4)
        for one in self._things:
            partner = self._partner_of(one)
            view = predict(one.center, one.size_m, seen) if one.is_sure and (one.label or partner) else None
            if view is None or view.visible < SEEN_FRACTION or view.read >= READ_FRACTION:
                continue
            rect = self._hit.get(one.number, view.rect_xyxy)
            if partner is not None:
                old = found.get(partner.label, Sighting(partner.label, partner.box, None, view.visible, rect))
                found[partner.label] = Sighting(partner.label, old.box, old.iou, old.visible, rect)
            elif not len(others) or rect_iou_matrix(rect[None], others).max() < SAME_IOU:
                one.frames_seen, one.last_frame = one.frames_seen + 1, seen.frame
                found[one.label] = Sighting(one.label, box_of(one, planes)[0], None, view.visible, rect)
        self._hit = {}
        return tuple(found[label] for label in sorted(found))

    def _partner_of(self, one: UnreadObject) -> MapObject | None:
        """Return the object of the map into which an object was merged; undo the merge if that one has been retired."""
        if one.partner and (one.partner not in self._store or not self._store[one.partner].confirmed):
            one.partner, one.meetings = 0, {}
        return self._store[one.partner] if one.partner else None

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Move each object with the keyframe to which its last hit is anchored; see `ObjectMap.apply_correction`."""
        for one in self._things:
            T = moved.get(one.keyframe)
            if T is not None:
                R, center = T[:3, :3], transform(T, one.center)
                one.information = R @ one.information @ R.T
                one.vector = one.information @ center
                one.views = np.hstack([one.views[:, :3] @ R.T, one.views[:, 3:]])
