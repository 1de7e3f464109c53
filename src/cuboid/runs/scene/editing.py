"""Edits of a scene file: objects that users merge or delete, and parts that were joined to others."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float32Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation, transform
from cuboid.method.objects.entry import MapObject
from cuboid.runs.scene.database import transaction
from cuboid.runs.scene.localisation import JoinedPart
from cuboid.runs.scene.records import Records
from cuboid.runs.scene.saving import SceneBlockStore, StateFile, load_state
from cuboid.runs.scene.schema import QUATERNION, TABLES
from cuboid.runs.scene.validation import DamagedError, columns_of, floats_of, read_rows, rotation_of
from cuboid.runs.scene.visit import ANY_CAMERA
from cuboid.runs.tracking.posed_tracker import PosedTracker


@contextmanager
def edited(connection: sqlite3.Connection, path: str) -> Iterator[PosedTracker]:
    """Yield the tracker of a scene, and save its changes afterwards."""
    block_store = SceneBlockStore(connection, Path(path))
    tracker, poses = load_state(connection, ANY_CAMERA, block_store=block_store)
    state = StateFile(connection, tracker, poses, block_store)
    yield tracker
    records = Records(connection, 0)
    with transaction(connection):
        state.write(connection, state.snapshot())
        records.take(tracker).write(connection)


def merge(connection: sqlite3.Connection, path: str, label: int, other: int) -> int:
    """Merge two objects; return the older label, which stays.

    Raises
    ------
    InputError
        One of the objects does not exist, both are the same, or they are too far apart to be one.
    """
    if label == other:
        raise InputError(f"{path}: expected two labels, got {label} twice")
    with edited(connection, path) as tracker:
        without_depth = {item.label: item for item in tracker.objects_without_depth()}
        if label in without_depth or other in without_depth:
            boxes = [
                without_depth[k].box if k in without_depth else tracker.in_world(_living(tracker, path, k).box)
                for k in (label, other)
            ]
            apart_m = float(np.linalg.norm(boxes[0].center - boxes[1].center))
            if apart_m > sum(box.size.max() for box in boxes):
                raise InputError(f"{path}: {label} and {other} are {apart_m:.2f} m apart, farther than they are large")
            return tracker.merge_without_depth(label, other)
        first_entry, second_entry = (_living(tracker, path, k) for k in (label, other))
        kept = tracker.merge(first_entry, second_entry)
        if not kept.confirmed:
            raise InputError(f"{path}: {label} and {other} together are no object: {_size(kept)} cm, or too few points")
        return kept.label


def forget(connection: sqlite3.Connection, path: str, label: int) -> None:
    """Delete an object: its label is never reused, and its surface may become another object.

    Raises
    ------
    InputError
        No object ever had the label.
    """
    with edited(connection, path) as tracker:
        entry = next((o for o in tracker.ever_labelled() if o.label == label), None)
        without_depth = tracker.retire_without_depth(label)
        if entry is None and not without_depth:
            raise InputError(f"{path}: no object has the label {label}")
        if entry is not None and entry.confirmed:
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


# Tables with a position: the columns of the position, then those of a rotation, if there is one.
_PLACES = (
    ("frames", ("tx", "ty", "tz"), QUATERNION),
    *((table, ("cx", "cy", "cz"), QUATERNION) for table in ("boxes", "objects", "known")),
    *((table, (f"{end}_x", f"{end}_y", f"{end}_z"), ()) for table in ("changes", "events") for end in ("from", "to")),
)


def transform_rows(connection: sqlite3.Connection, joined: Sequence[JoinedPart]) -> None:
    """Transform all rows of scene parts that were joined to others, within the caller's transaction."""
    for part in joined:
        for table, place, turn in _PLACES:
            _transform(connection, part, table, place, turn)


def _transform(
    connection: sqlite3.Connection, part: JoinedPart, table: str, place: Sequence[str], turn: Sequence[str]
) -> None:
    keys, columns = TABLES[table].key.split(", "), [*place, *turn]
    points = ["points"] if table == "known" else []
    names = columns_of(table, [*keys, *columns, *points])
    rows = []
    for row in read_rows(connection, names, f"{table} WHERE {columns[0]} IS NOT NULL"):
        numbers = np.array(row[len(keys) : len(keys) + len(columns)])
        if part.contains(numbers[None, :3])[0]:
            new = transform(part.T_new_old, numbers[:3]).tolist()
            if turn:
                rotation = part.T_new_old[:3, :3] @ rotation_of(numbers[3:].tolist(), table)
                new += quat_wxyz_from_rotation(rotation).tolist()
            if points:
                new.append(transform(part.T_new_old, _points(row[-1])).astype("<f4").tobytes())
            rows.append((*new, *row[: len(keys)]))
    to, where = ", ".join(f"{name} = ?" for name in [*columns, *points]), " AND ".join(f"{key} = ?" for key in keys)
    connection.executemany(f"UPDATE {table} SET {to} WHERE {where}", rows)


def _points(data: bytes) -> Float32Array:
    numbers = floats_of(data, "<f4", "known.points")
    if numbers.size % 3:
        raise DamagedError(f"a row of known is damaged: {numbers.size} numbers are no points")
    return numbers.reshape(-1, 3)
