"""A scene: one file a place, opened, asked and extended."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.config import TrackerConfig
from cuboid.errors import InputError, shown
from cuboid.frame import Float64Array, Intrinsics
from cuboid.geometry.box import Box
from cuboid.limits import MEMORY_MB
from cuboid.proposals import make_source
from cuboid.proposals.types import ProposalSource
from cuboid.results import SceneChange
from cuboid.scene import before, editing
from cuboid.scene import visit as visits
from cuboid.scene.database import Writing, complaining, open_to_read, open_to_write, transaction
from cuboid.scene.door import BOX, Row, box_of, columns_of, rotation_of, told
from cuboid.scene.placing import ESTIMATED, OWN_WORLD, SAME_WORLD, ScenePoses
from cuboid.scene.saving import SceneShelf, has_state
from cuboid.scene.session import COMMIT_EVERY_S, OwnFrames, SceneTracker
from cuboid.scene.visit import Source
from cuboid.tracker import Tracker

# A name that people give has at most so many characters.
LONGEST_NAME = 100

_COLUMNS = (
    "label", "name", "state", "merged_into", *BOX, "score", "heat", "points", "red", "green", "blue", "first_frame",
    "last_frame", "frames_seen",
)  # fmt: skip
_PAST = (
    *columns_of("sightings", ("label", "iou", "recording", "frame")), "frames.time_s", *columns_of("boxes", BOX),
    *columns_of("sightings", ("visible", "x0", "y0", "x1", "y1")),
)  # fmt: skip
_CHANGE = (
    "changes.recording", "changes.label", "objects.name", "changes.change",
    *columns_of("changes", ("from_x", "from_y", "from_z", "to_x", "to_y", "to_z", "metres", "sure", "before", "after")),
    *columns_of("objects", BOX),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class SceneObject:
    """An object of a scene.

    Attributes
    ----------
    label : int
    name : str
        What people call it; empty where nobody gave it a name.
    state : str
        "present", "gone", "merged" or "forgotten".
    merged_into : int or None
        The label that it lives on under, where it was merged.
    box : Box
        In the scene's world, as known last.
    score : float
        Confidence that it is an object, 0..1.
    heat : float
        Mean heat of its points, 0..1.
    points : int
        Voxels that its box was fitted to.
    mean_color : (3,) float64
        RGB, 0..255.
    first_seen, last_seen : (int, int)
        Recording and frame of it.
    frames_seen : int
    """

    label: int
    name: str
    state: str
    merged_into: int | None
    box: Box
    score: float
    heat: float
    points: int
    mean_color: Float64Array
    first_seen: tuple[int, int]
    last_seen: tuple[int, int]
    frames_seen: int


@dataclass(frozen=True, slots=True)
class SceneRecording:
    """A recording that went into a scene.

    Attributes
    ----------
    number : int
        From 1.
    path, format, poses : str
    begun : str
        When tracking it began, UTC, ISO 8601.
    complete : bool
        False where the run was broken off.
    frames : int
        How many it has.
    frames_used : int
        Of these, so many have a pose.
    """

    number: int
    path: str
    format: str
    poses: str
    begun: str
    complete: bool
    frames: int
    frames_used: int


@dataclass(frozen=True, slots=True)
class ScenePast:
    """A sighting of an object.

    Attributes
    ----------
    label : int
        That it had then.
    recording, frame : int
    time_s : float
        Of the frame, as the recording tells it.
    box : Box
        In the scene's world, as known then.
    iou : float or None
        Overlap of the frame's own box with it; None where the frame has none.
    visible : float
        Share of its near side that was seen, 0..1.
    rect_xyxy : (4,) float64
        Pixels of the image.
    """

    label: int
    recording: int
    frame: int
    time_s: float
    box: Box
    iou: float | None
    visible: float
    rect_xyxy: Float64Array


class Scene:
    """A scene in its file: map, objects and labels, which each recording extends.

    Use it as a context manager. Reading takes no lock: what another one commits meanwhile is seen. The first call
    that writes takes the only right to write, and keeps it until the scene is closed.

    Parameters
    ----------
    path : Path
        Of the file; it is made by the first call that writes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._read: sqlite3.Connection | None = None
        self._write: Writing | None = None
        self._shelf: sqlite3.Connection | None = None
        self._tracker: SceneTracker | None = None
        if path.exists():
            self._connection()

    @classmethod
    def open(cls, path: str | Path) -> Scene:
        """Open a scene, or one that is to be made.

        Raises
        ------
        InputError
            The file is no scene, damaged, or of a newer version.
        """
        return cls(Path(path))

    def __enter__(self) -> Scene:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if self._tracker is not None and kind is None:
                self._tracker.close()
            elif self._tracker is not None:
                with suppress(Exception):  # what went wrong first is what is told
                    self._tracker.close(complete=False)
        finally:
            self.close()

    def close(self) -> None:
        """Let the file go; what was not committed is dropped."""
        if self._tracker is not None:
            self._tracker.drop()
            self._tracker = None
        if self._shelf is not None:
            self._shelf.close()
            self._shelf = None
        if self._read is not None:
            self._read.close()
            self._read = None
        if self._write is not None:
            self._write.close()
            self._write = None

    def tracker(
        self,
        intrinsics: Intrinsics,
        config: TrackerConfig | None = None,
        proposals: str | ProposalSource | None = None,
        *,
        source: Source | None = None,
        same_world: bool = True,
        resume: bool = False,
        commit_every_s: float = COMMIT_EVERY_S,
        memory_mb: float = MEMORY_MB,
    ) -> SceneTracker:
        """Begin a recording whose frames have poses in the scene's world, or go on with one that was broken off.

        Parameters
        ----------
        intrinsics : Intrinsics
            Of every frame.
        config : TrackerConfig, optional
            The scene's own, unless it is new.
        proposals : str or ProposalSource, optional
            As for `Tracker`.
        source : Source, optional
            What the scene is told of the recording.
        same_world : bool
            Given poses are in the scene's world; else they are aligned with it by `SceneTracker.poses`.
        resume : bool
            Go on with the last recording, from the frame `visit.next_frame` on.
        commit_every_s : float
        memory_mb : float
            As for `Tracker`.

        Raises
        ------
        InputError
            The scene's state is damaged or of another version; there is nothing to resume; `config` is not that of
            the scene; poses are to be aligned with a scene that has no keyframes.
        OutputError
            Another one writes the scene, or it cannot be written.
        """
        source = source or Source("", "frames", "given", 0, intrinsics, {})
        if self._tracker is not None:
            self._tracker.close()
        file = self._writing()
        connection = file.connection
        with complaining(self.path):
            own = OwnFrames(make_source(proposals))
            tracker = Tracker(intrinsics, config, own, memory_mb=memory_mb)
            poses = ScenePoses(intrinsics, tracker.config)
            if self._shelf is not None:
                self._shelf.close()
            self._shelf = open_to_read(self.path)
            shelf = SceneShelf(self._shelf, self.path)
            if has_state(connection):
                tracker, poses = self._going_on(connection, config, tracker, shelf)
            else:  # it may have had a state, and lost it with a damaged file
                tracker.begin_labels(
                    1 + connection.execute("SELECT coalesce(max(label), 0) FROM objects").fetchone()[0]
                )
            mode = ESTIMATED if source.poses == "estimated" else SAME_WORLD if same_world else OWN_WORLD
            if resume:
                visit = visits.resume(connection, source, str(self.path))
            else:
                if mode == OWN_WORLD and self.recordings and not poses.knows_places:
                    raise InputError(
                        f"{self.path}: has no keyframes to recognise the place by; --same-world says that the "
                        "recording's poses are in the scene's world"
                    )
                visit = visits.begin(connection, source, np.eye(4), tracker)
            stood = before.load(connection)
            stood.watch(tracker.voxels)
            if visit.next_frame == 0:
                poses.begin(mode, first=visit.number == 1)
                if visit.number > 1:
                    tracker.begin_visit()
            own.first_frame = visit.first_frame
            columns = columns_of("objects", ("label", "name"))
            names: dict[int, str] = dict(told(connection, columns, "objects WHERE name IS NOT NULL"))
        self._tracker = SceneTracker(self.path, file, tracker, poses, visit, names, commit_every_s, shelf, stood)
        return self._tracker

    def _going_on(
        self,
        connection: sqlite3.Connection,
        config: TrackerConfig | None,
        fresh: Tracker,
        shelf: SceneShelf,
    ) -> tuple[Tracker, ScenePoses]:
        """Return tracker and poses as the scene has them."""
        tracker, poses = visits.load(connection, fresh, shelf)
        if config is not None:
            own = tracker.config.to_dict()
            for name, value in config.to_dict().items():
                default = getattr(TrackerConfig(), name)
                if value not in (default, own[name]):
                    raise InputError(f"{self.path}: the scene was made with {name} = {own[name]:g}, not {value:g}")
        return tracker, poses

    def pending(self) -> dict[str, str]:
        """Return what the files of the results held when the run that is gone on with was broken off, by name."""
        assert self._tracker is not None
        assert self._write is not None
        with complaining(self.path):
            return visits.pending(self._write.connection, self._tracker.visit)

    def poses(self, recording: int) -> dict[int, tuple[float, Float64Array]]:
        """Return time and T_world_camera (4, 4) of each used frame of a recording, as they were told then, by frame."""
        columns = columns_of("frames", ("frame", "time_s", "qw", "qx", "qy", "qz", "tx", "ty", "tz"))
        rows = self._told(columns, "frames WHERE recording = ? ORDER BY frame", (recording,))
        with complaining(self.path):
            return {row[0]: (row[1], _pose(row[2:])) for row in rows}

    @property
    def recordings(self) -> list[SceneRecording]:
        """The recordings, by number."""
        columns = columns_of("recordings", ("id", "path", "format", "poses", "begun", "complete", "frames"))
        used = dict(self._ask("SELECT recording, count(*) FROM frames GROUP BY recording"))
        return [
            SceneRecording(number, path, form, poses, begun, bool(complete), frames, used.get(number, 0))
            for number, path, form, poses, begun, complete, frames in self._told(columns, "recordings ORDER BY id")
        ]

    @property
    def objects(self) -> list[SceneObject]:
        """The objects that are there, by label."""
        return [item for item in self.all_objects if item.state == "present"]

    @property
    def all_objects(self) -> list[SceneObject]:
        """All objects that ever had a label, by label."""
        rows = self._told(columns_of("objects", _COLUMNS), "objects ORDER BY label")
        with complaining(self.path):
            return [self._object(row) for row in rows]

    def at(self, point: npt.ArrayLike, radius: float) -> list[SceneObject]:
        """Return the objects whose boxes come within a radius, metres, of a point (3,) of the world, nearest first."""
        place = np.asarray(point, np.float64)
        near = []
        for item in self.objects:
            beyond = np.abs((place - item.box.center) @ item.box.rotation) - item.box.size / 2
            near.append((float(np.linalg.norm(np.maximum(beyond, 0.0))), item.label, item))
        return [item for distance, _, item in sorted(near, key=lambda one: one[:2]) if distance <= radius]

    def history(self, label: int) -> list[ScenePast]:
        """Return the sightings of an object, in order of time; those of labels that were merged into it too.

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
        with complaining(self.path):
            return [
                ScenePast(
                    label, recording, frame, time_s, box_of(rest[:10], "boxes"), iou, rest[10], np.array(rest[11:])
                )
                for label, iou, recording, frame, time_s, *rest in self._told(_PAST, rest, labels)
            ]

    def changes(self, since: str | int | None = None) -> list[SceneChange]:
        """Return what each recording found changed, by recording and label.

        Parameters
        ----------
        since : str or int, optional
            A date or time, ISO 8601, UTC: the recordings begun since then; or the number of a recording: those from it
            on. The last one alone unless given.

        Raises
        ------
        InputError
            The date is none.
        """
        if isinstance(since, str):
            try:
                moment = datetime.fromisoformat(since)
                moment = moment.astimezone(UTC) if moment.tzinfo else moment.replace(tzinfo=UTC)
            except (ValueError, OverflowError):
                raise InputError(
                    f"expected a date such as 2026-01-31 or 2026-01-31T12:00, got {shown(since)}"
                ) from None
            # written alike, times are in the order of their texts
            wanted = [one.number for one in self.recordings if one.begun >= moment.isoformat(timespec="seconds")]
        else:
            last = len(self.recordings)
            wanted = [one.number for one in self.recordings if one.number >= (last if since is None else since)]
        rows = self._told(_CHANGE, "changes JOIN objects USING (label) ORDER BY recording, changes.label")
        with complaining(self.path):
            return [_change_of(row) for row in rows if row[0] in wanted]

    def shown_changes(self, recording: int) -> list[SceneChange]:
        """Return what was moved, is gone, is new or was found in a recording, as the 3D page shows it."""
        shown = ("moved", "gone", "new", "found")
        return [one for one in self.changes(recording) if one.recording == recording and one.change in shown]

    def picture(self, label: int) -> bytes | None:
        """Return an object's picture as JPEG; None where there is none."""
        rows = self._told(("objects.picture",), "objects WHERE label = ?", (label,))
        return rows[0][0] if rows else None

    def name(self, label: int, name: str) -> None:
        """Give an object a name, or take it away with an empty one.

        Raises
        ------
        InputError
            No object has the label, or the name is no single line of at most 100 characters.
        """
        name = name.strip()
        if not name.isprintable() or len(name) > LONGEST_NAME:
            raise InputError(f"{self.path}: a name is one line of at most {LONGEST_NAME} characters, got '{name}'")
        self._labels_of(label)
        self._change("UPDATE objects SET name = ? WHERE label = ?", (name or None, label))

    def merge(self, one: int, two: int) -> int:
        """Make one object of two that are one; return the label that stays, the older.

        Raises
        ------
        InputError
            One of them is not there, or they are the same.
        """
        connection = self._writing().connection
        with complaining(self.path):
            return editing.merge(connection, str(self.path), one, two)

    def forget(self, label: int) -> None:
        """Let an object be none: its label is never given again, and what is seen there may become another one.

        Raises
        ------
        InputError
            No object ever had the label.
        """
        self._labels_of(label)
        connection = self._writing().connection
        with complaining(self.path):
            editing.forget(connection, str(self.path), label)

    def write_results(self, folder: Path, recording: int | None = None, *, force: bool = False) -> None:
        """Write a result folder, as `cuboid track` leaves it, of a recording: the last one unless given.

        Raises
        ------
        InputError
            There is no such recording, or the scene has no state.
        OutputError
            The results cannot be written.
        """
        from cuboid.scene.results_of import write_results

        with complaining(self.path):
            number = len(self.recordings) if recording is None else recording
            connection = self._connection()
            connection.execute("BEGIN")  # all that is read is of one moment
            try:
                write_results(self, connection, number, folder, force=force)
            finally:
                connection.execute("COMMIT")

    def compact(self) -> None:
        """Write the file anew without the room that is free in it."""
        connection = self._writing().connection
        with complaining(self.path):
            with transaction(connection):
                connection.execute("DELETE FROM boxes WHERE id NOT IN (SELECT box FROM sightings)")
            connection.execute("VACUUM")

    def _labels_of(self, label: int) -> list[int]:
        """Return a label and those that were merged into it."""
        known: dict[int, int | None] = dict(self._told(("objects.label", "objects.merged_into"), "objects"))
        if label not in known:
            raise InputError(f"{self.path}: no object has the label {label}")
        found = [label]
        for one in found:
            found += [k for k, into in known.items() if into == one and k not in found]
        return found

    def _object(self, row: Sequence[Any]) -> SceneObject:
        label, name, state, merged_into = row[:4]
        box, color = box_of(row[4:14], "objects"), np.array(row[17:20])
        return SceneObject(
            label, name or "", state, merged_into, box, row[14], row[15], row[16], color,
            self._place(row[20]), self._place(row[21]), row[22],
        )  # fmt: skip

    def _place(self, frame: int) -> tuple[int, int]:
        """Return recording and frame of a frame by the scene's count."""
        columns = ("recordings.id", "recordings.first_frame")
        rows = self._told(columns, "recordings WHERE first_frame <= ? ORDER BY id DESC LIMIT 1", (frame,))
        number, first = rows[0] if rows else (0, 0)  # its recording was lost with a damaged file
        return number, frame - first

    def _ask(self, query: str) -> list[Any]:
        if not self.path.exists():
            return []
        with complaining(self.path):
            return self._connection().execute(query).fetchall()

    def _told(self, columns: Sequence[str], rest: str, values: Iterable[Any] = ()) -> list[Row]:
        if not self.path.exists():
            return []
        with complaining(self.path):
            return told(self._connection(), columns, rest, values)

    def _change(self, query: str, values: Iterable[Any]) -> None:
        connection = self._writing().connection
        with complaining(self.path), transaction(connection):
            connection.execute(query, tuple(values))

    def _connection(self) -> sqlite3.Connection:
        if self._read is None:
            self._read = open_to_read(self.path)
        return self._read

    def _writing(self) -> Writing:
        if self._tracker is not None:
            self._tracker.settle()
        if self._write is None:
            self._write = open_to_write(self.path, create=True)
        return self._write


def _place_of(numbers: Sequence[float | None]) -> Float64Array | None:
    return None if None in numbers else np.array(numbers, np.float64)


def _change_of(row: Row) -> SceneChange:
    """Return what a row of `_CHANGE` says; DamagedError where its box is none."""
    recording, label, name, change, *rest = row
    (metres, sure, before, after), box = rest[6:10], box_of(rest[10:], "objects")
    places = _place_of(rest[:3]), _place_of(rest[3:6])
    return SceneChange(recording, label, name or "", change, box, *places, metres, sure, before, after)


def _pose(numbers: Sequence[float]) -> Float64Array:
    """Return the matrix (4, 4) of a quaternion (w first) and a translation."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_of(numbers[:4], "frames"), numbers[4:]
    return T
