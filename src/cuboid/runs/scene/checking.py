"""Checks of a scene file, and rescue of the readable contents of a damaged one."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.errors import InputError, OutputError, one_line
from cuboid.method.heatmap.kernels.cubes import BLOCK_ROWS, ROW
from cuboid.method.heatmap.levels import split_rows
from cuboid.runs.scene import before
from cuboid.runs.scene.database import Writing, open_damaged, open_to_read, transaction, user_errors
from cuboid.runs.scene.packing import BlockRow, unpacked_block
from cuboid.runs.scene.saving import StateFile, load_blocks, load_state, load_state_without_map
from cuboid.runs.scene.schema import TABLES
from cuboid.runs.scene.validation import (
    DamagedError,
    Row,
    columns_of,
    cycles_of,
    refuse_cycle,
    refuse_no_row,
    refuse_oversized,
)
from cuboid.runs.scene.visit import ANY_CAMERA

Rows = npt.NDArray[np.void]
Keys = npt.NDArray[np.int64]

# Tables that people and other programs read, in the order in which their rows refer to each other.
PUBLIC_TABLES = (
    "scene",
    "recordings",
    "frames",
    "planes",
    "objects",
    "boxes",
    "sightings",
    "events",
    "pending",
    "relations",
    "furniture",
)
# Maximum number of reported problems of one kind.
MAX_PROBLEMS = 8


def problems(path: Path) -> list[str]:
    """Return the problems of a scene file, a line each; empty if the file is intact.

    Raises
    ------
    InputError
        There is no file, it is no scene, or it is of a newer version.
    """
    try:
        connection = open_to_read(path)
    except InputError as error:
        if "damaged" not in str(error):
            raise
        return [str(error)]
    try:
        with user_errors(path):
            rows = connection.execute(f"PRAGMA integrity_check({MAX_PROBLEMS})").fetchall()
            # SQLite may report several pages in one text.
            found = [line for (text,) in rows for line in text.splitlines() if line != "ok"]
            broken = connection.execute("PRAGMA foreign_key_check").fetchall()
            found += [f"a row of {table} refers to one of {other} that is not there" for table, _, other, _ in broken]
            found += _row_problems(connection)
            found += _link_problems(connection)
            found += _state_problems(connection)
        return [one_line(line) for line in found]
    except InputError as error:
        return [str(error)]
    finally:
        connection.close()


def _row_problems(connection: sqlite3.Connection) -> list[str]:
    """Return the problems of rows, the first few of each table."""
    found: list[str] = []
    for table in TABLES:
        damaged: dict[str, None] = {}
        try:
            refuse_oversized(connection, table)
        except DamagedError as error:
            found.append(str(error))
            continue
        for row in connection.execute(f"SELECT {', '.join(columns_of(table))} FROM {table}"):
            try:
                refuse_no_row(table, row)
            except DamagedError as error:
                damaged[str(error)] = None
                if len(damaged) == MAX_PROBLEMS:
                    break
        found += damaged
    return found


def _link_problems(connection: sqlite3.Connection) -> list[str]:
    """Return the problems of labels that refer to other objects."""
    found = []
    try:
        refuse_cycle(dict(connection.execute("SELECT label, merged_into FROM objects")))
    except DamagedError as error:
        found.append(str(error))
    wrong = "SELECT label FROM objects WHERE (state = 'merged') != (merged_into IS NOT NULL) ORDER BY label LIMIT ?"
    found += [
        f"object {label} is damaged: its state and 'merged_into' contradict each other"
        for (label,) in connection.execute(wrong, (MAX_PROBLEMS,))
    ]
    for table in ("boxes", "sightings", "known"):
        query = f"SELECT DISTINCT label FROM {table} WHERE label NOT IN (SELECT label FROM objects) ORDER BY 1 LIMIT ?"
        missing = connection.execute(query, (MAX_PROBLEMS,))
        found += [f"{table} refers to object {label}, which is not there" for (label,) in missing]
    return found


def _state_problems(connection: sqlite3.Connection) -> list[str]:
    if connection.execute("SELECT 1 FROM parts LIMIT 1").fetchone() is None:
        return []
    try:
        before.load(connection)
        load_state(connection, ANY_CAMERA)
        for _ in load_blocks(connection):
            pass
    except InputError as error:
        return [str(error)]
    return []


def rescue(path: Path, new: Path) -> list[str]:
    """Write the readable contents of a damaged scene into a new file.

    Returns
    -------
    list of str
        Descriptions of lost contents, a line each.

    Raises
    ------
    InputError
        The file is no scene, or nothing of it can be read.
    OutputError
        The new file exists or cannot be written.
    """
    if new.exists():
        raise OutputError(f"{new}: exists; name another file")
    old = open_damaged(path)
    file = Writing(new, create=True)
    lost: list[str] = []
    try:
        with user_errors(new):
            with transaction(file.connection):
                file.connection.execute("PRAGMA defer_foreign_keys = ON")
                kept = sum(_copied(old, file.connection, table, lost) for table in PUBLIC_TABLES)
                _drop_orphans(file.connection)
            kept += _rescue_state(old, file.connection, lost)
        if kept == 0:
            raise InputError(f"{path}: nothing in it can be read")
    except BaseException:
        file.close()
        new.unlink(missing_ok=True)
        raise
    finally:
        old.close()
    file.close()
    return [one_line(line) for line in lost]


def _copied(old: sqlite3.Connection, new: sqlite3.Connection, table: str, lost: list[str]) -> int:
    """Copy the readable rows of a table; return their number."""
    count = 0
    for row in _readable(old, table, lost):
        try:
            refuse_no_row(table, row)
            new.execute(f"INSERT OR REPLACE INTO {table} VALUES ({', '.join('?' * len(row))})", row)
            count += 1
        except DamagedError as error:
            lost.append(str(error))
        except sqlite3.DatabaseError:
            lost.append(f"a row of {table} makes no sense")
    return count


def _readable(old: sqlite3.Connection, table: str, lost: list[str]) -> Iterator[tuple[object, ...]]:
    """Yield a table's rows from its start up to an unreadable one, then from its end back to that one."""
    seen: set[tuple[object, ...]] = set()
    try:
        keys = [row[1] for row in sorted(old.execute(f"PRAGMA table_info({table})"), key=lambda r: r[5]) if row[5]]
        columns = ", ".join(row[1] for row in old.execute(f"PRAGMA table_info({table})"))
    except sqlite3.DatabaseError:
        keys, columns = [], ""
    if not columns:
        lost.append(f"all of {table}")
        return
    for order in ("", "DESC"):
        by = ", ".join(f"{key} {order}" for key in keys) or f"rowid {order}"
        try:
            cursor = old.execute(f"SELECT {columns} FROM {table} ORDER BY {by}")
            while (row := cursor.fetchone()) is not None:
                name = tuple(row[: max(len(keys), 1)])
                if name in seen:
                    break
                seen.add(name)
                yield row
            if not order:
                return
        except sqlite3.DatabaseError as error:
            if not order:
                lost.append(f"rows of {table} ({error})")


def _drop_orphans(connection: sqlite3.Connection) -> None:
    """Delete rows that refer to lost rows."""
    connection.execute("DELETE FROM frames WHERE recording NOT IN (SELECT id FROM recordings)")
    connection.execute("DELETE FROM pending WHERE recording NOT IN (SELECT id FROM recordings)")
    for table in ("sightings", "boxes"):
        connection.execute(f"DELETE FROM {table} WHERE label NOT IN (SELECT label FROM objects)")
    connection.execute("DELETE FROM sightings WHERE box NOT IN (SELECT id FROM boxes)")
    for table in ("sightings", "events"):
        connection.execute(f"DELETE FROM {table} WHERE (recording, frame) NOT IN (SELECT recording, frame FROM frames)")
    links = dict(connection.execute("SELECT label, merged_into FROM objects"))
    circular = [(label,) for cycle in cycles_of(links) for label in cycle]
    connection.executemany("UPDATE objects SET merged_into = NULL WHERE label = ?", circular)
    connection.execute(
        "UPDATE objects SET merged_into = NULL WHERE merged_into NOT IN (SELECT label FROM objects)",
    )
    connection.execute("UPDATE objects SET state = 'gone' WHERE state = 'merged' AND merged_into IS NULL")
    connection.execute("UPDATE objects SET state = 'merged' WHERE merged_into IS NOT NULL")


def _rescue_state(old: sqlite3.Connection, new: sqlite3.Connection, lost: list[str]) -> int:
    """Copy the readable rest of the map and the tracker's state; return the number of map blocks."""
    try:
        tracker, poses = load_state_without_map(old, ANY_CAMERA)
    except (InputError, sqlite3.DatabaseError) as error:
        lost.append(f"the map and the objects' evidence ({error})")
        return 0
    blocks = list(_readable_blocks(old, lost))
    rows, keys = (
        np.concatenate(parts) for parts in zip((np.zeros(0, ROW), np.zeros(0, np.int64)), *blocks, strict=True)
    )
    # Of two rows of one voxel the first is kept.
    _, first = np.unique(np.column_stack([keys, rows["voxel"]]), axis=0, return_index=True)
    tracker.voxels.refill(keys[np.sort(first)], rows[np.sort(first)])
    for entry in tracker.ever_labelled():
        known = tracker.voxels.rows_at(entry.points.astype(np.float64)) >= 0
        if known.any():  # an object whose points are all lost keeps them: they mark its place
            tracker.keep_points(entry, known)
    state = StateFile(new, tracker, poses)
    with transaction(new):
        state.write(new, state.snapshot())
    return len(blocks)


def _readable_blocks(old: sqlite3.Connection, lost: list[str]) -> Iterator[tuple[Rows, Keys]]:
    """Yield the live rows, and the keys of their cubes, of each readable block of the map."""
    last = old.execute("SELECT max(number) FROM blocks").fetchone()[0]
    for number in range(1, 1 if last is None else int(last) + 1):
        try:
            query = "SELECT * FROM blocks WHERE number = ? AND length(data) <= ?"
            row = old.execute(query, (number, BLOCK_ROWS * ROW.itemsize)).fetchone()
            if row is None:
                raise DamagedError("it is missing or too large")
            refuse_no_row("blocks", row)
            found = _cube_block(row)
        except (DamagedError, sqlite3.DatabaseError) as error:
            lost.append(f"block {number} of the map ({error})")
            continue
        yield found


def _cube_block(row: Row) -> tuple[Rows, Keys]:
    block = BlockRow(*row[:5])
    rows = unpacked_block(block, *row[5:])
    rows = split_rows(rows[rows["weight"] > 0])
    return rows, np.full(len(rows), block.cube)
