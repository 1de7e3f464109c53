"""Stores that somebody spoilt: who reads one says so in a line, waits for nothing, and touches nothing beside it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from made_stores import put_run, thing

from cuboid.fleet.store.compact import compact
from cuboid.fleet.store.files import Manifest, manifest_name, store_files
from cuboid.fleet.store.find import find
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.query import Tables
from cuboid.fleet.store.schema import OBJECTS, RUNS, SIGHTINGS
from cuboid.ground.core.errors import InputError
from cuboid.services.queries.filters import Filters


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """One run that was gathered, and one that was not."""
    place = StoreFolder(str(tmp_path / "store"))
    put_run(place, 1, [thing(1)])
    compact(place)
    put_run(place, 2, [thing(2)])
    return tmp_path / "store"


def file_of(store: Path, table: str, kind: str = "gathered") -> Path:
    return next((store / table).glob(f"*/{kind}-*.parquet"))


def put_fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def put_dangling_link(path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


Spoil = Callable[[Path], object]
# Damage after which nothing tells which runs there are.
RUNS_SPOILT: dict[str, Spoil] = {
    "noise": lambda store: file_of(store, RUNS).write_bytes(bytes(range(256)) * 99),
    "of another table": lambda store: file_of(store, RUNS).write_bytes(file_of(store, OBJECTS).read_bytes()),
    "a device as manifest": lambda store: put_fifo(store / manifest_name(1)),
    "no manifest": lambda store: (store / manifest_name(1)).write_bytes(b"[" * 100_000),
}
SPOILT = RUNS_SPOILT | {
    "emptied": lambda store: file_of(store, OBJECTS).write_bytes(b""),
    "cut": lambda store: file_of(store, OBJECTS).write_bytes(file_of(store, OBJECTS).read_bytes()[:-100]),
    "missing": lambda store: file_of(store, SIGHTINGS).unlink(),
    "a device": lambda store: put_fifo(file_of(store, OBJECTS, "part")),
    "a link to nowhere as manifest": lambda store: put_dangling_link(store / manifest_name(1)),
    "no runs": lambda store: file_of(store, RUNS).unlink(),
}
GOOD = f"objects/day=2026-03-01/gathered-{'0' * 20}.parquet"


@pytest.mark.parametrize("spoil", SPOILT.values(), ids=SPOILT)
def test_a_damaged_store_is_told_in_one_line(store: Path, spoil: Spoil, refused: Callable[..., str]) -> None:
    spoil(store)
    for words in (["find", str(store)], ["sql", str(store), "select 1"], ["store", "compact", str(store)]):
        assert str(store) in refused(*words)


@pytest.mark.parametrize("spoil", RUNS_SPOILT.values(), ids=RUNS_SPOILT)
def test_no_recording_is_tracked_into_a_store_whose_runs_cannot_be_read(store: Path, spoil: Spoil) -> None:
    spoil(store)
    with pytest.raises(InputError, match="store"):
        store_files(StoreFolder(str(store)), every_key=True)


@pytest.mark.parametrize(
    "name",
    ["../../secret", "/etc/passwd", "objects/../../../secret", f"{GOOD}\n"],
)
def test_a_manifest_cannot_name_what_is_none_of_the_stores_files(store: Path, name: str) -> None:
    secret = store.parent.parent / "secret"
    secret.write_text("mine")
    (store / manifest_name(2)).write_bytes(msgspec.json.encode(Manifest(files={OBJECTS: [name]})))
    with pytest.raises(InputError, match="files"):
        compact(StoreFolder(str(store)))
    assert secret.read_text() == "mine"


def test_an_object_without_a_size_is_told(store: Path) -> None:
    path = file_of(store, OBJECTS)
    table = pq.read_table(path, partitioning=None)
    k = table.column_names.index("longest_m")
    pq.write_table(table.set_column(k, "longest_m", pa.nulls(len(table), pa.float64())), path)
    with pytest.raises(InputError, match="an object has no longest_m"):
        find(Tables(str(store)), Filters())


def test_what_is_whole_is_read_as_before(store: Path) -> None:
    assert Tables(str(store)).rows("select label from objects order by label") == [{"label": 1}, {"label": 2}]
    compact(StoreFolder(str(store)))
    assert Tables(str(store)).rows("select label from objects order by label") == [{"label": 1}, {"label": 2}]
