"""Scene files, spoilt in their bytes and in the values of their rows, and all that reads them, for the fuzzer."""

from __future__ import annotations

import random
import sqlite3
import sys
import tempfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "scene"))

import targets  # noqa: F401 - finds the other tests' helpers
from changes import Change
from engine import Target
from made_scene import THINGS, Shown, ask, record
from mutations import VALUES, mutated, of_bytes

from cuboid.runs.scene import Scene
from cuboid.runs.scene.checking import problems, rescue

NAME = "a.cuboid"


def make_scene(folder: Path) -> None:
    """Write a scene of two visits, between which a thing was moved."""
    record(folder / NAME, Shown(frames=10))
    moved = replace(THINGS[1], center=THINGS[1].center + np.array([0.1, 0.1, 0.0]))
    record(folder / NAME, Shown((THINGS[0], moved), frames=10), "again")
    with Scene.open(folder / NAME) as scene:
        scene.name(1, "box")


def mutated_scene(rng: random.Random, path: str, content: bytes) -> Change:
    """Return a change of a scene file: of its bytes, of what it is, or of its rows, which no check sum guards."""
    if rng.random() < 0.3:
        return mutated(rng, path, content)
    return Change(path, of_rows(rng, content))


def of_rows(rng: random.Random, content: bytes) -> bytes:
    """Change values of rows of a database."""
    with tempfile.NamedTemporaryFile(suffix=".cuboid") as file:
        file.write(content)
        file.flush()
        connection = sqlite3.connect(file.name, isolation_level=None)
        connection.execute("PRAGMA journal_mode = DELETE")
        connection.execute("PRAGMA ignore_check_constraints = ON")
        for _ in range(rng.choice((1, 1, 1, 3))):
            _change_row(rng, connection)
        connection.close()
        return Path(file.name).read_bytes()


def _change_row(rng: random.Random, connection: sqlite3.Connection) -> None:
    tables = [row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name")]
    table = rng.choice(tables)
    columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
    keys = [row[1] for row in connection.execute(f"PRAGMA table_info({table})") if row[5]] or ["rowid"]
    rows = connection.execute(f"SELECT {', '.join(keys)} FROM {table}").fetchall()
    if not rows:
        return
    where = " AND ".join(f"{key} = ?" for key in keys)
    row = rng.choice(rows)
    if rng.random() < 0.1:
        _try(connection, f"DELETE FROM {table} WHERE {where}", row)
        return
    column = rng.choice(columns)
    value = rng.choice([item for item in VALUES if not isinstance(item, (list, dict, bool))])
    if isinstance(value, int) and abs(value) >= 2**63:
        value = float(min(value, 10**300))
    old = connection.execute(f"SELECT {column} FROM {table} WHERE {where}", row).fetchone()[0]
    if isinstance(old, bytes):
        value = of_bytes(rng, old)
    elif isinstance(old, str) and rng.random() < 0.5:
        value = of_bytes(rng, old.encode()).decode("utf-8", "replace")
    _try(connection, f"UPDATE {table} SET {column} = ? WHERE {where}", (value, *row))


def _try(connection: sqlite3.Connection, query: str, values: tuple[object, ...]) -> None:
    with suppress(sqlite3.DatabaseError, OverflowError, UnicodeEncodeError):  # the table takes no such value
        connection.execute(query, values)


def check(folder: Path) -> None:
    """Let the check tell; nothing that it finds whole may be refused by what reads."""
    found = problems(folder / NAME)
    assert all(line.isprintable() and len(line) < 300 for line in found), found


def save(folder: Path) -> None:
    """Rescue what can be read."""
    new = folder / "new.cuboid"
    lost = rescue(folder / NAME, new)
    assert all(line.isprintable() and len(line) < 300 for line in lost), lost
    ask_new = Scene.open(new)
    ask_new.close()


def go_on(folder: Path) -> None:
    """Let a visit of a few frames go on from it."""
    record(folder / NAME, Shown(frames=3), source=None)


def results(folder: Path) -> None:
    """Write results."""
    with Scene.open(folder / NAME) as scene:
        scene.write_results(folder / "results", 1)


SCENES = {
    "scenes": Target(
        make_scene,
        lambda folder: [NAME],
        {"ask": lambda folder: ask(folder / NAME), "check": check, "rescue": save, "go on": go_on, "results": results},
        mutated_scene,
    )
}
