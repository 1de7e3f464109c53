"""One description of a record: what each field means, which values it has, and how files and tables hold it.

A record is a dataclass whose fields have metadata made by `column`. Result files, their documentation, tables, exports
and the columns of a store are made from it, so that a new field is declared once, in `core.results`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields
from functools import cache
from types import NoneType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from msgspec import UNSET

from cuboid.geometry.box import Box
from cuboid.geometry.se3 import quat_wxyz_from_rotation

# Digits after the point. Metres, seconds and fractions to a millionth; quaternions, rotations and normals to a
# billionth, so that a rotation that is read again is still one; pixels to a hundredth; color levels to a tenth.
LENGTH = 6
DIRECTION = 9
PIXEL = 2
LEVEL = 1


@dataclass(frozen=True, slots=True)
class Column:
    """How files and tables hold a field of a record.

    Attributes
    ----------
    name : str
        Of the field.
    kind : type
        The values and their range, as in `core.values`; of an array those of each part.
    type : type
        Of these: float, int, str or tuple.
    what : str
        Meaning.
    digits : int or None
        Digits after the point of numbers that are not whole; None for other values.
    parts : tuple of str
        Columns of a table that hold the numbers of an array; empty where one column holds the value.
    optional : bool
        Whether files leave it out where there is none.
    stored : bool
        Whether the tables of a store have it.
    """

    name: str
    kind: Any
    type: type
    what: str
    digits: int | None
    parts: tuple[str, ...]
    optional: bool
    stored: bool

    @property
    def plain_kind(self) -> Any:
        """The values in JSON."""
        return tuple[(self.kind,) * len(self.parts)] if self.parts else self.kind  # type: ignore[misc]

    @property
    def names(self) -> tuple[str, ...]:
        """Its columns in a table."""
        return self.parts or (self.name,)

    def plain(self, record: Any) -> Any:
        """Return the value of a record as JSON has it."""
        return _plain(getattr(record, self.name), self.digits)

    def values(self, record: Any) -> tuple[Any, ...]:
        """Return the value of a record for each of `names`, numbers with all their digits."""
        value = getattr(record, self.name)
        if self.parts:
            return (None,) * len(self.parts) if value is None else tuple(value.tolist())
        return (list(value) if isinstance(value, tuple) else value,)

    def cells(self, record: Any) -> Iterator[str]:
        """Iterate over the texts of a record for `names`; empty where there is no value."""
        for value in self.values(record):
            yield _cell(value, self.digits)

    def read(self, value: Any) -> Any:
        """Return the value for a record from that of a file, which has been validated."""
        if self.optional and value in (UNSET, ""):
            return None
        if self.parts:
            return None if value[0] is None else np.array(value)
        return value


def column(
    what: str, *, kind: Any = None, digits: int = LENGTH, parts: tuple[str, ...] = (), stored: bool = True
) -> Mapping[str, Any]:
    """Return the metadata of a field of a record; the arguments are the attributes of `Column`.

    The kind is the annotation of the field unless given.
    """
    return {"column": (what, kind, digits, parts, stored)}


def columns_of(record: type) -> tuple[Column, ...]:
    """Return the described fields of a dataclass, in order."""
    return _columns(record)


@cache
def _columns(record: type) -> tuple[Column, ...]:
    hints, found = get_type_hints(record, include_extras=True), []
    for field in fields(record):
        if "column" in field.metadata:
            what, kind, digits, parts, stored = field.metadata["column"]
            optional = field.default is not MISSING and field.default is None
            kind = kind or hints[field.name]
            if optional:  # left out of files instead
                kind = Union[tuple(one for one in get_args(kind) if one is not NoneType)]  # noqa: UP007
            type_ = next(one for one in (tuple, float, int, str) if one in _types(kind))
            digits = digits if type_ is float else None
            found.append(Column(field.name, kind, type_, what, digits, parts, optional, stored))
    return tuple(found)


def names_in(columns: Iterable[Column]) -> tuple[str, ...]:
    """Return the columns of a table for fields."""
    return tuple(name for one in columns for name in one.names)


def plain_fields(record: Any, columns: Iterable[Column] | None = None) -> dict[str, Any]:
    """Return fields of a record (all that are described unless given) as JSON has them."""
    chosen = columns_of(type(record)) if columns is None else columns
    values = ((one, one.plain(record)) for one in chosen)
    return {one.name: value for one, value in values if not one.optional or value not in (None, "")}


def box_numbers(box: Box) -> list[float]:
    """Return centre, size and quaternion (w first) of a box: the ten numbers of each table with boxes."""
    return [*box.center.tolist(), *box.size.tolist(), *quat_wxyz_from_rotation(box.rotation).tolist()]


def _types(kind: Any) -> Iterator[Any]:
    """Iterate over the plain types in an annotation."""
    inside = getattr(kind, "__origin__", None), *get_args(kind)
    if get_origin(kind) is None:
        yield str if isinstance(kind, str) else kind  # a text of a Literal
    for one in inside:
        if one is not None and one is not kind:
            yield from _types(one)


def _plain(value: Any, digits: int | None) -> Any:
    if value is None or digits is None:
        return list(value) if isinstance(value, tuple) else value
    if isinstance(value, np.ndarray):
        return [round(float(one), digits) + 0.0 for one in value]
    return round(float(value), digits) + 0.0


def _cell(value: Any, digits: int | None) -> str:
    if value is None:
        return ""
    if digits is not None:
        return f"{float(value):z.{digits}f}"
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)
