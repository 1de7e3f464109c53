"""Rows of a scene that people and other programs read: frames, sightings, objects and planes."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import msgspec
import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.records import box_numbers
from cuboid.ground.core.results import FrameResult, Sighting, SupportPlane, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation
from cuboid.method.boxes.uncertainty import Uncertainty
from cuboid.method.objects.entry import MapObject, State
from cuboid.method.objects.naming import name_scores
from cuboid.results.files.text import LENGTH, rounded, rounded_list
from cuboid.runs.scene.schema import BOX, DESCRIBED, LEAST_SHOWN, TABLES, Accuracy
from cuboid.runs.tracking.posed_tracker import PosedTracker

Row = tuple[Any, ...]

# Minimum ratio of qualities at which a new picture replaces the old one: the object is larger or less hidden.
BETTER = 1.5
# Longest side of a picture, pixels; margin around the object, as a fraction of its size; JPEG quality.
LONGEST_PX, MARGIN_FRACTION, QUALITY = 160, 0.15, 85

# Number of classes that are kept of an object (its name and the next three), and largest length of a class name.
CLASSES, LONGEST_CLASS = 4, 100

_WRITTEN_APART = ("name", "picture", "picture_share", "kind")
OBJECT_COLUMNS = tuple(name for name in TABLES["objects"].columns if name not in _WRITTEN_APART)
_REPLACED = [name for name in OBJECT_COLUMNS if name not in ("label", "state", "classes", "accuracy")]
_UPSERT = (
    f"INSERT INTO objects ({', '.join(OBJECT_COLUMNS)}) VALUES ({', '.join(f':{c}' for c in OBJECT_COLUMNS)}) "
    f"ON CONFLICT (label) DO UPDATE SET {', '.join(f'{c} = excluded.{c}' for c in _REPLACED)}, "
    "state = CASE objects.state WHEN 'forgotten' THEN 'forgotten' ELSE excluded.state END, "
    "classes = CASE excluded.classes WHEN '[]' THEN objects.classes ELSE excluded.classes END, "
    "accuracy = coalesce(excluded.accuracy, objects.accuracy)"
)


@dataclass(slots=True)
class Rows:
    """Rows that wait for the next commit.

    Attributes
    ----------
    frames, sightings, boxes, events : list of tuple
        Rows in the order of their tables' columns.
    planes : list of (int, SupportPlane) or None
        Planes with their identities.
    objects : list of (MapObject, Accuracy or None, int)
        Objects as they were, with 0, or without accuracy and with the label of an object that was merged into them.
    merged : list of (int, int)
        Merged labels, each with the label into which it was merged.
    without_depth : list of (TrackedObject, int)
        Objects without usable depth, as they were, with the label of the row: their own, or one merged into them.
    kinds : dict of int to str or None
        New kinds of labels whose kind changed; None for volumes. Labels that are not listed keep the scene's entry.
    ended : list of int
        Labels of objects without usable depth that no longer exist.
    min_probability : float
        Objects with a lower probability are not among the present ones.
    pictures : dict of int to (float, bytes)
        Quality of each object's picture, and the picture as JPEG.
    """

    frames: list[Row] = field(default_factory=list)
    sightings: list[Row] = field(default_factory=list)
    boxes: list[Row] = field(default_factory=list)
    events: list[Row] = field(default_factory=list)
    planes: list[tuple[int, SupportPlane]] | None = None
    objects: list[tuple[MapObject, Accuracy | None, int]] = field(default_factory=list)
    merged: list[tuple[int, int]] = field(default_factory=list)
    pictures: dict[int, tuple[float, bytes]] = field(default_factory=dict)
    without_depth: list[tuple[TrackedObject, int]] = field(default_factory=list)
    kinds: dict[int, str | None] = field(default_factory=dict)
    ended: list[int] = field(default_factory=list)
    min_probability: float = 0.0

    def write(self, connection: sqlite3.Connection) -> None:
        """Write all rows, within the caller's transaction."""
        many = connection.executemany
        many(f"INSERT OR REPLACE INTO frames VALUES ({', '.join('?' * 10)})", self.frames)
        many(f"INSERT INTO boxes VALUES ({', '.join('?' * 12)})", self.boxes)
        many(f"INSERT OR REPLACE INTO sightings VALUES ({', '.join('?' * 10)})", self.sightings)
        many(f"INSERT OR REPLACE INTO events VALUES ({', '.join('?' * 11)})", self.events)
        if self.planes is not None:
            connection.execute("DELETE FROM planes")
            many("INSERT INTO planes VALUES (?, ?, ?, ?, ?, ?)", (_plane_row(*plane) for plane in self.planes))
        connection.execute("INSERT OR REPLACE INTO scene VALUES (?, ?)", (LEAST_SHOWN, str(self.min_probability)))
        many(_UPSERT, (_object_row(*row) for row in self.objects))
        many(_UPSERT, (_row_without_depth(item, label) for item, label in self.without_depth))
        many("UPDATE objects SET kind = ? WHERE label = ?", [(kind, label) for label, kind in self.kinds.items()])
        many("UPDATE objects SET state = 'gone' WHERE label = ? AND state = 'present'", [(k,) for k in self.ended])
        many("UPDATE objects SET state = 'merged', merged_into = ? WHERE label = ?", [(b, a) for a, b in self.merged])
        many(
            "UPDATE objects SET picture_share = ?, picture = ? WHERE label = ?",
            [(quality, picture, label) for label, (quality, picture) in self.pictures.items()],
        )


class Records:
    """Collects the rows of one recording.

    Parameters
    ----------
    connection : sqlite3.Connection
        Connection to the scene, whose contents are continued.
    recording : int
        Number of the recording.
    pixels : int
        Side of the block of the recording's pixels that one pixel of the frames covers.
    """

    def __init__(self, connection: sqlite3.Connection, recording: int, pixels: int = 1) -> None:
        self._recording = recording
        self._rows = Rows()
        self._next_box: int = 1 + connection.execute("SELECT coalesce(max(id), 0) FROM boxes").fetchone()[0]
        self._box_of: dict[int, tuple[Box, int]] = {}
        self._written: dict[int, tuple[object, ...]] = {}
        self._merged = {k for (k,) in connection.execute("SELECT label FROM objects WHERE merged_into IS NOT NULL")}
        self._kinds = dict(connection.execute("SELECT label, kind FROM objects WHERE kind IS NOT NULL"))
        self._pixels = pixels
        self._pictures = BestPictures(dict(connection.execute("SELECT label, picture_share FROM objects")))
        # First frame and number of frames of each object that this recording has seen, by label.
        self.seen: dict[int, tuple[int, int]] = {
            label: (first, count)
            for label, first, count in connection.execute(
                "SELECT label, min(frame), count(*) FROM sightings WHERE recording = ? GROUP BY label", (recording,)
            )
        }

    def add(self, frame: Frame, result: FrameResult) -> None:
        """Add a frame, numbered within the recording, and its results."""
        w, x, y, z = quat_wxyz_from_rotation(result.T_world_camera[:3, :3]).tolist()
        place = result.T_world_camera[:3, 3].tolist()
        self._rows.frames.append((self._recording, frame.index, frame.timestamp_s, *place, x, y, z, w))
        for seen in result.sightings:
            box = self._box(seen.label, seen.box)
            rect = (seen.rect_xyxy * self._pixels).tolist()
            self._rows.sightings.append((self._recording, frame.index, seen.label, box, seen.iou, seen.visible, *rect))
            first, count = self.seen.get(seen.label, (frame.index, 0))
            self.seen[seen.label] = first, count + 1
        for event in result.events:
            places = (None if place is None else place.tolist() for place in (event.from_m, event.to_m))
            before, after = (place or [None] * 3 for place in places)
            self._rows.events.append(
                (self._recording, frame.index, event.label, event.event, *before, *after, event.score)
            )
        picture = self._pictures.take(frame, result.sightings)
        if picture is not None:
            label, quality, jpeg = picture
            self._rows.pictures[label] = quality, jpeg

    def take(self, tracker: PosedTracker) -> Rows:
        """Return all rows since the last call, with the tracker's objects and planes as they are now."""
        rows, self._rows = self._rows, Rows()
        rows.min_probability = tracker.config.min_probability
        self._objects(tracker, rows)
        self._objects_without_depth(tracker, rows)
        rows.planes = list(zip(tracker.plane_identities, tracker.planes, strict=True))
        return rows

    def _box(self, label: int, box: Box) -> int:
        last = self._box_of.get(label)
        if last is not None and last[0] is box:
            return last[1]
        number = self._next_box
        self._box_of[label] = box, number
        self._rows.boxes.append((number, label, *box_numbers(box)))
        self._next_box += 1
        return number

    def _objects(self, tracker: PosedTracker, rows: Rows) -> None:
        for entry in tracker.ever_labelled():
            plane = tracker.support.find(entry.plane)
            identity = None if plane is None else plane.identity
            counts = entry.frames_seen, entry.last_frame, len(entry.merged_labels)
            accuracy = entry.directions, entry.sides_m
            now = (entry.box, entry.points, entry.state, *counts, identity, entry.name_log_odds, *accuracy)
            if not _same(self._written.get(entry.label), now):
                # The attributes' values are replaced, never modified: the copy stays as it is.
                copied = replace(entry, plane=identity, box=tracker.in_world(entry.box))
                newly_merged = [(copied, None, k) for k in entry.merged_labels if k not in self._merged]
                rows.objects += [(copied, _accuracy_of(tracker.uncertainty(entry)), 0), *newly_merged]
                rows.merged += [(k, entry.label) for k in entry.merged_labels]
                self._merged |= {*entry.merged_labels}
                self._written[entry.label] = now

    def _objects_without_depth(self, tracker: PosedTracker, rows: Rows) -> None:
        """Add objects without usable depth; those missing now became a volume, were merged, or ended."""
        items = tracker.objects_without_depth()
        now: dict[int, str | None] = {item.label: item.kind for item in items}
        newly_merged = [(item, k) for item in items for k in item.merged_labels if k not in self._merged]
        rows.without_depth = [*((item, item.label) for item in items), *newly_merged]
        rows.merged += [(k, item.label) for item in items for k in item.merged_labels]
        self._merged |= {k for _, k in newly_merged}
        volumes = {label for entry in tracker.ever_labelled() for label in (entry.label, *entry.merged_labels)}
        missing = self._kinds.keys() - now.keys()
        rows.kinds = {label: kind for label, kind in now.items() if self._kinds.get(label) != kind}
        rows.kinds |= dict.fromkeys(sorted(missing & volumes))
        rows.ended = sorted(missing - volumes - self._merged)
        self._kinds = {k: kind for k, kind in self._kinds.items() if k not in volumes} | {
            k: kind for k, kind in now.items() if kind is not None
        }


class BestPictures:
    """Takes a picture of an object that is seen much better than before, at most one per frame.

    Parameters
    ----------
    quality : dict of int to float, optional
        Quality of each object's present picture, by label.
    """

    def __init__(self, quality: dict[int, float] | None = None) -> None:
        self._quality = {} if quality is None else quality

    def take(self, frame: Frame, sightings: Iterable[Sighting]) -> tuple[int, float, bytes] | None:
        """Return label, quality and JPEG of the object whose quality rose by the largest factor, or None."""
        best: tuple[float, Sighting, float] | None = None
        for seen in sightings:
            x0, y0, x1, y1 = seen.rect_xyxy
            quality = seen.visible * float(np.sqrt(max(0.0, (x1 - x0) * (y1 - y0))))
            times = quality / max(self._quality.get(seen.label, 0.0), 1.0)
            if times > BETTER and (best is None or times > best[0]):
                best = times, seen, quality
        if best is None:
            return None
        _, seen, quality = best
        picture = picture_of(frame, seen.rect_xyxy)
        if not picture:
            return None
        self._quality[seen.label] = quality
        return seen.label, quality, picture


def picture_of(frame: Frame, rect_xyxy: Float64Array) -> bytes:
    """Return a rectangle of a frame's color image, with a margin, as JPEG; empty if the crop is empty."""
    height, width = frame.color.shape[:2]
    x0, y0, x1, y1 = rect_xyxy
    dx, dy = MARGIN_FRACTION * (x1 - x0), MARGIN_FRACTION * (y1 - y0)
    left, right = max(0, int(x0 - dx)), min(width, int(np.ceil(x1 + dx)))
    top, bottom = max(0, int(y0 - dy)), min(height, int(np.ceil(y1 + dy)))
    if right - left < 2 or bottom - top < 2:
        return b""
    part = frame.color[top:bottom, left:right, ::-1]
    scale = LONGEST_PX / max(part.shape[:2])
    if scale < 1:
        size = max(1, round(part.shape[1] * scale)), max(1, round(part.shape[0] * scale))
        part = np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_AREA), np.uint8)
    success, data = cv2.imencode(".jpg", np.ascontiguousarray(part), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return data.tobytes() if success else b""


def _same(before: tuple[object, ...] | None, after: tuple[object, ...]) -> bool:
    """Return whether values are unchanged; arrays and boxes are compared by identity: they are never modified."""
    if before is None:
        return False
    return all(a is b or (isinstance(a, int) and a == b) for a, b in zip(before, after, strict=True))


def _object_row(entry: MapObject, accuracy: Accuracy | None, label: int) -> dict[str, Any]:
    """Return an object's row, or with a label the row of an object that was merged into it."""
    colors = entry.colors if len(entry.colors) else np.zeros((1, 3))
    return {
        "label": label or entry.label,
        "state": "gone" if entry.state is State.RETIRED else "present",
        "merged_into": None,
        "plane": entry.plane,
        **{column.name: getattr(entry, column.name, None) for column in DESCRIBED if not column.parts},
        "points": len(entry.points),
        **dict(zip(BOX, box_numbers(entry.box), strict=True)),
        **dict(zip(("red", "green", "blue"), colors.mean(0).tolist(), strict=True)),
        **dict(zip(("red_spread", "green_spread", "blue_spread"), colors.std(0).tolist(), strict=True)),
        "classes": _classes_text([] if label else name_scores(entry.name_log_odds)),
        "accuracy": None if accuracy is None else _as_json(accuracy),
    }


def _row_without_depth(item: TrackedObject, label: int) -> dict[str, Any]:
    """Return the row, under this label, of an object without usable depth."""
    return {
        "label": label,
        "state": "present",
        "merged_into": None,
        "plane": None,
        **{name: value for column in DESCRIBED for name, value in zip(column.names, column.values(item), strict=True)},
        **dict(zip(BOX, box_numbers(item.box), strict=True)),
        **dict.fromkeys(("red_spread", "green_spread", "blue_spread"), 0.0),
        "classes": _classes_text([*_present_class(item), *item.names]),
        "accuracy": _as_json(_accuracy_of(item)),
    }


def _accuracy_of(item: TrackedObject | Uncertainty) -> Accuracy:
    length_m, width_m, height_m = rounded_list(item.size_sigma_m, LENGTH)
    return Accuracy((length_m, width_m, height_m), tuple(rounded_list(item.center_sigma_m, LENGTH)), item.sides_seen)


def _present_class(item: TrackedObject) -> list[tuple[str, float]]:
    return [] if item.name is None or item.name_score is None else [(item.name, item.name_score)]


def _classes_text(classes: Sequence[tuple[str, float]]) -> str:
    """Return detected classes, the most likely first, as text for their column."""
    return _as_json([(name[:LONGEST_CLASS], rounded(score, LENGTH)) for name, score in classes[:CLASSES]])


def _as_json(value: object) -> str:
    return msgspec.json.encode(value).decode()


def _plane_row(identity: int, plane: SupportPlane) -> Row:
    """Return a plane's row."""
    return identity, *plane.normal.tolist(), plane.offset, json.dumps(np.round(plane.extent, 4).tolist())
