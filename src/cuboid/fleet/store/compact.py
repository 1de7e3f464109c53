"""Compaction: merges the many small files that runs write into few large ones."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import PurePosixPath

import duckdb
import msgspec
import pyarrow as pa

from cuboid.fleet.store.files import Manifest, Part, StoreFiles, manifest_name, manifests, name_of, store_files
from cuboid.fleet.store.folder import RESULTS, StoreFolder
from cuboid.fleet.store.query import connected, read
from cuboid.fleet.store.schema import TABLES
from cuboid.ground.core.errors import InputError, one_line
from cuboid.ground.formats.reading import UnreadableError

# Gathered files of at least this size are not rewritten: this bounds the cost of adding to a day.
LARGE_FILE_BYTES = 32 << 20

# Number of manifests that are kept: a reader that has just looked up the newest one still finds it.
KEPT_MANIFESTS = 2


@dataclass(frozen=True, slots=True)
class Compaction:
    """The outcome of `compact`.

    Attributes
    ----------
    runs : int
        Runs whose files were gathered.
    files_before, files_after : int
        Number of valid files of all tables.
    """

    runs: int
    files_before: int
    files_after: int


def compact(place: StoreFolder) -> Compaction:
    """Merge the parts of a store, one file per table and day; an interruption loses and duplicates no rows.

    Parameters
    ----------
    place : StoreFolder

    Returns
    -------
    Compaction
        With 0 runs if there was nothing to gather, or if another process has just done it.

    Raises
    ------
    InputError, OutputError
        The store cannot be read or written.
    """
    before = store_files(place)
    place.remove(name for part in before.leftovers for name in part.names().values())
    count = _count(before)
    if not before.parts:
        return Compaction(0, count, count)
    try:
        files, written = _gather(place, before)
    except FileNotFoundError:  # another process has gathered them meanwhile
        return Compaction(0, count, count)
    manifest = msgspec.json.format(msgspec.json.encode(Manifest(files=files)), indent=1)
    if not place.create(manifest_name(before.number + 1), manifest):
        after = store_files(place)
        place.remove(set(written) - {name for names in after.gathered.values() for name in names})
        return Compaction(0, count, _count(after))
    old = {name for names in before.gathered.values() for name in names}
    place.remove(sorted(old - {name for names in files.values() for name in names}))
    place.remove(name for part in before.parts for name in part.names().values())
    place.remove(manifest_name(number) for number in manifests(place)[:-KEPT_MANIFESTS])
    return Compaction(len(before.parts), count, sum(map(len, files.values())))


def _gather(place: StoreFolder, before: StoreFiles) -> tuple[dict[str, list[str]], list[str]]:
    """Write the gathered files; return all valid gathered files by table, and the new ones."""
    files: dict[str, list[str]] = {}
    written: list[str] = []
    for table, kind in TABLES.items():
        days = _by_day(before.parts, table)
        kept: list[str] = []
        for name in before.gathered.get(table, ()):
            day = PurePosixPath(name).parent.name
            if day in days and place.fs.size(place.path(name)) < LARGE_FILE_BYTES:
                days[day].append(name)
            else:
                kept.append(name)
        for day, names in sorted(days.items()):
            rows = _rows(place, names, table)
            digest = hashlib.sha256("\n".join(sorted(names)).encode()).hexdigest()[:20]
            name = name_of(table, day, f"gathered-{digest}")
            place.put_table(name, kind.sorted(rows), kind.group_rows)
            written.append(name)
            kept.append(name)
        files[table] = sorted(kept)
    return files, written


def _rows(place: StoreFolder, names: list[str], table: str) -> pa.Table:
    """Return the rows of many small files, read by DuckDB; raise FileNotFoundError if one is gone."""
    with connected(place, {"threads": 1}) as connection:
        try:
            rows = connection.sql(read(place, names, partitioned=False))
            schema = TABLES[table].schema
            return rows.to_arrow_table().select(schema.names).cast(schema)
        except (duckdb.Error, UnreadableError, pa.ArrowException, KeyError, ValueError) as error:
            gone = next((name for name in names if not place.fs.exists(place.path(name))), None)
            if gone is not None:
                raise FileNotFoundError(gone) from None
            raise InputError(f"{place.url}: cannot be gathered: {one_line(str(error))}") from None


def _by_day(parts: Iterable[Part], table: str) -> dict[str, list[str]]:
    days: dict[str, list[str]] = {}
    for part in parts:
        if table in part.names():
            days.setdefault(part.day, []).append(part.names()[table])
    return days


def tidy(place: StoreFolder) -> int:
    """Remove unreferenced table files and partial results of killed processes; return their number.

    Young files stay: their process may still be running.
    """
    found = store_files(place)
    listed = {name for table in TABLES for name in found.files(table)}
    young = datetime.now(UTC) - timedelta(days=1)
    strange = [name for table in TABLES for name in place.names(table) if name not in listed]
    old = [name for name in strange if place.fs.modified(place.path(name)) < young]
    place.remove(old)
    return len(old) + _tidy_results(place, young)


def _tidy_results(place: StoreFolder, young: datetime) -> int:
    """Remove partial folders of results; return their number."""
    if place.local is None:
        return 0
    partial = [path for path in place.local.glob(f"{RESULTS}/**/.*.partial") if path.is_dir()]
    old = [path for path in partial if datetime.fromtimestamp(path.stat().st_mtime, UTC) < young]
    for path in old:
        shutil.rmtree(path, ignore_errors=True)
    return len(old)


def _count(found: StoreFiles) -> int:
    return sum(len(found.files(table)) for table in TABLES)
