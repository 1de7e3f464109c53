"""Stores whose tables and manifest were spoilt, in their bytes and in their columns, and all that reads them."""

from __future__ import annotations

import io
import random
import sys
from pathlib import Path

import targets  # noqa: F401 - finds the other tests' helpers
from changes import Change
from engine import Target
from mutations import mutated

sys.path.append(str(Path(__file__).resolve().parents[1] / "store"))

# No table of a store that a test makes is as large.
SMALL_BYTES = 1 << 20


def make_store(folder: Path) -> None:
    """Write a store of two runs that were gathered, and one that was not."""
    from made_stores import put_run, thing

    from cuboid.fleet.store.compact import compact
    from cuboid.fleet.store.folder import StoreFolder

    place = StoreFolder(str(folder))
    put_run(place, 1, [thing(1), thing(2, longest_m=0.3)])
    put_run(place, 2, [thing(1, color="red")])
    compact(place)
    put_run(place, 4, [thing(3)])


def files_of(folder: Path) -> list[str]:
    """Return all files of a store, that of the manifest as often as all tables."""
    tables = sorted(str(path.relative_to(folder)) for path in folder.rglob("*.parquet"))
    return tables + [str(path.relative_to(folder)) for path in folder.rglob("*.json")] * len(tables)


def mutated_store(rng: random.Random, path: str, content: bytes) -> Change:
    """Return a change of a file: of its bytes, of what it is, or of a column."""
    if not path.endswith(".parquet") or rng.random() < 0.5:
        return mutated(rng, path, content)
    return Change(path, of_columns(rng, content))


def of_columns(rng: random.Random, content: bytes) -> bytes:
    """Remove a column, or let it be called otherwise, be of another type, or hold nothing."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(io.BytesIO(content), partitioning=None)
    k = rng.randrange(table.num_columns)
    name, rows = table.column_names[k], table.num_rows
    match rng.randrange(6):
        case 0:
            table = table.remove_column(k)
        case 1:
            names = table.column_names
            table = table.rename_columns([*names[:k], rng.choice(("x", "\x00", "")), *names[k + 1 :]])
        case 2:
            table = table.set_column(k, name, pa.nulls(rows, table.schema.field(k).type))
        case 3:
            word = rng.choice(("", "x" * 9999, "\x1b[2J", "-1"))
            table = table.set_column(k, name, pa.array([word] * rows, pa.string()))
        case 4:
            table = table.set_column(k, name, pa.array([rng.choice((0.0, float("nan"), 1e308, -1.0))] * rows))
        case 5:
            table = table.slice(0, 0)
    out = io.BytesIO()
    pq.write_table(table, out)
    return out.getvalue()


def ask(folder: Path) -> None:
    """Ask for objects, in each way."""
    from cuboid.fleet.store.find import find
    from cuboid.fleet.store.page import objects_page
    from cuboid.fleet.store.query import Tables
    from cuboid.services.queries.filters import Filters
    from cuboid.services.queries.search_page import found_page

    tables = Tables(str(folder))
    for filters in (
        Filters(),
        Filters(size_m=(0.0, 1.0), near=(0.0, 0.0, 0.0)),
        Filters(color="grey", min_probability=0.5),
    ):
        found_page(find(tables, filters, ("picture",)), "a")
    find(tables, Filters(like=("rec-1", 1)))
    objects_page(tables, {})


def sum_up(folder: Path) -> None:
    """Make the page."""
    from cuboid.fleet.store.page import write_summary

    write_summary(str(folder))


def gather(folder: Path) -> None:
    """Gather what is there; what that removes comes back."""
    from cuboid.fleet.store.compact import compact
    from cuboid.fleet.store.folder import StoreFolder

    tables = [path for path in folder.rglob("*.parquet") if path.is_file() and path.stat().st_size < SMALL_BYTES]
    before = {path: path.read_bytes() for path in tables}
    try:
        compact(StoreFolder(str(folder)))
    finally:
        for path, content in before.items():
            if not path.exists():
                path.write_bytes(content)


def batch(folder: Path) -> None:
    """Ask what was tracked before."""
    from cuboid.fleet.store.files import store_files
    from cuboid.fleet.store.folder import StoreFolder

    store_files(StoreFolder(str(folder)), every_key=True)


STORES = {
    "stores": Target(
        make_store, files_of, {"ask": ask, "sum up": sum_up, "gather": gather, "batch": batch}, mutated_store
    )
}
