"""Validation of scene files: every value is checked against its column as the row is read."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, TypeAlias, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec import Meta

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.values import Name, Point, refuse_no_quaternion
from cuboid.ground.formats.json_validation import in_words
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import rotation_from_quat_wxyz
from cuboid.runs.scene.schema import QUATERNION, TABLES

T = TypeVar("T")
Row = tuple[Any, ...]

# Number of rows of a large table that are read and checked at a time.
ROWS_A_TIME = 64


class Settings(msgspec.Struct, frozen=True):
    """The fields of `recordings.settings` that are used."""

    every: Annotated[int, Meta(ge=1, le=10**9)] = 1
    scale: Annotated[int, Meta(ge=1, le=10**4)] = 1


class RigSettings(msgspec.Struct, frozen=True):
    """The fields of a rig in `recordings.settings` that are used."""

    cameras: list[Name]
    sequence: list[Annotated[int, Meta(ge=0)]]


class SettingsOfRig(msgspec.Struct, frozen=True):
    """The rig in `recordings.settings`; unset for one camera."""

    rig: RigSettings | msgspec.UnsetType = msgspec.UNSET


Outline: TypeAlias = list[Point]


class DamagedError(InputError):
    """The contents of a scene file differ from those that were written."""


def read_rows(
    connection: sqlite3.Connection, columns: Iterable[str], rest: str, values: Iterable[Any] = ()
) -> list[Row]:
    """Return the rows of a query, with each value checked against its column.

    Parameters
    ----------
    connection : sqlite3.Connection
    columns : iterable of str
        Columns with their tables: "objects.label".
    rest : str
        The query after "SELECT ... FROM".
    values : iterable
        Values for the placeholders of the query.

    Raises
    ------
    DamagedError
        A value is invalid in its column.
    """
    names = tuple(columns)
    rows = connection.execute(f"SELECT {', '.join(names)} FROM {rest}", tuple(values)).fetchall()
    return checked(rows, names)


def iterate_table(connection: sqlite3.Connection, table: str) -> Iterator[Row]:
    """Iterate over the rows of a whole table, which may be large; raises as `read_rows`."""
    columns = columns_of(table)
    cursor = connection.execute(f"SELECT {', '.join(columns)} FROM {table}")
    while rows := cursor.fetchmany(ROWS_A_TIME):
        yield from checked(rows, columns)


def checked(rows: list[Row], columns: Sequence[str]) -> list[Row]:
    """Return rows after checking them against columns such as "objects.label"; raises as `read_rows`."""
    try:
        found: list[Row] = msgspec.convert(rows, _kind(tuple(columns)))
        return found
    except msgspec.ValidationError as error:
        problem, _, place = str(error).partition(" - at `$[")
        row, column = (int(number) for number in place.rstrip("`]").split("]["))
        problem = in_words(problem.partition(", got ")[0])
        raise DamagedError(f"{columns[column]} is damaged: {problem}, got {shown(rows[row][column])}") from None


def refuse_oversized(connection: sqlite3.Connection, table: str) -> None:
    """Raise DamagedError if a value is larger than its column of bytes allows; no value is read for this."""
    for name, kind in TABLES[table].columns.items():
        limits = [meta.max_length for meta in getattr(kind, "__metadata__", ()) if meta.max_length is not None]
        if not limits or kind.__origin__ is not bytes:
            continue
        for (size,) in connection.execute(f"SELECT max(length({name})) FROM {table}"):
            if size is not None and size > min(limits):
                raise DamagedError(f"{table}.{name} is damaged: {size} bytes, expected at most {min(limits)}")


def refuse_cycle(merged_into: Mapping[int, int | None]) -> None:
    """Raise DamagedError if objects, by label, were merged into each other in a circle."""
    found = cycles_of(merged_into)
    if found:
        circle = " into ".join(str(label) for label in (*found[0], found[0][0]))
        raise DamagedError(f"objects.merged_into is damaged: {circle}")


def cycles_of(merged_into: Mapping[int, int | None]) -> list[list[int]]:
    """Return the circles of labels that were merged into each other, each from its lowest label."""
    cycles: list[list[int]] = []
    seen: set[int] = set()
    for start in sorted(merged_into):
        chain: list[int] = []
        label: int | None = start
        while label is not None and label not in seen:
            seen.add(label)
            chain.append(label)
            label = merged_into.get(label)
        if label in chain:
            cycle = chain[chain.index(label) :]
            first = cycle.index(min(cycle))
            cycles.append(cycle[first:] + cycle[:first])
    return cycles


@cache
def _kind(columns: tuple[str, ...]) -> Any:
    kinds = [TABLES[table].columns[name] for table, name in (column.split(".") for column in columns)]
    return list[tuple[tuple(kinds)]]  # type: ignore[misc]


def columns_of(table: str, names: Iterable[str] | None = None) -> tuple[str, ...]:
    """Return all or the named columns of a table, each with the table's name in front."""
    return tuple(f"{table}.{name}" for name in names or TABLES[table].columns)


def refuse_no_row(table: str, row: Row) -> None:
    """Raise DamagedError unless a complete row of a table is valid."""
    checked([row], columns_of(table))
    names = list(TABLES[table].columns)
    if "qw" in names:
        rotation_of([row[names.index(name)] for name in QUATERNION], table)


def document(text: str, kind: type[T], subject: str) -> T:
    """Return the contents of JSON text in a column; raise DamagedError if they do not match `kind`."""
    try:
        return msgspec.json.decode(text, type=kind)
    except (msgspec.DecodeError, RecursionError, UnicodeError) as error:
        raise DamagedError(f"{subject} is damaged: {in_words(str(error))}") from None


def rotation_of(quat_wxyz: Sequence[float], subject: str) -> Float64Array:
    """Return the rotation (3, 3) of a quaternion in a row; raise DamagedError if it is invalid."""
    try:
        refuse_no_quaternion(*quat_wxyz)
    except ValueError as error:
        raise DamagedError(f"a row of {subject} is damaged: {error}") from None
    return rotation_from_quat_wxyz(quat_wxyz)


def floats_of(data: bytes, kind: str, subject: str) -> npt.NDArray[Any]:
    """Return finite numbers of a NumPy type from bytes in a row; raise DamagedError if any is not finite."""
    numbers = np.frombuffer(data, kind) if len(data) % np.dtype(kind).itemsize == 0 else np.array([np.nan])
    if not np.isfinite(numbers).all():
        raise DamagedError(f"{subject} is damaged: expected finite numbers")
    return numbers


def box_of(numbers: Sequence[float], subject: str) -> Box:
    """Return the box of centre, size and quaternion (w first) in a row; raise DamagedError if invalid."""
    return Box(np.array(numbers[:3]), np.array(numbers[3:6]), rotation_of(numbers[6:10], subject))
