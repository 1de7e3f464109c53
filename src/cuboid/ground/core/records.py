"""One description of a record: the meaning and values of each field, and how files and tables store it.

A record is a dataclass whose fields have metadata made by `column`. Result files, their documentation, tables, exports
and the columns of a store are derived from it, so that a new field is declared only once, in `core.results`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, replace
from functools import cache
from types import NoneType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from msgspec import UNSET, Struct

from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation

# Digits after the point. Metres, seconds and fractions: a millionth. Quaternions, rotations and normals: a
# billionth, so that a rotation that is read back is still valid. Pixels: a hundredth. Color levels: a tenth.
LENGTH = 6
DIRECTION = 9
PIXEL = 2
COLOR_LEVEL = 1


@dataclass(frozen=True, slots=True)
class Column:
    """How files and tables store one field of a record.

    Attributes
    ----------
    name : str
        Name of the field.
    kind : type
        Type of the values with their range, as in `core.values`; for an array, type of each element.
    type : type
        Plain Python type of the values: float, int, str or tuple.
    meaning : str
    digits : int or None
        Digits after the point of floating-point values; None if there are none.
    parts : tuple of str
        Table columns for the elements of an array; empty if one column holds the value.
    default : object
        Value in place of which files omit the field; `dataclasses.MISSING` for a field that they always contain.
    tables : bool
        Whether tables contain it; otherwise it is in JSON only.
    stored : bool
        Whether the tables of a store contain it.
    repeats : str
        Name of the field whose value it has under another name; empty for a field of its own. It is written, not read.
    """

    name: str
    kind: Any
    type: type
    meaning: str
    digits: int | None
    parts: tuple[str, ...]
    default: Any
    tables: bool
    stored: bool
    repeats: str = ""

    @property
    def optional(self) -> bool:
        """Whether files omit the field when it has its default value."""
        return self.default is not MISSING

    @property
    def plain_kind(self) -> Any:
        """Type of the value in JSON."""
        return tuple[(self.kind,) * len(self.parts)] if self.parts else self.kind  # type: ignore[misc]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its columns in a table."""
        return self.parts or (self.name,)

    def plain(self, record: Any) -> Any:
        """Return the value of a record as JSON stores it."""
        return _plain(getattr(record, self.name), self.digits)

    def values(self, record: Any) -> tuple[Any, ...]:
        """Return the value of a record for each of `names`, numbers unrounded."""
        value = getattr(record, self.name)
        if self.parts:
            return (None,) * len(self.parts) if value is None else tuple(value.tolist())
        return (list(value) if isinstance(value, tuple) else value,)

    def cells(self, record: Any) -> Iterator[str]:
        """Iterate over the value of a record as text, one for each of `names`; empty text if there is no value."""
        for value in self.values(record):
            yield _cell(value, self.digits)

    def read(self, value: Any) -> Any:
        """Return the value for a record from a validated value of a file."""
        if self.optional and value in (UNSET, ""):
            return self.default
        if self.parts:
            return None if value[0] is None else np.array(value)
        return value


def column(
    meaning: str,
    *,
    kind: Any = None,
    digits: int = LENGTH,
    parts: tuple[str, ...] = (),
    tables: bool = True,
    stored: bool = True,
    also: str = "",
) -> Mapping[str, Any]:
    """Return the metadata of a field of a record; the arguments are the attributes of `Column`.

    The kind is the annotation of the field unless given. `also` names a property of the record that has the same value:
    all that is written has it too, after the field.
    """
    return {"column": (meaning, kind, digits, parts, tables, stored), "also": also}


def columns_of(record: type) -> tuple[Column, ...]:
    """Return the columns of the described fields of a dataclass, in order."""
    return _columns(record)


def table_columns_of(record: type) -> tuple[Column, ...]:
    """Return the columns of those described fields of a dataclass that tables contain, in order."""
    return tuple(item for item in columns_of(record) if item.tables)


@cache
def _columns(record: type) -> tuple[Column, ...]:
    hints, found = get_type_hints(record, include_extras=True), []
    for field in fields(record):
        if "column" in field.metadata:
            meaning, kind, digits, parts, tables, stored = field.metadata["column"]
            kind = kind or hints[field.name]
            if field.default is None:  # files omit the field instead of storing null
                kind = Union[tuple(item for item in get_args(kind) if item is not NoneType)]  # noqa: UP007
            type_ = next(item for item in (tuple, float, int, str) if item in _types(kind))
            digits = digits if float in _types(kind) else None
            found.append(Column(field.name, kind, type_, meaning, digits, parts, field.default, tables, stored))
            if field.metadata["also"]:  # older files do not have it
                also = replace(found[-1], name=field.metadata["also"], default=None, repeats=field.name)
                found.append(also)
    return tuple(found)


def names_in(columns: Iterable[Column]) -> tuple[str, ...]:
    """Return the names of the table columns of these fields."""
    return tuple(name for item in columns for name in item.names)


def plain_fields(record: Any, columns: Iterable[Column] | None = None) -> dict[str, Any]:
    """Return fields of a record as JSON stores them; by default all described fields."""
    chosen = columns_of(type(record)) if columns is None else columns
    given = (item for item in chosen if not item.optional or getattr(record, item.name) not in (item.default, ""))
    return {item.name: item.plain(record) for item in given}


def box_numbers(box: Box) -> list[float]:
    """Return centre, size and quaternion (w first) of a box: the ten numbers of every table with boxes."""
    return [*box.center.tolist(), *box.size.tolist(), *quat_wxyz_from_rotation(box.rotation).tolist()]


def _types(kind: Any) -> Iterator[Any]:
    """Iterate over the plain types in an annotation."""
    inside = getattr(kind, "__origin__", None), *get_args(kind)
    if isinstance(kind, type) and issubclass(kind, Struct):
        inside = tuple(get_type_hints(kind, include_extras=True).values())
    if get_origin(kind) is None:
        yield str if isinstance(kind, str) else kind  # a text of a Literal
    for part in inside:
        if part is not None and part is not kind:
            yield from _types(part)


def _plain(value: Any, digits: int | None) -> Any:
    if isinstance(value, Struct):
        names = zip(value.__struct_encode_fields__, value.__struct_fields__, strict=True)
        return {written: _plain(getattr(value, name), digits) for written, name in names}
    if isinstance(value, tuple | np.ndarray):
        return [_plain(item, digits) for item in value]
    if digits is None or value is None or isinstance(value, int | str):
        return value
    return round(float(value), digits) + 0.0


def _cell(value: Any, digits: int | None) -> str:
    if value is None:
        return ""
    if digits is not None:
        return f"{float(value):z.{digits}f}"
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)
