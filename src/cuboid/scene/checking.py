"""Whether a scene file is whole, and what can be saved of one that is not."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cuboid.errors import InputError, OutputError
from cuboid.kernels.cubes import ROW, voxels_of
from cuboid.scene.database import complaining, open_to_read, open_to_write, transaction
from cuboid.scene.earlier import take_earlier
from cuboid.scene.editing import _CAMERA
from cuboid.scene.freezing import thaw
from cuboid.scene.packing import DamagedError, unpacked_block
from cuboid.scene.saving import StateFile, check_numbers, load_blocks, load_parts
from cuboid.tracker import Tracker

# What people and other programs are told, in the order in which rows refer to each other.
TOLD = ("scene", "recordings", "frames", "planes", "objects", "boxes", "sightings", "pending")
# Problems of one kind that are said, at most.
SAID = 8


def problems(path: Path) -> list[str]:
    """Return what is wrong with a scene file, a line each; nothing where it is whole.

    Raises
    ------
    InputError
        There is none, it is none, or it is of a newer version.
    """
    try:
        connection = open_to_read(path)
    except InputError as error:
        if "damaged" not in str(error):
            raise
        return [str(error)]
    try:
        with complaining(path):
            found = [row[0] for row in connection.execute(f"PRAGMA integrity_check({SAID})") if row[0] != "ok"]
            broken = connection.execute("PRAGMA foreign_key_check").fetchall()
            found += [f"a row of {table} refers to one of {other} that is not there" for table, _, other, _ in broken]
            found += _state_problems(connection)
        return found
    except InputError as error:
        return [str(error)]
    finally:
        connection.close()


def _state_problems(connection: sqlite3.Connection) -> list[str]:
    if connection.execute("SELECT 1 FROM parts LIMIT 1").fetchone() is None:
        return []
    try:
        tracker = thaw(load_parts(connection), Tracker(_CAMERA))[0]
        if tracker is None:
            return ["the state of the tracker is missing"]
        if not take_earlier(connection, tracker.voxels):
            check_numbers(connection, [number for number, _, _ in load_blocks(connection)])
    except InputError as error:
        return [str(error)]
    return []


def rescue(path: Path, new: Path) -> list[str]:
    """Write what can be read of a damaged scene into a new file.

    Returns
    -------
    list of str
        What was lost, a line each.

    Raises
    ------
    InputError
        The file is no scene, or nothing of it can be read.
    OutputError
        The new file exists or cannot be written.
    """
    if new.exists():
        raise OutputError(f"{new}: exists; name another file")
    if not path.is_file():
        raise InputError(f"{path}: there is no such scene file")
    old = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)
    file = open_to_write(new, create=True)
    lost: list[str] = []
    try:
        with complaining(new):
            with transaction(file.connection):
                file.connection.execute("PRAGMA defer_foreign_keys = ON")
                kept = sum(_copied(old, file.connection, table, lost) for table in TOLD)
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
    return lost


def _copied(old: sqlite3.Connection, new: sqlite3.Connection, table: str, lost: list[str]) -> int:
    """Copy the rows of a table that can be read; return how many."""
    count = 0
    for row in _readable(old, table, lost):
        try:
            new.execute(f"INSERT OR REPLACE INTO {table} VALUES ({', '.join('?' * len(row))})", row)
            count += 1
        except sqlite3.DatabaseError:
            lost.append(f"a row of {table} makes no sense")
    return count


def _readable(old: sqlite3.Connection, table: str, lost: list[str]) -> Iterator[tuple[object, ...]]:
    """Give the rows of a table from its beginning, and where one cannot be read, those from its end up to there."""
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
    """Drop rows that refer to lost ones."""
    connection.execute("DELETE FROM frames WHERE recording NOT IN (SELECT id FROM recordings)")
    connection.execute("DELETE FROM pending WHERE recording NOT IN (SELECT id FROM recordings)")
    connection.execute(
        "DELETE FROM sightings WHERE box NOT IN (SELECT id FROM boxes) "
        "OR (recording, frame) NOT IN (SELECT recording, frame FROM frames)"
    )
    connection.execute(
        "UPDATE objects SET merged_into = NULL, state = 'gone' "
        "WHERE merged_into IS NOT NULL AND merged_into NOT IN (SELECT label FROM objects)"
    )


def _rescue_state(old: sqlite3.Connection, new: sqlite3.Connection, lost: list[str]) -> int:
    """Let the new file go on with what is left of the map; return how many blocks of it there are."""
    try:
        tracker = thaw(load_parts(old), Tracker(_CAMERA))[0]
    except (InputError, sqlite3.DatabaseError) as error:
        tracker = None
        lost.append(f"the map and the objects' evidence ({error})")
    if tracker is None:
        return 0
    rows, places, kept = [np.zeros(0, ROW)], [np.zeros((0, 3), np.int64)], 0
    told = old.execute("SELECT value FROM scene WHERE key = 'blocks'").fetchone()
    query = "SELECT cube, rows, check_sum, data FROM blocks WHERE number = ?"
    for number in range(1, int(told[0]) if told is not None else 1):
        try:
            key, count, check, data = old.execute(query, (number,)).fetchone() or (0, 1, 0, b"")
            block = unpacked_block(data, check, count, f"block {number} of the map")
        except (DamagedError, sqlite3.DatabaseError) as error:
            lost.append(f"block {number} of the map ({error})")
            continue
        kept += 1
        rows.append(block[block["weight"] > 0])
        places.append(voxels_of(np.full(len(rows[-1]), key), rows[-1]["voxel"]))
    tracker.voxels.refill(np.concatenate(places), np.concatenate(rows))
    state = StateFile(tracker, new)
    with transaction(new):
        state.write(new, state.snapshot())
    return kept
