"""Changes that people make to a scene: merge objects, remove false ones."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cuboid.core.errors import InputError
from cuboid.objects.entry import MapObject
from cuboid.scene.database import transaction
from cuboid.scene.records import Records
from cuboid.scene.saving import SceneBlockStore, StateFile, load_state
from cuboid.scene.visit import ANY_CAMERA
from cuboid.tracking.posed_tracker import PosedTracker


@contextmanager
def edited(connection: sqlite3.Connection, path: str) -> Iterator[PosedTracker]:
    """Give the tracker of a scene, and save what was done with it."""
    block_store = SceneBlockStore(connection, Path(path))
    tracker, poses = load_state(connection, ANY_CAMERA, block_store=block_store)
    state = StateFile(connection, tracker, poses, block_store)
    yield tracker
    records = Records(connection, 0)
    with transaction(connection):
        state.write(connection, state.snapshot())
        records.take(tracker).write(connection)


def merge(connection: sqlite3.Connection, path: str, one: int, two: int) -> int:
    """Make one object of two; return the label that stays, the older.

    Raises
    ------
    InputError
        One of them is not there, or they are the same.
    """
    if one == two:
        raise InputError(f"{path}: expected two labels, got {one} twice")
    with edited(connection, path) as tracker:
        first, second = (_living(tracker, path, label) for label in (one, two))
        kept = tracker.merge(first, second)
        if not kept.confirmed:
            raise InputError(f"{path}: {one} and {two} together are no object: {_size(kept)} cm, or too few points")
        return kept.label


def forget(connection: sqlite3.Connection, path: str, label: int) -> None:
    """Let an object be none: its label is never given again, and what is seen there may become another one.

    Raises
    ------
    InputError
        No object ever had the label.
    """
    with edited(connection, path) as tracker:
        entry = next((o for o in tracker.ever_labelled() if o.label == label), None)
        if entry is None:
            raise InputError(f"{path}: no object has the label {label}")
        if entry.confirmed:
            tracker.retire(entry)
    with transaction(connection):
        connection.execute("UPDATE objects SET state = 'forgotten', name = NULL WHERE label = ?", (label,))


def _size(entry: MapObject) -> str:
    return " x ".join(f"{100 * side:.0f}" for side in entry.box.size)


def _living(tracker: PosedTracker, path: str, label: int) -> MapObject:
    for entry in tracker.ever_labelled():
        if entry.label == label and entry.confirmed:
            return entry
    raise InputError(f"{path}: no object that is there has the label {label}")
