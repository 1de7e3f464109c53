"""Queries of a scene file: its recordings, its objects and their changes."""

from __future__ import annotations

import sqlite3
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.core.results import MapPoints, SceneChange, SupportPlane
from cuboid.ground.core.values import Fraction, PinholeEntry
from cuboid.method.objects.naming import chosen_name
from cuboid.results.files.object_table import ObjectTable
from cuboid.results.files.queries import MapQueries
from cuboid.runs.scene.answers import PastRelation, SceneEvent, SceneObject, ScenePast, SceneRecording
from cuboid.runs.scene.database import open_to_read, user_errors
from cuboid.runs.scene.schema import BOX, DESCRIBED, LEAST_SHOWN, TABLES, Accuracy, Classes
from cuboid.runs.scene.validation import (
    Outline,
    Row,
    box_of,
    columns_of,
    document,
    read_rows,
    refuse_cycle,
    rotation_of,
)

if TYPE_CHECKING:
    from cuboid.ground.arrays import Float32Array
    from cuboid.method.text_search import TextModel
    from cuboid.runs.scene.vectors import SceneVector
    from cuboid.runs.tracking.posed_tracker import PosedTracker

_COLUMNS = tuple(name for name in TABLES["objects"].columns if not name.endswith("_spread") and "picture" not in name)
# Fields of an object whose columns have the same names.
_SAME = ("label", "state", "merged_into", *(one.name for one in DESCRIBED if not one.parts))
# Columns of queries; after its key, a table has its columns in the order of the declaration.
_PAST = (
    *columns_of("sightings", ("label", "recording", "frame")),
    "frames.time_s",
    *columns_of("boxes", BOX),
    *columns_of("sightings")[4:],
)
_EVENT = (
    *columns_of("events", ("label", "recording", "frame")),
    "frames.time_s",
    *columns_of("events")[3:],
)
_CHANGE = (
    *columns_of("changes", ("recording", "label")),
    "objects.name",
    "changes.change",
    *columns_of("objects", BOX),
    *columns_of("changes")[3:],
)


class SceneReader(MapQueries):
    """The contents of a scene file. Reading takes no lock, and sees the commits of other processes.

    Parameters
    ----------
    path : path
        The scene file; if it is missing, there are no recordings and no objects.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = as_path(path)
        self._read: sqlite3.Connection | None = None
        self._saved: tuple[int, PosedTracker] | None = None
        if self.path.exists():
            self._connection()

    def poses(self, recording: int) -> dict[int, tuple[float, Float64Array]]:
        """Return time and T_world_camera (4, 4), as stored, of each used frame of a recording, by frame."""
        columns = columns_of("frames", ("frame", "time_s", "qw", "qx", "qy", "qz", "tx", "ty", "tz"))
        rows = self._rows(columns, "frames WHERE recording = ? ORDER BY frame", (recording,))
        with user_errors(self.path):
            return {row[0]: (row[1], _pose(row[2:])) for row in rows}

    def intrinsics(self, recording: int) -> Intrinsics:
        """Return the intrinsics of the color images of a recording."""
        rows = self._rows(columns_of("recordings", ("camera",)), "recordings WHERE id = ?", (recording,))
        if not rows:
            raise InputError(f"{self.path}: there is no recording {recording}")
        with user_errors(self.path):
            return Intrinsics(**structs.asdict(document(rows[0][0], PinholeEntry, "recordings.camera")))

    @property
    def version(self) -> int:
        """A number that changes when another program commits."""
        if not self.path.exists():
            return 0
        with user_errors(self.path):
            number: int = self._connection().execute("PRAGMA data_version").fetchone()[0]
            return number

    @property
    def recordings(self) -> list[SceneRecording]:
        """The recordings, by number."""
        columns = columns_of("recordings", ("id", "path", "format", "poses", "begun", "complete", "frames"))
        used = dict(self._ask("SELECT recording, count(*) FROM frames GROUP BY recording"))
        return [
            SceneRecording(number, path, form, poses, begun, bool(complete), frames, used.get(number, 0))
            for number, path, form, poses, begun, complete, frames in self._rows(columns, "recordings ORDER BY id")
        ]

    @property
    def objects(self) -> ObjectTable:
        """The present objects, by label; each is a `SceneObject`."""
        return ObjectTable(item for item in self.all_objects if item.state == "present")

    @property
    def all_objects(self) -> list[SceneObject]:
        """All objects that ever had a label, by label."""
        rows = self._rows(columns_of("objects", _COLUMNS), "objects ORDER BY label")
        index_of = {identity: k for k, identity in enumerate(self._plane_identities())}
        with user_errors(self.path):
            merged: dict[int | None, list[int]] = defaultdict(list)
            refuse_cycle({row[0]: row[3] for row in rows})
            for label, _, _, merged_into, *_ in rows:
                merged[merged_into].append(label)
            begins = self._rows(("recordings.id", "recordings.first_frame"), "recordings ORDER BY id")
            found = [self._object(row, merged.get(row[0], ()), index_of, begins) for row in rows]
            texts = self._rows(("scene.value",), "scene WHERE key = ?", (LEAST_SHOWN,))
            least = max((document(text, Fraction, f"scene.{LEAST_SHOWN}") for (text,) in texts), default=0.0)
            return [
                replace(item, state="unlikely") if item.state == "present" and item.probability < least else item
                for item in found
            ]

    @property
    def planes(self) -> tuple[SupportPlane, ...]:
        """The supporting planes; `SceneObject.plane` is an index into them."""
        rows = self._rows(columns_of("planes", ("nx", "ny", "nz", "offset", "outline")), "planes ORDER BY identity")
        with user_errors(self.path):
            return tuple(_plane_of(row) for row in rows)

    def _plane_identities(self) -> list[int]:
        return [row[0] for row in self._rows(("planes.identity",), "planes ORDER BY identity")]

    @property
    def furniture(self) -> ObjectTable:
        """The furniture of recordings with `furniture`, by label, found in the map of the last commit.

        Frames are counted over all recordings.
        """
        from cuboid.runs.scene.furniture import known_furniture

        with self._saved_tracker() as tracker:
            if tracker is None:
                return ObjectTable()
            return known_furniture(tracker, tracker.map_points(), self.furniture_names)

    @property
    def furniture_names(self) -> dict[int, str]:
        """The names that users gave to furniture, by label."""
        from cuboid.runs.scene.furniture import read_names

        with user_errors(self.path):
            return read_names(self._connection())

    @property
    def furniture_planes(self) -> dict[int, tuple[int, ...]]:
        """Indices of the planes that each piece of furniture bears, by label, labels that ended in others included."""
        index_of = {identity: k for k, identity in enumerate(self._plane_identities())}
        with self._saved_tracker() as tracker:
            if tracker is None:
                return {}
            identities = tracker.plane_identities
            return {
                label: tuple(index_of[identities[k]] for k in planes)
                for label, planes in tracker.furniture_planes.items()
            }

    @property
    def up(self) -> Float64Array | None:
        """Up in the world, (3,), a unit vector; None while unknown."""
        with self._saved_tracker() as tracker:
            return None if tracker is None else tracker.up

    def map_points(self) -> MapPoints:
        """Return the global point map of the last commit.

        Raises
        ------
        InputError
            The state of the scene is damaged, or of another version.
        """
        with self._saved_tracker() as tracker:
            if tracker is None:
                return MapPoints(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), np.zeros(0, np.float32))
            return tracker.map_points()

    @contextmanager
    def _saved_tracker(self) -> Iterator[PosedTracker | None]:
        """Yield the tracker of the scene's last commit, within one reading transaction.

        The tracker is cached until the next commit; it is None if the scene has no state.
        """
        from cuboid.runs.scene.saving import has_state
        from cuboid.runs.scene.visit import load_tracker

        if not self.path.exists():
            yield None
            return
        with user_errors(self.path):
            connection = self._connection()
            connection.execute("BEGIN")
            try:
                saved = has_state(connection)
                version: int = connection.execute("PRAGMA data_version").fetchone()[0]
                if saved and (self._saved is None or self._saved[0] != version):
                    self._saved = version, load_tracker(connection, self.path)
                yield self._saved[1] if saved and self._saved is not None else None
            finally:
                connection.execute("COMMIT")

    def history(self, label: int) -> list[ScenePast]:
        """Return the sightings of an object and of labels merged into it, in order of time.

        Raises
        ------
        InputError
            No object ever had the label.
        """
        labels = self._labels_of(label)
        rest = (
            "sightings JOIN boxes ON boxes.id = sightings.box JOIN frames USING (recording, frame) "
            f"WHERE sightings.label IN ({', '.join('?' * len(labels))}) ORDER BY sightings.recording, sightings.frame"
        )
        with user_errors(self.path):
            return [_past_of(row) for row in self._rows(_PAST, rest, labels)]

    def events(self, label: int | None = None) -> list[SceneEvent]:
        """Return the events of objects in view of recordings, in order of time.

        Parameters
        ----------
        label : int, optional
            Only events of this object, and of labels merged into it.

        Raises
        ------
        InputError
            No object ever had the label.
        """
        labels = None if label is None else self._labels_of(label)
        rest = "events JOIN frames USING (recording, frame) ORDER BY events.recording, events.frame, events.label"
        with user_errors(self.path):
            found = [_event_of(row) for row in self._rows(_EVENT, rest)]
        return [event for event in found if labels is None or event.label in labels]

    def relation_history(self, label: int) -> list[PastRelation]:
        """Return present and past relations of an object, by kind and time, from recordings tracked with relations.

        Raises
        ------
        InputError
            No object ever had the label.
        """
        from cuboid.runs.scene.relations import past_relations

        labels = self._labels_of(label)
        rest = f"relations WHERE label IN ({', '.join('?' * len(labels))}) ORDER BY label, first_recording"
        items = [item for item in self.all_objects if item.state != "merged"]
        survivor = {old: item.label for item in items for old in item.merged_labels}
        plane = {identity: k for k, identity in enumerate(self._plane_identities())}
        return past_relations(self._rows(columns_of("relations"), rest, labels), survivor, plane)

    def changes(self, since: str | int | None = None) -> list[SceneChange]:
        """Return the changes that each recording found, by recording and label.

        Parameters
        ----------
        since : str or int, optional
            A date or time, ISO 8601, UTC, selects the recordings that began since then; the number of a recording
            selects this one and all later ones. Default: only the last recording.

        Raises
        ------
        InputError
            The date is invalid.
        """
        if isinstance(since, str):
            try:
                moment = datetime.fromisoformat(since)
                moment = moment.astimezone(UTC) if moment.tzinfo else moment.replace(tzinfo=UTC)
            except (ValueError, OverflowError):
                raise InputError(
                    f"expected a date such as 2026-01-31 or 2026-01-31T12:00, got {shown(since)}"
                ) from None
            begun = moment.isoformat(timespec="seconds")  # times in one text format sort as their texts do
            wanted = {recording.number for recording in self.recordings if recording.begun >= begun}
        else:
            first = len(self.recordings) if since is None else since
            wanted = {recording.number for recording in self.recordings if recording.number >= first}
        rows = self._rows(_CHANGE, "changes JOIN objects USING (label) ORDER BY recording, changes.label")
        with user_errors(self.path):
            return [_change_of(row) for row in rows if row[0] in wanted]

    def shown_changes(self, recording: int) -> list[SceneChange]:
        """Return objects that a recording found moved, gone, new or found, as the 3D page shows them."""
        shown = ("moved", "gone", "new", "found")
        return [
            change for change in self.changes(recording) if change.recording == recording and change.change in shown
        ]

    def picture(self, label: int) -> bytes | None:
        """Return an object's picture as JPEG; None where there is none."""
        rows = self._rows(("objects.picture",), "objects WHERE label = ?", (label,))
        return rows[0][0] if rows else None

    def vectors(self, model: TextModel) -> Mapping[int, Float32Array]:
        """Return the objects' vectors: the stored ones, else new ones from the scene's pictures."""
        from cuboid.runs.scene.vectors import is_of, read_vectors, vector_of_picture

        with user_errors(self.path):
            stored = read_vectors(self._connection(), model.identity) if self.path.exists() else {}
        pictures = {item.label: self.picture(item.label) for item in self.objects}
        found = {label: stored[label] for label, jpeg in pictures.items() if is_of(stored.get(label), jpeg)}
        others = {
            label: vector_of_picture(model, jpeg) for label, jpeg in pictures.items() if jpeg and label not in found
        }
        computed = {label: vector for label, vector in others.items() if vector is not None}
        if computed:
            self._keep_made(model, computed)
        return {label: vector.vector for label, vector in {**found, **computed}.items()}

    def _keep_made(self, model: TextModel, computed: Mapping[int, SceneVector]) -> None:
        """Store vectors that were computed from pictures, if the scene can be written."""

    def _labels_of(self, label: int) -> list[int]:
        """Return a label and those that were merged into it."""
        merged_into: dict[int, int | None] = dict(self._rows(("objects.label", "objects.merged_into"), "objects"))
        if label not in merged_into:
            raise InputError(f"{self.path}: no object has the label {label}")
        found = [label]
        for merged in found:
            found += [k for k, into in merged_into.items() if into == merged and k not in found]
        return found

    def _object(
        self,
        row: Row,
        merged: Iterable[int],
        index_of: Mapping[int, int],
        begins: Sequence[Row],
    ) -> SceneObject:
        values = dict(zip(_COLUMNS, row, strict=True))
        name, kind, accuracy = values["name"], values["kind"], values["accuracy"]
        sure = {} if accuracy is None else structs.asdict(document(accuracy, Accuracy, "objects.accuracy"))
        found = SceneObject(
            **{name: values[name] for name in _SAME},
            **chosen_name(document(values["classes"], Classes, "objects.classes")),
            merged_labels=tuple(merged),
            box=box_of([values[name] for name in BOX], "objects"),
            plane=None if values["plane"] is None else index_of.get(values["plane"]),
            mean_color=np.array((values["red"], values["green"], values["blue"])),
            first_seen=_seen(begins, values["first_frame"]),
            last_seen=_seen(begins, values["last_frame"]),
            **sure,
            **({} if kind is None else {"kind": kind}),
        )
        return found if name is None else found.with_given_name(name)

    def _ask(self, query: str) -> list[Any]:
        if not self.path.exists():
            return []
        with user_errors(self.path):
            return self._connection().execute(query).fetchall()

    def _rows(self, columns: Sequence[str], rest: str, values: Iterable[Any] = ()) -> list[Row]:
        if not self.path.exists():
            return []
        with user_errors(self.path):
            return read_rows(self._connection(), columns, rest, values)

    def _connection(self) -> sqlite3.Connection:
        if self._read is None:
            self._read = open_to_read(self.path)
        return self._read


def _seen(begins: Sequence[Row], frame: int) -> tuple[int, int]:
    """Return recording and index of a frame in the scene's count; `begins`: recordings with first frames."""
    for number, first in reversed(begins):
        if first <= frame:
            return number, frame - first
    return 0, frame  # its recording was lost with a damaged file


def _plane_of(row: Row) -> SupportPlane:
    """Return the plane of a row; raise DamagedError if its outline is invalid."""
    outline = np.array(document(row[4], Outline, "planes.outline"), np.float64)
    return SupportPlane(np.array(row[:3]), row[3], outline.reshape(-1, 3))


def _place_of(numbers: Sequence[float | None]) -> Float64Array | None:
    return None if None in numbers else np.array(numbers, np.float64)


def _change_of(row: Row) -> SceneChange:
    """Return the change of a row of `_CHANGE`; raise DamagedError if its box is invalid."""
    recording, label, name, change = row[:4]
    places = _place_of(row[14:17]), _place_of(row[17:20])
    return SceneChange(recording, label, name, change, box_of(row[4:14], "objects"), *places, *row[20:])


def _event_of(row: Row) -> SceneEvent:
    """Return the event of a row of `_EVENT`."""
    label, recording, frame, time_s, event = row[:5]
    places, score = (_place_of(row[5:8]), _place_of(row[8:11])), row[11]
    return SceneEvent(event, label, *places, score, recording=recording, frame=frame, time_s=time_s)


def _past_of(row: Row) -> ScenePast:
    """Return the sighting of a row of `_PAST`; raise DamagedError if its box is invalid."""
    label, recording, frame, time_s = row[:4]
    iou, visible, *rect = row[14:]
    seen = label, box_of(row[4:14], "boxes"), iou, visible, np.array(rect)
    return ScenePast(*seen, recording=recording, frame=frame, time_s=time_s)


def _pose(numbers: Sequence[float]) -> Float64Array:
    """Return the matrix (4, 4) of a quaternion (w first) and a translation."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_of(numbers[:4], "frames"), numbers[4:]
    return T
