"""Validation of text tables with one row per line: from words to valid numbers, or a one-line error."""

from __future__ import annotations

import csv
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TypeVar

import msgspec

from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.formats.json_validation import in_words
from cuboid.ground.formats.reading import text_lines


class Row(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A line of a table; its fields are the columns, in order. Older files lack the last ones, those with a default."""


R = TypeVar("R", bound=Row)


def header_of(kind: type[Row], separator: str = ",") -> str:
    """Return the header line of a table."""
    return separator.join(kind.__struct_fields__)


def column_names(path: Path) -> list[str]:
    """Return the names in the first line of a CSV."""
    with closing(text_lines(path)) as lines:
        return [name.strip() for name in next(lines, "").split(",")]


def read_table(path: Path, kind: type[R], *, any_order: bool = False) -> Iterator[tuple[int, R]]:
    """Iterate over the rows of a CSV with a header.

    Parameters
    ----------
    path : Path
    kind : type
        The description of a row.
    any_order : bool
        Whether columns may have any order, and other columns are ignored.

    Yields
    ------
    (int, Row)
        Number of its line, from 1, and the row. An empty cell is None.

    Raises
    ------
    InputError
        The file cannot be read, its header is wrong, or a cell is invalid; the message names file and line.
    """
    # Closed at once after a bad row, not when the error's traceback is garbage-collected.
    with closing(text_lines(path)) as lines:
        cells_of = csv.reader(lines, skipinitialspace=True)
        try:
            header = [name.strip() for name in next(cells_of, [])]
            columns = _columns(path, header, kind, any_order)
            for cells in cells_of:
                if not cells:
                    continue
                if len(cells) != len(header):
                    raise InputError(f"{path}:{cells_of.line_num}: expected {len(header)} values, got {len(cells)}")
                yield cells_of.line_num, parse_row(path, cells_of.line_num, [cells[k] for k in columns], kind)
        except csv.Error as error:
            raise InputError(f"{path}:{cells_of.line_num}: {error}") from None


def read_lines(path: Path, kind: type[R]) -> Iterator[tuple[int, R]]:
    """Iterate over the rows of a text file without header, numbers between blanks; # begins a comment line.

    Yields and raises as `read_table` does.
    """
    with closing(data_lines(path)) as lines:
        for number, line in lines:
            yield number, parse_row(path, number, line.split(), kind)


def data_lines(path: Path) -> Generator[tuple[int, str], None, None]:
    """Iterate over (line number from 1, line) of a text file, without empty lines and comments (#)."""
    for number, line in enumerate(text_lines(path), start=1):
        stripped = line.strip()
        if stripped and not stripped.startswith("#"):
            yield number, stripped


def parse_row(path: Path, line: int, cells: Sequence[str], kind: type[R]) -> R:
    """Return the row of cells; raise InputError if a cell is invalid."""
    if not _required(kind) <= len(cells) <= len(kind.__struct_fields__):
        raise InputError(f"{path}:{line}: expected {header_of(kind, ' ')}, got {len(cells)} values")
    try:
        return msgspec.convert([cell or None for cell in cells], kind, strict=False)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}:{line}: {_explained(error, cells, kind)}") from None


def _required(kind: type[Row]) -> int:
    """Return the number of columns that each file has."""
    return len(kind.__struct_fields__) - len(kind.__struct_defaults__)


def _columns(path: Path, header: list[str], kind: type[Row], any_order: bool) -> list[int]:
    """Return where in a line each field of a row stands."""
    names = kind.__struct_fields__
    if not any_order:
        if len(header) < _required(kind) or header != list(names[: len(header)]):
            raise InputError(f"{path}:1: expected the header '{header_of(kind)}'")
        return list(range(len(header)))
    missing = [name for name in names if name not in header]
    if missing:
        raise InputError(f"{path}:1: expected a header with {header_of(kind)}; missing: {', '.join(missing)}")
    return [header.index(name) for name in names]


def _explained(error: msgspec.ValidationError, cells: Sequence[str], kind: type[Row]) -> str:
    """Return what is wrong in a row: the column, what was expected, and what is there."""
    message, _, place = str(error).partition(" - at `$[")
    number = place.rstrip("`]")
    if not number.isdigit():
        return in_words(message)  # of the row as a whole
    message = in_words(message.partition(", got ")[0])
    if cells[int(number)].strip("+- ").lower() in ("nan", "inf", "infinity"):
        message = "expected a finite number"
    return f"{kind.__struct_fields__[int(number)]}: {message}, got {shown(cells[int(number)])}"
