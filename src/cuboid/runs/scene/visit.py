"""A recording in a scene: its row, its frames in the scene's count, and its progress."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.frame import Intrinsics
from cuboid.runs.scene import before
from cuboid.runs.scene.database import transaction
from cuboid.runs.scene.saving import SceneBlockStore, load_state
from cuboid.runs.scene.validation import columns_of, document, read_rows
from cuboid.runs.tracking.posed_tracker import PosedTracker

# A state that is loaded for reading or editing gets no frames: any camera will do.
ANY_CAMERA = Intrinsics(1.0, 1.0, 0.0, 0.0, 1, 1)


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """The description of a recording that a scene stores.

    Attributes
    ----------
    path : str
        Path of the recording.
    format : str
        Name of the recording's format.
    poses : str
        "given" or "estimated".
    frames : int
        Number of frames.
    intrinsics : Intrinsics
    settings : dict
        Settings of the tracking.
    """

    path: str
    format: str
    poses: str
    frames: int
    intrinsics: Intrinsics
    settings: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Visit:
    """A recording in a scene.

    Attributes
    ----------
    number : int
        Number of the recording, from 1.
    first_frame : int
        Scene number of the recording's first frame; the scene counts the frames of all recordings.
    next_frame : int
        Frame of the recording at which to continue.
    pixels : int
        Side of the block of recorded pixels that one pixel of the tracked frames covers.
    """

    number: int
    first_frame: int
    next_frame: int
    pixels: int

    def write(
        self,
        connection: sqlite3.Connection,
        next_frame: int,
        pending: Iterable[tuple[str, str]],
        *,
        complete: bool,
        ended: bool,
    ) -> None:
        """Write the progress of the recording, within the caller's transaction."""
        connection.executemany(
            "INSERT INTO pending (recording, file, text) VALUES (?, ?, ?)",
            [(self.number, file, text) for file, text in pending],
        )
        connection.execute(
            "UPDATE recordings SET next_frame = ?, complete = ?, frames = max(frames, ?), ended = ? WHERE id = ?",
            (next_frame, complete, next_frame, now() if ended else None, self.number),
        )
        if complete:
            connection.execute("DELETE FROM pending WHERE recording = ?", (self.number,))

    def write_settings(self, connection: sqlite3.Connection, settings: Mapping[str, Any]) -> None:
        """Replace the settings of the recording, within the caller's transaction."""
        connection.execute("UPDATE recordings SET settings = ? WHERE id = ?", (_as_text(settings), self.number))


def now() -> str:
    """Return the current time as text in the file's format: UTC, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def begin(connection: sqlite3.Connection, source: RecordingInfo, tracker: PosedTracker, path: str) -> Visit:
    """Add a recording to a scene, and note the scene's present contents; pending texts of earlier runs are dropped.

    Raises
    ------
    InputError
        The last run of the scene processed a part of the same recording and was interrupted.
    """
    _refuse_interrupted(connection, source, path)
    first = connection.execute("SELECT coalesce(max(first_frame + frames), 0) FROM recordings").fetchone()[0]
    with transaction(connection):
        connection.execute("DELETE FROM pending")
        before.begin(connection, tracker)
        row = {
            "path": source.path,
            "format": source.format,
            "poses": source.poses,
            "begun": now(),
            "first_frame": first,
            "frames": source.frames,
            "camera": _camera(source.intrinsics),
            "settings": _as_text(source.settings),
            "T_world_recording": np.eye(4).tobytes(),
        }
        places = ", ".join(f":{name}" for name in row)
        cursor = connection.execute(f"INSERT INTO recordings ({', '.join(row)}) VALUES ({places})", row)
    assert cursor.lastrowid is not None
    return Visit(cursor.lastrowid, first, 0, source.settings.get("scale", 1))


def _refuse_interrupted(connection: sqlite3.Connection, source: RecordingInfo, path: str) -> None:
    """Refuse to add a recording to a scene that ends with an interrupted part of it; remove a part without frames.

    The frames of a live camera (a source without a number of frames) are not available any more, so that its next run
    is always a recording of its own.
    """
    columns = ("id", "path", "complete", "next_frame")
    rows = read_rows(connection, columns_of("recordings", columns), "recordings ORDER BY id DESC LIMIT 1")
    if not rows or rows[0][1] != source.path or rows[0][2] or not source.frames:
        return
    number, _, _, next_frame = rows[0]
    if next_frame:
        raise InputError(
            f"{path}: the run of {source.path} was broken off before frame {next_frame}: --resume continues it, with "
            "the same options; another scene file starts again"
        )
    with transaction(connection):
        connection.execute("DELETE FROM pending WHERE recording = ?", (number,))
        connection.execute("DELETE FROM recordings WHERE id = ?", (number,))


def resume(connection: sqlite3.Connection, source: RecordingInfo, path: str) -> Visit:
    """Return the last recording of a scene, which was interrupted, to resume it.

    Raises
    ------
    InputError
        The recording was not interrupted, is another one, or was tracked with other settings.
    """
    columns = ("id", "path", "poses", "complete", "first_frame", "next_frame", "camera", "settings")
    rows = read_rows(connection, columns_of("recordings", columns), "recordings ORDER BY id DESC LIMIT 1")
    if not rows or rows[0][3]:
        raise InputError(f"{path}: --resume: no recording was broken off; without it, one is added")
    number, recording, poses, _, first_frame, next_frame, camera, settings = rows[0]
    if recording != source.path:
        raise InputError(f"{path}: --resume: the recording that was broken off is {recording}, not {source.path}")
    begun = document(settings, dict[str, Any], "recordings.settings")
    recorded = {"poses": poses, "camera": document(camera, dict[str, Any], "recordings.camera"), **begun}
    asked = {"poses": source.poses, "camera": json.loads(_camera(source.intrinsics)), **_plain(source.settings)}
    for name in sorted({*recorded, *asked}):
        if recorded.get(name) != asked.get(name):
            raise InputError(
                f"{path}: --resume: the run was begun with {name} = {shown(recorded.get(name))}, "
                f"not {shown(asked.get(name))}"
            )
    return Visit(number, first_frame, next_frame, begun.get("scale", 1))


def load_tracker(connection: sqlite3.Connection, path: Path) -> PosedTracker:
    """Return the tracker of a scene's last commit, to read its map; raise InputError if it is damaged."""
    return load_state(connection, ANY_CAMERA, block_store=SceneBlockStore(connection, path))[0]


def pending(connection: sqlite3.Connection, visit: Visit) -> dict[str, str]:
    """Return the contents of the result files, by name, at the interruption of a run."""
    texts: dict[str, list[str]] = {}
    columns = columns_of("pending", ("file", "text"))
    for file, text in read_rows(connection, columns, "pending WHERE recording = ? ORDER BY id", (visit.number,)):
        texts.setdefault(file, []).append(text)
    return {file: "".join(parts) for file, parts in texts.items()}


def _as_text(settings: Mapping[str, Any]) -> str:
    return json.dumps(settings, sort_keys=True)


def _plain(settings: Mapping[str, Any]) -> dict[str, Any]:
    plain: dict[str, Any] = json.loads(json.dumps(settings))
    return plain


def _camera(intrinsics: Intrinsics) -> str:
    return json.dumps(asdict(intrinsics))
