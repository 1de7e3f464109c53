"""What the tracker needs to go on, in the file: only what changed since the last time is written."""

from __future__ import annotations

import hashlib
import sqlite3
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy.typing as npt

from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.scene.door import DamagedError, told_each
from cuboid.scene.freezing import Part, freeze, thaw
from cuboid.scene.packing import (
    Columns,
    check_sum,
    packed,
    packed_block,
    unpacked,
    unpacked_block,
)
from cuboid.tracker import Tracker


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state of a tracker at one moment: nothing in it changes any more.

    Attributes
    ----------
    parts : dict of str to Part
    capacity, blocks : int
        Rows that the map has room for, and how many blocks the rows in use make.
    voxel_m : float
    changed : dict of int to columns
        The map's blocks that have changed since the last snapshot.
    """

    parts: dict[str, Part]
    capacity: int
    blocks: int
    voxel_m: float
    changed: dict[int, Columns]


class StateFile:
    """Writes the states of one tracker, one after the other.

    Parameters
    ----------
    tracker : Tracker
    connection : sqlite3.Connection
        Of the scene: what it holds of an earlier state is replaced.
    others : iterable of object
        What else is saved with it.
    """

    def __init__(self, tracker: Tracker, connection: sqlite3.Connection, others: Iterable[object] = ()) -> None:
        self._tracker, self._others = tracker, tuple(others)
        # Digests of what the file holds by part and path, the part itself under ""; b"" where that is not known.
        self._written: dict[tuple[str, str], bytes] = {}
        for query in ("SELECT key, '' FROM parts", "SELECT part, path FROM arrays"):
            self._written |= dict.fromkeys(connection.execute(query), b"")
        self._same: dict[tuple[str, str], tuple[npt.NDArray[Any], bytes]] = {}
        self._begin = connection.execute("SELECT 1 FROM blocks LIMIT 1").fetchone() is None

    def snapshot(self) -> Snapshot:
        """Take the state of now."""
        parts: dict[str, Part] = {}
        for root in (self._tracker, *self._others):
            parts |= freeze(root)
        voxels = self._tracker.voxels
        runs = voxels.take_changed().tolist()
        if self._begin:
            runs, self._begin = list(range(voxels.runs)), False
        changed = {k: tuple(column.copy() for column in voxels.rows_in(k)) for k in runs}
        return Snapshot(parts, voxels.capacity, voxels.runs, voxels.voxel_m, changed)

    def write(self, connection: sqlite3.Connection, state: Snapshot) -> None:
        """Write a snapshot, within the caller's transaction; each must be written, in the order of their taking."""
        self._write_parts(connection, state)
        for number, columns in state.changed.items():
            data = packed_block(columns, state.voxel_m)
            living = int((columns[1][:, -1] > 0).sum())
            row = (number, len(columns[0]), living, check_sum(data), data)
            connection.execute("INSERT OR REPLACE INTO blocks VALUES (?, ?, ?, ?, ?)", row)
        connection.execute("DELETE FROM blocks WHERE number >= ?", (state.blocks,))
        connection.execute("INSERT OR REPLACE INTO scene VALUES ('capacity', ?)", (str(state.capacity),))
        connection.execute("INSERT OR REPLACE INTO scene VALUES ('seal', ?)", (_seal(connection),))

    def _write_parts(self, connection: sqlite3.Connection, state: Snapshot) -> None:
        now: dict[tuple[str, str], bytes] = {}
        for key, part in state.parts.items():
            fields = msgspec.msgpack.encode(part.fields)
            if self._is_new(now, (key, ""), fields):
                values = (key, part.kind, check_sum(fields), fields)
                connection.execute("INSERT OR REPLACE INTO parts VALUES (?, ?, ?, ?)", values)
            for path, (form, plain) in part.arrays.items():
                name = key, path
                same = self._same.get(name)
                if same is not None and same[0] is plain:
                    now[name] = same[1]
                elif self._is_new(now, name, form.encode() + plain.tobytes()):
                    data = packed(plain)
                    row = (key, path, form, check_sum(data), data)
                    connection.execute("INSERT OR REPLACE INTO arrays VALUES (?, ?, ?, ?, ?)", row)
                self._same[name] = plain, now[name]
        self._same = {name: self._same[name] for name in now if name in self._same}
        for key, path in self._written.keys() - now.keys():
            if path:
                connection.execute("DELETE FROM arrays WHERE part = ? AND path = ?", (key, path))
            else:
                connection.execute("DELETE FROM parts WHERE key = ?", (key,))
        self._written = now

    def _is_new(self, now: dict[tuple[str, str], bytes], name: tuple[str, str], data: bytes) -> bool:
        now[name] = hashlib.blake2b(data, digest_size=16).digest()
        return self._written.get(name) != now[name]


def has_state(connection: sqlite3.Connection) -> bool:
    """Tell whether a scene has a state that can be gone on from."""
    return connection.execute("SELECT 1 FROM parts LIMIT 1").fetchone() is not None


def clear_state(connection: sqlite3.Connection) -> None:
    """Drop the state, so that another one can be written."""
    for table in ("blocks", "parts", "arrays"):
        connection.execute(f"DELETE FROM {table}")
    connection.execute("DELETE FROM scene WHERE key = 'seal'")


def load_state(connection: sqlite3.Connection, fresh: Tracker, *others: object) -> tuple[Any, ...]:
    """Return a tracker that goes on from the state of a scene, and what else was saved with it.

    Parameters
    ----------
    connection : sqlite3.Connection
    fresh : Tracker
        A new one for the frames that come: their intrinsics and proposals.
    *others : object
        New ones of what else may have been saved.

    Returns
    -------
    tuple
        The tracker and the others, None for those that were not saved.

    Raises
    ------
    InputError
        The state is damaged, or of another version.
    """
    parts = load_parts(connection)
    with strange_is_damaged():
        tracker, *rest = thaw(parts, fresh, *others)
        if tracker is None:
            raise DamagedError("the state of the tracker is missing")
        voxels = tracker.voxels
        capacity = connection.execute("SELECT value FROM scene WHERE key = 'capacity'").fetchone()
        blocks = [columns for _, columns in load_blocks(connection, voxels)]
        if capacity is None or len(blocks) != voxels.runs:
            raise DamagedError(f"the map is damaged: {len(blocks)} blocks, expected {voxels.runs}")
        voxels.restore(int(capacity[0]), blocks)
    return tracker, *rest


@contextmanager
def strange_is_damaged() -> Iterator[None]:
    """Turn what live objects cannot be made of into DamagedError: what the seal of an older file does not guard."""
    try:
        yield
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError, MemoryError) as error:
        raise DamagedError(f"the state of the tracker is damaged: {error}") from None


def _seal(connection: sqlite3.Connection) -> str:
    """Return a check sum over which parts and arrays there are, of which forms, and over their own check sums."""
    seal = 0
    for query in (
        "SELECT key, kind, check_sum FROM parts ORDER BY key",
        "SELECT part, path, form, check_sum FROM arrays ORDER BY part, path",
        "SELECT value FROM scene WHERE key = 'capacity'",
    ):
        for row in connection.execute(query):
            seal = zlib.crc32(repr(row).encode(), seal)
    return str(seal)


def load_parts(connection: sqlite3.Connection) -> dict[str, Part]:
    """Return the parts of a scene's state, by key.

    Raises
    ------
    InputError
        One is damaged.
    """
    sealed = connection.execute("SELECT value FROM scene WHERE key = 'seal'").fetchone()
    if sealed is not None and sealed[0] != _seal(connection):  # scenes of before the seal have none
        raise DamagedError("the state of the tracker is damaged: its parts are not those that were written")
    parts: dict[str, Part] = {}
    for key, kind, check, fields in told_each(connection, "parts"):
        if check_sum(fields) != check:
            raise DamagedError(f"the part '{key}' is damaged: its check sum is wrong")
        parts[key] = Part(kind, msgspec.msgpack.decode(fields))
    for key, path, form, check, data in told_each(connection, "arrays"):
        if key in parts:
            parts[key].arrays[path] = form, unpacked(data, check, form, f"the array '{path}' of '{key}'")
    return parts


def load_blocks(connection: sqlite3.Connection, voxels: VoxelMap) -> Iterable[tuple[int, Columns]]:
    """Give the map's blocks, in order, with their numbers.

    Raises
    ------
    InputError
        One is damaged.
    """
    query = "SELECT number, rows, check_sum, data FROM blocks ORDER BY number"
    for place, (number, rows, check, data) in enumerate(connection.execute(query)):
        what = f"block {number} of the map"
        if number != place:
            raise DamagedError(f"the map is damaged: {what} is there, expected block {place}")
        yield number, unpacked_block(data, check, rows, voxels.rows_in(0), voxels.voxel_m, what)
