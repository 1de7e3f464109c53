"""Saves the tracker's state in the scene file; only the parts that changed since the last save are written."""

from __future__ import annotations

import hashlib
import sqlite3
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.limits import MEMORY_MB
from cuboid.ground.core.state import Record
from cuboid.method.heatmap.kernels.cubes import ROW
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.proposals.types import ProposalSource
from cuboid.runs.scene.codec import Encoder, Part, Taken, decode, take
from cuboid.runs.scene.database import user_errors
from cuboid.runs.scene.localisation import ScenePoses, ScenePosesState
from cuboid.runs.scene.pace import Pace
from cuboid.runs.scene.packing import (
    BlockRow,
    check_sum,
    packed,
    packed_block,
    unpacked,
    unpacked_block,
)
from cuboid.runs.scene.validation import DamagedError, columns_of, iterate_table, read_rows, refuse_oversized
from cuboid.runs.tracking.posed_tracker import PosedTracker, PosedTrackerState

HEADER = ", ".join(BlockRow._fields)
# Changed blocks are first written uncompressed; once stable they are compressed, at most this many per commit.
PACKED_PER_COMMIT = 64


@dataclass(frozen=True, slots=True)
class SceneState(Record):
    """The complete state of a scene, without the rows of its map: the root of the parts in the file."""

    tracker: PosedTrackerState
    poses: ScenePosesState


@dataclass(frozen=True, slots=True)
class SceneSnapshot:
    """The state of a scene at one moment; it does not change afterwards.

    Attributes
    ----------
    taken : Taken
    blocks : int
        Highest block number of the map, plus one.
    changed : dict of int to (int, int, (N,) of type ROW)
        Map blocks that have changed since the last snapshot, by number: key of the cube, visit, rows.
    """

    taken: Taken
    blocks: int
    changed: dict[int, tuple[int, int, npt.NDArray[Any]]]


class SceneBlockStore:
    """The blocks of a scene file, from which map blocks are loaded into memory.

    Parameters
    ----------
    connection : sqlite3.Connection
    path : Path
        Path of the scene, for messages.
    """

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self._connection, self._path = connection, path
        self.voxels: VoxelMap | None = None
        # Blocks that are being written.
        self.awaited: npt.NDArray[np.int64] = np.zeros(0, np.int64)

    def takes(self, blocks: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """Return which blocks (N,) are in the file in their current form."""
        if self.voxels is None:
            return np.zeros(len(blocks), bool)
        return ~self.voxels.stored.has_changed(blocks) & ~np.isin(blocks, self.awaited)

    def put(self, block: int, rows: npt.NDArray[Any]) -> None:
        """Do nothing: the block is in the file already."""

    def get(self, blocks: Sequence[int], counts: Sequence[int]) -> list[npt.NDArray[Any]]:
        """Return the rows of blocks, given the number of rows of each.

        Raises
        ------
        InputError
            A block is damaged.
        """
        found, columns = [], columns_of("blocks")
        with user_errors(self._path):
            for block, count in zip(blocks, counts, strict=True):
                rows = read_rows(self._connection, columns, "blocks WHERE number = ?", (block,))
                stored = rows[0][3] if rows else 0
                if stored != count:
                    raise DamagedError(f"block {block} of the map is damaged: it has {stored} rows, expected {count}")
                found.append(unpacked_block(BlockRow(*rows[0][:5]), *rows[0][5:]))
        return found


class StateFile:
    """Writes successive states of one scene.

    Parameters
    ----------
    connection : sqlite3.Connection
        Connection to the scene; an earlier state in it is replaced.
    tracker : PosedTracker
    poses : ScenePoses
    block_store : SceneBlockStore, optional
        Source of map blocks that are not in memory.
    """

    def __init__(
        self,
        connection: sqlite3.Connection,
        tracker: PosedTracker,
        poses: ScenePoses,
        block_store: SceneBlockStore | None = None,
    ) -> None:
        self._tracker, self._poses, self._block_store = tracker, poses, block_store
        self._encoder = Encoder()
        # Digests of the file's contents by part and path ("" for the part's own fields); b"" where unknown.
        self._written: dict[tuple[str, str], bytes] = {}
        for query in ("SELECT key, '' FROM parts", "SELECT part, path FROM arrays"):
            self._written |= dict.fromkeys(connection.execute(query), b"")
        self._same: dict[tuple[str, str], tuple[npt.NDArray[Any], bytes]] = {}
        self._parts: dict[str, Part] = {}
        self._begin = connection.execute("SELECT 1 FROM blocks LIMIT 1").fetchone() is None
        # Blocks that are not compressed yet.
        query = "SELECT number FROM blocks WHERE rows > 0 AND length(data) = rows * ?"
        self._plain = {number for (number,) in connection.execute(query, (ROW.itemsize,))}

    def snapshot(self) -> SceneSnapshot:
        """Return a snapshot of the current state."""
        taken = take(SceneState(self._tracker.state(), self._poses.state()))
        voxels = self._tracker.voxels
        blocks = voxels.stored.take_changed()
        if self._begin:
            blocks, self._begin = np.arange(1, voxels.stored.blocks), False
        changed = dict(zip(blocks.tolist(), voxels.stored.copies(blocks), strict=True))
        if self._block_store is not None:  # not earlier: evicted blocks were in another store
            self._block_store.awaited = blocks
            if self._block_store.voxels is not voxels:
                voxels.stored.use_store(self._block_store)
                self._block_store.voxels = voxels
        return SceneSnapshot(taken, voxels.stored.blocks, changed)

    def write(
        self, connection: sqlite3.Connection, state: SceneSnapshot, pace: Pace | None = None, *, ended: bool = True
    ) -> None:
        """Write a snapshot, within the caller's transaction; every snapshot must be written, in order.

        With `ended`, no other snapshot follows soon: all blocks are compressed.
        """
        pace = pace or Pace()
        self._write_parts(connection, state, pace)
        for number, (key, visit, rows) in state.changed.items():
            data = packed_block(rows) if ended else rows.tobytes()
            living = int(np.count_nonzero(rows["weight"] > 0))
            header = BlockRow(number, key, visit, len(rows), living)
            row = (*header, check_sum(data, header), data)
            connection.execute("INSERT OR REPLACE INTO blocks VALUES (?, ?, ?, ?, ?, ?, ?)", row)
            pace.rest()
        connection.execute("DELETE FROM blocks WHERE number >= ?", (state.blocks,))
        connection.execute("INSERT OR REPLACE INTO scene VALUES ('blocks', ?)", (str(state.blocks),))
        connection.execute("INSERT OR REPLACE INTO scene VALUES ('seal', ?)", (_seal(connection, pace),))
        rest = sorted(number for number in self._plain - state.changed.keys() if number < state.blocks)
        for number in rest if ended else rest[:PACKED_PER_COMMIT]:
            query = f"SELECT {HEADER}, data FROM blocks WHERE number = ?"
            *header, data = connection.execute(query, (number,)).fetchone()
            data = packed_block(np.frombuffer(data, ROW))
            values = check_sum(data, BlockRow(*header)), data, number
            connection.execute("UPDATE blocks SET check_sum = ?, data = ? WHERE number = ?", values)
            pace.rest()
        self._plain = set() if ended else {*rest[PACKED_PER_COMMIT:], *state.changed}

    def mark_committed(self) -> None:
        """Note that the last written snapshot is committed."""
        if self._block_store is not None:
            self._block_store.awaited = np.zeros(0, np.int64)

    def _write_parts(self, connection: sqlite3.Connection, state: SceneSnapshot, pace: Pace) -> None:
        now: dict[tuple[str, str], bytes] = {}
        parts = self._encoder.parts(state.taken, pace.rest)
        for key, part in parts.items():
            pace.rest()
            if self._parts.get(key) is part:
                now |= {name: self._written[name] for name in ((key, ""), *((key, path) for path in part.arrays))}
                continue
            if self._is_new(now, (key, ""), part.fields):
                values = (key, check_sum(part.fields), part.fields)
                connection.execute("INSERT OR REPLACE INTO parts VALUES (?, ?, ?)", values)
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
                pace.rest()
        self._same = {name: self._same[name] for name in now if name in self._same}
        self._parts = parts
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
    """Return whether a scene has a state from which tracking can continue."""
    return connection.execute("SELECT 1 FROM parts LIMIT 1").fetchone() is not None


def load_state(
    connection: sqlite3.Connection,
    intrinsics: Intrinsics,
    proposals: ProposalSource | None = None,
    *,
    memory_mb: float = MEMORY_MB,
    block_store: SceneBlockStore | None = None,
) -> tuple[PosedTracker, ScenePoses]:
    """Return the tracker and the poses that continue from the state of a scene.

    Blocks of the map are read when they are accessed.

    Parameters
    ----------
    connection : sqlite3.Connection
    intrinsics : Intrinsics
        Intrinsics of new frames.
    proposals, memory_mb
        As for `Tracker`.
    block_store : SceneBlockStore, optional
        Store from which blocks are read; by default one with the same connection.

    Raises
    ------
    InputError
        The state is damaged.
    """
    block_store = block_store or SceneBlockStore(connection, Path("the scene"))
    tracker, poses = load_state_without_map(connection, intrinsics, proposals, memory_mb)
    blocks = block_rows(connection)
    with refusing_nonsense():
        tracker.voxels.stored.restore([(b.number, b.cube, b.rows, b.living, b.visit) for b in blocks], block_store)
    block_store.voxels = tracker.voxels
    return tracker, poses


def load_state_without_map(
    connection: sqlite3.Connection,
    intrinsics: Intrinsics,
    proposals: ProposalSource | None = None,
    memory_mb: float = MEMORY_MB,
) -> tuple[PosedTracker, ScenePoses]:
    """Return tracker and poses as `load_state` does, but with a voxel map that has no rows yet."""
    parts = load_parts(connection)
    with refusing_nonsense():
        state = decode(SceneState, parts)
        tracker = PosedTracker.from_state(state.tracker, intrinsics, proposals, memory_mb=memory_mb)
        return tracker, ScenePoses.from_state(state.poses, intrinsics)


def block_rows(connection: sqlite3.Connection) -> list[BlockRow]:
    """Return the block rows of the map without the voxel data, ascending by number.

    Raises
    ------
    DamagedError
        A row is invalid, or blocks of the map are missing.
    """
    columns = columns_of("blocks", BlockRow._fields)
    blocks = [BlockRow(*row) for row in read_rows(connection, columns, "blocks ORDER BY number")]
    refuse_oversized(connection, "blocks")
    values = [value for (value,) in read_rows(connection, ("scene.value",), "scene WHERE key = 'blocks'")]
    expected = int(values[0]) - 1 if values and values[0].isdecimal() else -1
    if len(blocks) != expected or any(block.number != k for k, block in enumerate(blocks, 1)):
        raise DamagedError(f"the map is damaged: {len(blocks)} blocks, expected {max(expected, 0)}")
    for block in blocks:
        if block.living > block.rows:
            raise DamagedError(f"block {block.number} of the map is damaged: {block.living} of {block.rows} rows live")
    return blocks


@contextmanager
def refusing_nonsense() -> Iterator[None]:
    """Raise DamagedError if live objects cannot be made from the contents of a file."""
    try:
        yield
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError, MemoryError) as error:
        raise DamagedError(f"the state of the tracker is damaged: {error}") from None


def _seal(connection: sqlite3.Connection, pace: Pace | None = None) -> str:
    """Return a check sum over the keys, forms and check sums of all parts and arrays."""
    seal = 0
    for query in (
        "SELECT key, check_sum FROM parts ORDER BY key",
        "SELECT part, path, form, check_sum FROM arrays ORDER BY part, path",
        "SELECT value FROM scene WHERE key = 'blocks'",
    ):
        for row in connection.execute(query):
            seal = zlib.crc32(repr(row).encode(), seal)
            if pace is not None:
                pace.rest()
    return str(seal)


def load_parts(connection: sqlite3.Connection) -> dict[str, Part]:
    """Return the parts of a scene's state, by key.

    Raises
    ------
    InputError
        A part or block is damaged.
    """
    sealed = connection.execute("SELECT value FROM scene WHERE key = 'seal'").fetchone()
    if sealed is None or sealed[0] != _seal(connection):
        raise DamagedError("the state of the tracker is damaged: its parts are not those that were written")
    parts: dict[str, Part] = {}
    for key, check, fields in iterate_table(connection, "parts"):
        if check_sum(fields) != check:
            raise DamagedError(f"the part '{key}' is damaged: its check sum is wrong")
        parts[key] = Part(fields)
    for key, path, form, check, data in iterate_table(connection, "arrays"):
        if key in parts:
            parts[key].arrays[path] = form, unpacked(data, check, form, f"the array '{path}' of '{key}'")
    return parts


def load_blocks(connection: sqlite3.Connection) -> Iterator[tuple[BlockRow, npt.NDArray[Any]]]:
    """Yield the map's blocks with their rows.

    Raises
    ------
    InputError
        A part or block is damaged.
    """
    for row in iterate_table(connection, "blocks"):
        block = BlockRow(*row[:5])
        yield block, unpacked_block(block, *row[5:])
