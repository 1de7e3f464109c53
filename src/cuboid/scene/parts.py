"""The rows of a scene file of a part that was unconnected, transformed to where the part belongs."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence

import numpy as np

from cuboid.core.frame import Float32Array
from cuboid.geometry.se3 import quat_wxyz_from_rotation, transform
from cuboid.scene.localisation import Joined
from cuboid.scene.validation import DamagedError, columns_of, floats_of, read_rows, rotation_of

# Rows that have a place, and a turn: table, its columns of the place, those of the quaternion (w first).
_TURNED = (
    ("frames", "tx ty tz", "qw qx qy qz"),
    ("boxes", "cx cy cz", "qw qx qy qz"),
    ("objects", "cx cy cz", "qw qx qy qz"),
    ("known", "cx cy cz", "qw qx qy qz"),
)
_PLACES = (("changes", "from_x from_y from_z"), ("changes", "to_x to_y to_z"))
# The key of a row of each table.
_KEYS = {"frames": "recording frame", "changes": "recording label", "boxes": "id", "objects": "label", "known": "label"}


def transform_rows(connection: sqlite3.Connection, joined: Sequence[Joined]) -> None:
    """Carry all rows that lie in parts of the scene which became part of others, within the caller's transaction."""
    for part in joined:
        for table, place, turn in _TURNED:
            _transform(connection, part, table, place, turn)
        for table, place in _PLACES:
            _transform(connection, part, table, place, "")


def _transform(connection: sqlite3.Connection, part: Joined, table: str, place: str, turn: str) -> None:
    keys, columns = _KEYS[table].split(), [*place.split(), *turn.split()]
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
