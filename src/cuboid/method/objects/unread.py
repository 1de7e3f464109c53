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

from cuboid.ground.core.frame import Float64Array
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.results import Sighting
from cuboid.ground.core.tolerances import NEAREST_M
from cuboid.ground.geometry.rectangles import rect_iou_matrix
from cuboid.ground.geometry.se3 import transform
from cuboid.method.detection.types import Detections
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS, MAX_LOG_ODDS
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.naming import MISSED, SAME_IOU, add_evidence, likely_classes, merged_evidence, score_gain
from cuboid.method.objects.rectangles import (
    Predicted,
    distance_of,
    is_cut_off,
    predict,
    ray_through,
    read_fraction,
    shifted_iou,
    size_at,
)
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.unread_object import READ_FRACTION, Planes, UnreadObject, absorb, box_of
from cuboid.method.objects.visibility import Visibility

# A detection is a sighting of an unread object if its rectangle overlaps the predicted one by this IoU: at first
# positions along the line of sight, and sizes, are inaccurate.
FOLLOW_IOU = 0.3
# Smallest visible fraction of an object that is reported as seen, and of one that counts as missed if not detected.
SEEN_FRACTION, MISSED_FRACTION = 0.3, 0.5
# Frames in which an unread object and an object of the map must have the same rectangle to be merged.
MIN_MEETINGS = 2
# An unread object without a label is removed below these log-odds.
DROPPED = -1.0
# Log-odds of a hit in addition to its score: false detections seldom repeat at the same position.
HIT = 0.7
# Largest number of unread objects; the most likely ones are kept.
MAX_UNREAD = 64
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
        self._objects: list[UnreadObject] = []
        self._next_number = 1
        # Rectangles of the objects hit in the last frame, by number, until the sightings of the frame are reported.
        self._hit: dict[int, Float64Array] = {}

    def state(self) -> tuple[UnreadObject, ...]:
        """Return copies of the current objects; later updates do not change them."""
        return tuple([copy(unread) for unread in self._objects])

    def restore(self, objects: Sequence[UnreadObject]) -> None:
        """Continue from a state."""
        self._objects = list(objects)
        self._next_number = 1 + max((unread.number for unread in objects), default=0)

    def forget(self, label: int) -> bool:
        """Remove an object because a user asks for it; return whether one had the label."""
        kept = [unread for unread in self._objects if unread.label != label]
        found = len(kept) < len(self._objects)
        self._objects = kept
        return found

    def confirmed(self) -> list[UnreadObject]:
        """Return the certain objects with a label of their own, by label."""
        return sorted((o for o in self._objects if o.label and not o.partner and o.is_sure), key=lambda o: o.label)

    def merge(self, label: int, other: int, planes: Planes) -> int:
        """Merge two labelled objects because a user says that they are one; return the older label, which stays.

        Parameters
        ----------
        label, other : int
            At least one of them is that of an object of `confirmed`.
        planes : Planes
        """
        older, younger = sorted((label, other))
        by_label = {unread.label: unread for unread in self.confirmed()}
        if older in by_label and younger in by_label:
            kept, gone = by_label[older], by_label[younger]
            absorb(kept, gone, planes)
            kept.merged_labels = sorted({*kept.merged_labels, *gone.merged_labels, younger})
            self._objects.remove(gone)
            return older
        unread_object = by_label.get(older) or by_label[younger]
        entry = next(o for o in self._store.confirmed() if o.label in (older, younger))
        entry.name_log_odds = merged_evidence(entry.name_log_odds, unread_object.name_log_odds)
        self._join_map(unread_object, entry)
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
        views = [predict(unread.center, unread.size_m, seen) for unread in self._objects]
        partner = self._assigned(boxes, views)
        self._hit = {}
        for k, (unread, view) in enumerate(zip(self._objects, views, strict=True)):
            if k in partner:
                self._add_hit(unread, found, partner[k], seen)
            elif view is not None and view.visible >= MISSED_FRACTION and view.read < READ_FRACTION:
                unread.log_odds -= MISSED * view.visible
        shown_xyxy = np.array([view.rect_xyxy for view in views if view is not None]).reshape(-1, 4)
        for k in sorted({*range(len(boxes))} - {*partner.values()}):
            self._start(found, k, shown_xyxy, seen)
        self._merge_into_map([(entry, view) for entry, view in visible if entry.confirmed])
        self._merge_doubles(seen)
        self._remove_unlikely()
        for unread in self._objects:
            if not unread.label and not unread.partner and unread.is_sure:
                unread.label = self._store.next_label()

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

    def _add_hit(self, unread: UnreadObject, found: Detections, k: int, seen: Observation) -> None:
        box, scores = found.boxes_xyxy[k].astype(np.float64), found.scores[k]
        weight = add_evidence(unread, likely_classes(found.names, scores), 1.0, seen.eye)
        unread.log_odds = min(MAX_LOG_ODDS, unread.log_odds + weight * (HIT + score_gain(float(scores.max()))))
        unread.hits, unread.keyframe = unread.hits + 1, seen.keyframe
        unread.read += (read_fraction(box, seen) - unread.read) / unread.hits
        self._add_ray(unread, box, seen, weight)
        z = float(transform(seen.T_camera_world, unread.center)[2])
        if z > NEAREST_M and not is_cut_off(box, seen):
            unread.add_size(size_at(box, z, seen), float(np.linalg.norm(unread.center - seen.eye)), weight)
        self._hit[unread.number] = box

    @staticmethod
    def _add_ray(unread: UnreadObject, box: Float64Array, seen: Observation, weight: float) -> None:
        """Update an object's position with the ray through a detection, and with the distance from readings at it."""
        direction, size_rad = ray_through(box, seen)
        distance_m = max(float(np.linalg.norm(unread.center - seen.eye)), NEAREST_M)
        along = np.outer(direction, direction)
        across = np.eye(3) - along
        sure = weight / (distance_m * max(DIRECTION_RAD, DIRECTION_SIZE * size_rad)) ** 2
        information, vector = sure * across, sure * (across @ seen.eye)
        read_m = distance_of(box, seen)
        if read_m is not None:
            near = weight / (DISTANCE * read_m) ** 2
            information, vector = information + near * along, vector + near * (along @ (seen.eye + read_m * direction))
        unread.information = FADING * unread.information + information
        unread.vector = FADING * unread.vector + vector

    def _start(self, found: Detections, k: int, shown_xyxy: Float64Array, seen: Observation) -> None:
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
        unread = UnreadObject(self._next_number, seen.frame, seen.frame, guess, guess @ (seen.eye + read_m * direction))
        self._next_number += 1
        self._objects.append(unread)
        self._add_hit(unread, found, k, seen)

    def _merge_into_map(self, shown: Sequence[tuple[MapObject, Visibility]]) -> None:
        """Merge objects that repeatedly have the rectangle of a labelled object of the map into that object."""
        rects = np.array([view.rect_xyxy for _, view in shown]).reshape(-1, 4)
        for unread in self._objects:
            if unread.partner or unread.number not in self._hit or not shown:
                continue
            iou = rect_iou_matrix(self._hit[unread.number][None], rects)[0]
            k = int(iou.argmax())
            if iou[k] < SAME_IOU:
                continue
            entry = shown[k][0]
            unread.meetings = {**unread.meetings, entry.number: unread.meetings.get(entry.number, 0) + 1}
            if unread.meetings[entry.number] >= MIN_MEETINGS:
                self._join_map(unread, entry)

    def _join_map(self, unread: UnreadObject, entry: MapObject) -> None:
        """Merge an object into an object of the map."""
        unread.partner = entry.number
        if unread.label:
            self._store.take_label(entry, unread.label, unread.merged_labels, unread.first_frame)
            unread.label, unread.merged_labels = entry.label, []

    def _merge_doubles(self, seen: Observation) -> None:
        """Merge two objects with the same rectangle; the older label, or else the older object, stays."""
        kept: list[tuple[UnreadObject, Predicted | None]] = []
        for unread in sorted(self._objects, key=lambda o: (o.label or np.inf, o.number)):
            view = predict(unread.center, unread.size_m, seen)
            shown = [(other, other_view) for other, other_view in kept if other_view is not None]
            if view is not None and shown:
                iou = rect_iou_matrix(
                    view.rect_xyxy[None], np.array([other_view.rect_xyxy for _, other_view in shown])
                )[0]
                if iou.max() >= SAME_IOU:
                    other = shown[int(iou.argmax())][0]
                    other.name_log_odds = merged_evidence(other.name_log_odds, unread.name_log_odds)
                    if unread.label and not unread.partner:
                        other.merged_labels = sorted({*other.merged_labels, *unread.merged_labels, unread.label})
                    other.log_odds, other.hits = max(other.log_odds, unread.log_odds), max(other.hits, unread.hits)
                    continue
            kept.append((unread, view))
        self._objects = sorted((unread for unread, _ in kept), key=lambda o: o.number)

    def _remove_unlikely(self) -> None:
        """Remove unlikely objects, and the least likely ones beyond the limit."""
        alive = [o for o in self._objects if o.log_odds > (-CERTAIN_LOG_ODDS if o.label else DROPPED)]
        best = sorted(alive, key=lambda o: (-bool(o.label), -o.log_odds, o.number))[:MAX_UNREAD]
        self._objects = sorted(best, key=lambda o: o.number)

    def sightings(self, shown: Sequence[Sighting], seen: Observation, planes: Planes) -> tuple[Sighting, ...]:
        """Return the sightings of a frame, including those of objects without depth readings, by label."""
        found = {sighting.label: sighting for sighting in shown}
        others = np.array([sighting.rect_xyxy for sighting in shown]).reshape(-1, 4)
        for unread in self._objects:
            partner = self._partner_of(unread)
            view = predict(unread.center, unread.size_m, seen) if unread.is_sure and (unread.label or partner) else None
            if view is None or view.visible < SEEN_FRACTION or view.read >= READ_FRACTION:
                continue
            rect = self._hit.get(unread.number, view.rect_xyxy)
            if partner is not None:
                old = found.get(partner.label, Sighting(partner.label, partner.box, None, view.visible, rect))
                found[partner.label] = Sighting(partner.label, old.box, old.iou, old.visible, rect)
            elif not len(others) or rect_iou_matrix(rect[None], others).max() < SAME_IOU:
                unread.frames_seen, unread.last_frame = unread.frames_seen + 1, seen.frame
                found[unread.label] = Sighting(unread.label, box_of(unread, planes)[0], None, view.visible, rect)
        self._hit = {}
        return tuple(found[label] for label in sorted(found))

    def _partner_of(self, unread: UnreadObject) -> MapObject | None:
        """Return the object of the map into which an object was merged; undo the merge if that one has been retired."""
        if unread.partner and (unread.partner not in self._store or not self._store[unread.partner].confirmed):
            unread.partner, unread.meetings = 0, {}
        return self._store[unread.partner] if unread.partner else None

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Move each object with the keyframe to which its last hit is anchored; see `ObjectMap.apply_correction`."""
        for unread in self._objects:
            T = moved.get(unread.keyframe)
            if T is not None:
                R, center = T[:3, :3], transform(T, unread.center)
                unread.information = R @ unread.information @ R.T
                unread.vector = unread.information @ center
                unread.views = np.hstack([unread.views[:, :3] @ R.T, unread.views[:, 3:]])
