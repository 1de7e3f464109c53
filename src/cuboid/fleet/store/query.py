"""The tables of a store through DuckDB, in this process: one view per table, over its valid files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import PurePosixPath
from threading import Lock
from typing import Any, TypeVar

import duckdb
import msgspec
import pyarrow as pa

from cuboid.fleet.store.files import READ_ATTEMPTS, StoreFiles, store_files
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.schema import ALL_OBJECTS, DONE, OBJECTS, RUNS, TABLES
from cuboid.ground.core.errors import InputError, one_line
from cuboid.ground.formats.reading import MAX_BINARY_BYTES, UnreadableError, opened

Found = TypeVar("Found")

# Memory limit of a query; DuckDB does not spill to disk, and raises an error if the limit is too low.
MEMORY_LIMIT = "400MB"

# Table of runs whose recording has a newer run, with other settings or by another version: searches leave them out.
SUPERSEDED = "superseded"

# Folder of the names that people gave to objects: a file RUN.json with names by label.
NAMES = "names"
_GIVEN = pa.schema([("run", pa.string()), ("label", pa.int32()), ("given", pa.string())])


class Tables:
    """The tables of a store, as they are when this object is made.

    Parameters
    ----------
    url : str
    threads : int

    Attributes
    ----------
    kept : dict
        Slow answers about the present files, by name.

    Raises
    ------
    InputError
        There is no store, or it is damaged.
    """

    def __init__(self, url: str, threads: int = 1) -> None:
        self.url = url
        self.kept: dict[str, Any] = {}
        self._place = StoreFolder(url)
        self._threads = threads
        self._open()

    def _open(self) -> None:
        for attempt in range(READ_ATTEMPTS):
            self._files, self._names = store_files(self._place), read_names(self._place)
            if self._files.empty:
                fault = "expected a store that 'cuboid batch' wrote, found no runs in it"
                raise InputError(
                    f"{self.url}: {fault if self._place.fs.exists(self._place.root) else 'does not exist'}"
                )
            try:
                self._connect()
                return
            except (duckdb.Error, UnreadableError) as error:
                if attempt == READ_ATTEMPTS - 1 or store_files(self._place) == self._files:
                    raise InputError(f"{self.url}: is damaged: {_first_line(error)}") from None
                # otherwise the files were gathered meanwhile: try again

    def _connect(self) -> None:
        self._connection = connected(self._place, {"threads": self._threads, "memory_limit": MEMORY_LIMIT})
        for table, kind in TABLES.items():
            view = ALL_OBJECTS if table == OBJECTS else table
            self._connection.execute(f"create view {view} as {self._select(table, self._files)}")
            self._refuse_other(view, kind.schema)
        self._put_names()
        there = f"select * from {ALL_OBJECTS} where not gone"
        self._connection.execute(f"create view {OBJECTS} as {there}")
        self.kept = {}
        self._connection.execute("set parquet_metadata_cache = true")
        self._connection.execute(
            f"create temp table {SUPERSEDED} as select run from {RUNS} where state = '{DONE}' "
            "qualify row_number() over (partition by source order by finished desc, run) > 1"
        )

    def _put_names(self) -> None:
        """Put the names that people gave in place of those of the detector."""
        rows = [
            {"run": run, "label": label, "given": name}
            for run, names in self._names.items()
            for label, name in names.items()
        ]
        if not rows:
            return
        self._connection.register("given_names", pa.Table.from_pylist(rows, schema=_GIVEN))
        columns = "coalesce(given, name) as name, case when given is null then name_score end as name_score"
        both = f"({self._select(OBJECTS, self._files)}) left join given_names using (run, label)"
        chosen = f"select * exclude (given) replace ({columns}) from {both}"
        self._connection.execute(f"create or replace view {ALL_OBJECTS} as {chosen}")

    def _refuse_other(self, table: str, schema: pa.Schema) -> None:
        """Raise InputError if a table lacks required columns."""
        found = self._answer(f"select * from {table} limit 0", None)
        try:
            found.select(schema.names).cast(schema)
        except (pa.ArrowException, KeyError, ValueError) as error:
            raise InputError(f"{self.url}: the table {table} is not as it must be: {one_line(str(error))}") from None

    def _select(self, table: str, files: StoreFiles) -> str:
        names = files.files(table)
        if names:
            return read(self._place, names, partitioned=True)
        # every recording failed
        self._connection.register(f"_{table}", pa.Table.from_pylist([], schema=TABLES[table].schema))
        return f"select *, null::date as day from _{table}"

    def refresh(self) -> None:
        """Update the tables to the present files."""
        if store_files(self._place) != self._files or read_names(self._place) != self._names:
            self._open()

    def ask(self, question: str, values: object = None) -> pa.Table:
        """Return the result of an SQL query.

        Raises
        ------
        InputError
            DuckDB cannot run the query.
        """
        return self._asked(lambda: self._answer(question, values))

    def _answer(self, question: str, values: object) -> pa.Table:
        answer = self._connection.sql(question, params=values)
        return pa.table({}) if answer is None else answer.to_arrow_table()

    def rows(self, question: str, values: object = None) -> list[dict[str, Any]]:
        """Return the result as one dict per row; raises as `ask`."""
        rows: list[dict[str, Any]] = self.ask(question, values).to_pylist()
        return rows

    def _asked(self, answer: Callable[[], Found]) -> Found:
        for _ in range(READ_ATTEMPTS):
            try:
                return answer()
            except duckdb.Error as error:
                if not isinstance(error, duckdb.IOException) or store_files(self._place) == self._files:
                    raise InputError(_first_line(error)) from None
                self._open()  # the files were gathered into others meanwhile
        return answer()


class SharedTables:
    """The tables of a store for a server: one query at a time, of any thread, from the tables as they are then.

    Parameters
    ----------
    url : str

    Raises
    ------
    InputError
        There is no store, or it is damaged.
    """

    def __init__(self, url: str) -> None:
        self._tables, self._lock = Tables(url), Lock()

    def ask(self, question: Callable[[Tables], Found]) -> Found:
        """Return the answer to a question; raises what the question raises."""
        with self._lock:
            self._tables.refresh()
            return question(self._tables)


def read_names(place: StoreFolder) -> dict[str, Mapping[int, str]]:
    """Return the names that people gave, by run and label.

    Raises
    ------
    InputError
        A file of names is damaged.
    """
    found: dict[str, Mapping[int, str]] = {}
    for file in place.names(NAMES):
        try:
            found[PurePosixPath(file).stem] = msgspec.json.decode(place.read(file), type=dict[int, str])
        except FileNotFoundError:
            continue
        except msgspec.MsgspecError as error:
            raise InputError(f"{place.url}/{file}: is damaged: {one_line(str(error))}") from None
    return found


def connected(place: StoreFolder, config: dict[str, Any]) -> duckdb.DuckDBPyConnection:
    """Return an in-memory DuckDB connection that can read the files of a place."""
    connection = duckdb.connect(config=config)
    if place.local is None:
        connection.register_filesystem(place.fs)
    return connection


def read(place: StoreFolder, names: Iterable[str], *, partitioned: bool) -> str:
    """Return the query for the rows of a table in files."""
    return f"select * from read_parquet({listed(place, names)}, hive_partitioning = {str(partitioned).lower()})"


def listed(place: StoreFolder, names: Iterable[str]) -> str:
    """Return files as an SQL list; raise UnreadableError for anything else (DuckDB would wait for a pipe)."""
    names = list(names)
    if place.local is not None:
        for name in names:
            with opened(place.local / name, MAX_BINARY_BYTES):
                pass
    addresses = (place.address(name).replace("'", "''") for name in names)
    return "[" + ", ".join(f"'{address}'" for address in addresses) + "]"


def _first_line(error: Exception) -> str:
    return one_line(str(error).split("\n\n")[0])
