"""A scene file whose rows somebody changed: what they say is refused in one line, and the rest can be saved."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from made_scene import CAMERA, Shown, ask, change, record

from cuboid.ground.core.errors import InputError
from cuboid.runs.scene import Scene, before
from cuboid.runs.scene.checking import problems, rescue
from cuboid.runs.scene.editing import transform_rows
from cuboid.runs.scene.localisation import JoinedPart
from cuboid.runs.scene.packing import check_sum, unpacked
from cuboid.runs.scene.schema import TABLES
from cuboid.runs.scene.validation import DamagedError


def test_each_column_is_described(path: Path) -> None:
    connection = sqlite3.connect(path)
    tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    assert set(TABLES) == tables
    for table in TABLES:
        columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
        assert list(TABLES[table].columns) == columns, table
    connection.close()


@pytest.mark.parametrize(
    ("query", "value", "says"),
    [
        ("UPDATE objects SET cx = ? WHERE label = 1", 1e308, r"objects\.cx is damaged: expected a number of at most"),
        ("UPDATE objects SET width = ? WHERE label = 1", -0.1, r"objects\.width is damaged: .* at least 0, got -0\.1"),
        ("UPDATE objects SET state = ? WHERE label = 1", "x" * 9999, r"objects\.state is damaged"),
        ("UPDATE objects SET qw = ? WHERE label = 1", 0.5, "a row of objects is damaged: the quaternion has length"),
        ("UPDATE objects SET first_frame = ? WHERE label = 2", -(2**40), r"objects\.first_frame is damaged"),
        ("UPDATE frames SET qx = ? WHERE frame = 3", 0.9, "a row of frames is damaged: the quaternion has length"),
        ("UPDATE frames SET tx = ? WHERE frame = 3", float("inf"), r"frames\.tx is damaged"),
        ("UPDATE boxes SET height = ?", -1.0, r"boxes\.height is damaged"),
        ("UPDATE sightings SET visible = ?", 7.0, r"sightings\.visible is damaged"),
        ("UPDATE recordings SET begun = ?", "yesterday", r"recordings\.begun is damaged"),
        ("UPDATE recordings SET path = ?", "\x1b[2J" * 3000, r"recordings\.path is damaged"),
    ],
)
def test_a_row_that_makes_no_sense_is_one_line(path: Path, query: str, value: object, says: str) -> None:
    change(path, query, value)
    with pytest.raises(InputError, match=says) as caught:
        ask(path)
    line = str(caught.value)
    assert line.isprintable()
    assert len(line) < 300
    assert "'cuboid scene check --rescue NEW' saves what can be read" in line
    assert any(says.partition(r"\.")[0].removeprefix("a row of ").split()[0] in found for found in problems(path))
    assert rescue(path, path.with_name("new.cuboid"))
    assert problems(path.with_name("new.cuboid")) == []
    ask(path.with_name("new.cuboid"))


@pytest.mark.parametrize(
    "query",
    [
        "UPDATE arrays SET form = '[\"<f8\", [1000000000]]' WHERE rowid = (SELECT min(rowid) FROM arrays)",
        "UPDATE arrays SET form = 'x' WHERE rowid = (SELECT min(rowid) FROM arrays)",
        "UPDATE arrays SET path = 'other' WHERE rowid = (SELECT min(rowid) FROM arrays)",
        "UPDATE parts SET key = 'other' WHERE key = 'tracker'",
        "DELETE FROM parts WHERE key LIKE 'tracker/planes/planes/%'",
        "DELETE FROM scene WHERE key = 'seal'",
        "UPDATE scene SET value = '9' WHERE key = 'blocks'",
        "UPDATE scene SET value = '-1e9' WHERE key = 'blocks'",
        "UPDATE scene SET value = '99999999999999999999' WHERE key = 'blocks'",
    ],
)
def test_a_state_that_is_not_what_was_written_is_not_gone_on_from(path: Path, query: str) -> None:
    change(path, query)
    with pytest.raises(InputError, match="parts are not those that were written"), Scene.open(path) as scene:
        scene.tracker(CAMERA)
    assert problems(path) == ["the state of the tracker is damaged: its parts are not those that were written"]
    assert any("evidence" in line for line in rescue(path, path.with_name("new.cuboid")))
    assert problems(path.with_name("new.cuboid")) == []


def test_a_block_that_was_moved_is_told(path: Path) -> None:
    change(path, "UPDATE blocks SET number = 99999 WHERE number = 1")
    assert any("the map is damaged" in line for line in problems(path))
    with pytest.raises(InputError, match=r"the map is damaged: .* blocks, expected"), Scene.open(path) as scene:
        scene.tracker(CAMERA)


@pytest.mark.parametrize("query", ["cube = cube + 1", "visit = 7", "rows = rows - 1", "living = living - 1"])
def test_what_stands_beside_a_block_is_under_its_check_sum(path: Path, query: str) -> None:
    change(path, f"UPDATE blocks SET {query} WHERE number = 1")
    assert any(line.startswith("block 1 of the map is damaged") for line in problems(path))
    shown = Shown(frames=10)
    with pytest.raises(InputError, match="block 1 of the map is damaged"):
        record(path, shown, "again")
    assert any("block 1 of the map" in line for line in rescue(path, path.with_name("new.cuboid")))
    assert problems(path.with_name("new.cuboid")) == []


@pytest.mark.parametrize(
    ("table", "values"),
    [
        ("occupied", "check_sum = 1"),
        ("known", "points = x'0000c07f'"),
        ("known", "look = x'00'"),
        ("ground", "rows = rows + 99"),
    ],
)
def test_how_things_stood_is_checked(path: Path, table: str, values: str) -> None:
    record(path, Shown(frames=10), "again")
    change(path, f"UPDATE {table} SET {values}")
    assert any(table in line for line in problems(path))
    connection = sqlite3.connect(path)
    with pytest.raises(DamagedError, match=table):
        before.load(connection)
    connection.close()


def test_a_part_is_not_carried_over_a_row_that_makes_no_sense(path: Path) -> None:
    change(path, "UPDATE boxes SET qw = 0.5")
    connection = sqlite3.connect(path)
    with pytest.raises(DamagedError, match="a row of boxes is damaged: the quaternion"):
        transform_rows(connection, [JoinedPart(np.zeros(3), np.eye(4))])
    connection.close()


def test_a_file_whose_tables_have_no_names_is_damaged(path: Path, tmp_path: Path) -> None:
    """SQLite's own words about it are no text then."""
    content = path.read_bytes()
    at = content.index(b"CREATE TABLE objects") + len("CREATE TABLE ")
    path.write_bytes(content[:at] + b"\x94\xff(" + content[at + 3 :])
    with pytest.raises(InputError, match="is damaged"):
        ask(path)
    assert [line for line in problems(path) if "is damaged" in line]
    with pytest.raises(InputError, match="nothing in it can be read"):
        rescue(path, tmp_path / "new.cuboid")


# In a process of its own: SQLite that waits cannot be interrupted.
ALL_WAYS = """
import sys
from pathlib import Path
from cuboid.ground.core.errors import InputError
from cuboid.runs.scene.checking import problems, rescue
from cuboid.runs.scene.database import open_to_read, Writing
path = Path(sys.argv[1])
for way in (open_to_read, Writing, problems, lambda scene: rescue(scene, path.with_name("new.cuboid"))):
    try:
        way(path)
    except InputError as error:
        print(error)
"""


@pytest.mark.parametrize("ending", ["-journal", "-wal"])
def test_nothing_waits_for_a_device_that_lies_where_a_log_belongs(path: Path, ending: str) -> None:
    place = path.with_name(path.name + ending)
    place.unlink(missing_ok=True)
    os.mkfifo(place)
    call = [sys.executable, "-c", ALL_WAYS, str(path)]
    done = subprocess.run(call, capture_output=True, text=True, check=True, timeout=100)
    said = f"{place}: is a FIFO, a regular file was expected: it belongs to the scene"
    assert done.stdout.splitlines() == [said] * 4
    assert place.is_fifo()


@pytest.mark.parametrize("links", [{1: 2, 2: 1}, {1: 1}])
def test_objects_that_were_merged_in_a_circle_are_told_and_rescued(path: Path, links: dict[int, int]) -> None:
    for label, into in links.items():
        change(path, "UPDATE objects SET state = 'merged', merged_into = ? WHERE label = ?", into, label)
    with pytest.raises(InputError, match=r"merged_into is damaged: 1 into (2 into )?1; 'cuboid scene check --rescue"):
        ask(path)
    assert any("merged_into is damaged" in line for line in problems(path))
    rescue(path, path.with_name("new.cuboid"))
    assert problems(path.with_name("new.cuboid")) == []
    with Scene.open(path.with_name("new.cuboid")) as scene:
        assert {item.label: item.state for item in scene.all_objects if item.label in links} == dict.fromkeys(
            links, "gone"
        )


@pytest.mark.parametrize(
    ("query", "says"),
    [
        ("UPDATE objects SET state = 'merged' WHERE label = 1", "object 1 is damaged: its state and 'merged_into'"),
        ("UPDATE objects SET merged_into = 2 WHERE label = 1", "object 1 is damaged: its state and 'merged_into'"),
        ("UPDATE boxes SET label = 999 WHERE label = 1", "boxes refers to object 999, which is not there"),
        ("UPDATE sightings SET label = 999 WHERE label = 1", "sightings refers to object 999, which is not there"),
    ],
)
def test_links_between_rows_are_checked(path: Path, query: str, says: str) -> None:
    change(path, query)
    assert any(line.startswith(says) for line in problems(path))
    rescue(path, path.with_name("new.cuboid"))
    assert problems(path.with_name("new.cuboid")) == []


@pytest.mark.parametrize("query", ["UPDATE blocks SET data = ? WHERE number = 1", "UPDATE arrays SET data = ?"])
def test_a_huge_value_is_refused_before_it_is_read(path: Path, query: str) -> None:
    if "arrays" in query:
        query += " WHERE rowid = (SELECT min(rowid) FROM arrays)"
    size = 400_000_000
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute(query.replace("?", f"zeroblob({size})"))
    connection.close()
    script = (
        "import resource, sys; from pathlib import Path; from cuboid.runs.scene.checking import problems\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "print(problems(Path(sys.argv[1])))\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)"
    )
    lines = subprocess.run([sys.executable, "-c", script, path], capture_output=True, text=True, check=True).stdout
    told, grown_kib = lines.splitlines()
    assert "damaged" in told
    assert int(grown_kib) < 150_000


def test_bytes_that_become_huge_are_refused_before_they_are_decompressed(path: Path) -> None:
    data = zlib.compress(bytes(20_000_000), 9)
    with pytest.raises(DamagedError, match="more than 80 bytes"):
        unpacked(data, check_sum(data), '["<f8", [10]]', "the array")
