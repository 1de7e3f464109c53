"""Exact conversion between states and rows of a scene file: fields are MessagePack, large arrays have their own rows.

A nested record has its own row too; its key is its path: `tracker/planes/planes/3` is plane 3. The types come from the
annotations of the fields: nothing else is read or written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from operator import attrgetter
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
import numpy.typing as npt

from cuboid.ground.core.state import Record, saved_fields
from cuboid.runs.scene.packing import form_of, from_bytes, from_form
from cuboid.runs.scene.validation import DamagedError

R = TypeVar("R", bound=Record)
AnyArray = npt.NDArray[Any]

# An array larger than this, bytes, has its own row in the file, which is written only when the array changes.
LARGE_ARRAY_BYTES = 512


@dataclass(frozen=True, slots=True)
class Part:
    """A record as it is saved.

    Attributes
    ----------
    fields : bytes
        MessagePack: a map of the fields by name. A small array is stored as form and bytes, a large one as its name. A
        dict of records is stored as its keys; a single nested record is left out.
    arrays : dict of str to (str, array)
        Large arrays by field, each with its form. If the array is the same object as before, it has not changed.
    """

    fields: bytes
    arrays: dict[str, tuple[str, AnyArray]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Layout:
    """The layout of a record class: field names, fields that hold one record or many, and the row's type."""

    names: tuple[str, ...]
    values: Callable[[Record], tuple[Any, ...]]
    one: dict[str, type[Record]]
    many: dict[str, type[Record]]
    row: type[msgspec.Struct]


@cache
def layout_of(cls: Any) -> Layout:
    """Return the layout of a class of records, from the annotations of its fields."""
    hints, names = get_type_hints(cls), saved_fields(cls)
    records = {name: hints[name] for name in names if _is_record(hints[name])}
    record_dicts = {
        name: get_args(hints[name])[1]
        for name in names
        if get_origin(hints[name]) is dict and _is_record(get_args(hints[name])[1])
    }
    columns = [
        (name, tuple[int, ...] if name in record_dicts else hints[name]) for name in names if name not in records
    ]
    values = attrgetter(*names) if len(names) > 1 else lambda record: (getattr(record, names[0]),)
    fields = msgspec.defstruct(cls.__name__, columns)
    return Layout(names, values, records, record_dicts, fields)


def _is_record(kind: object) -> bool:
    return isinstance(kind, type) and issubclass(kind, Record)


# Class and field values of each record, by key.
Taken = dict[str, tuple[Any, tuple[Any, ...]]]


def take(record: Record, key: str = "") -> Taken:
    """Return the field values of a record and of all nested records; the records may change afterwards."""
    taken: Taken = {}
    _take(record, key, taken)
    return taken


def _take(record: Record, key: str, taken: Taken) -> None:
    cls: Any = type(record)
    layout = layout_of(cls)
    taken[key] = cls, layout.values(record)
    for name in layout.one:
        _take(getattr(record, name), _path(key, name), taken)
    for name in layout.many:
        for number, item in getattr(record, name).items():
            _take(item, f"{_path(key, name)}/{number}", taken)


def _path(key: str, name: str) -> str:
    return f"{key}/{name}" if key else name


class Encoder:
    """Encodes successive states of one scene: a record with unchanged fields yields the same part object.

    It may run in another thread than `take`.
    """

    def __init__(self) -> None:
        self._last: dict[str, tuple[tuple[Any, ...], Part]] = {}

    def parts(self, taken: Taken, rest: Callable[[], None] = lambda: None) -> dict[str, Part]:
        """Return the parts of a taken state, by key; `rest` is called repeatedly in between."""
        last, self._last = self._last, {}
        for key, (cls, values) in taken.items():
            before = last.get(key)
            if before is not None and all(a is b for a, b in zip(before[0], values, strict=True)):
                self._last[key] = before
            else:
                self._last[key] = values, _encoded(cls, values)
            rest()
        return {key: part for key, (_, part) in self._last.items()}


def _encoded(cls: Any, values: tuple[Any, ...]) -> Part:
    layout = layout_of(cls)
    arrays: dict[str, tuple[str, AnyArray]] = {}
    fields: dict[str, msgspec.Raw] = {}

    def plain(value: object) -> object:
        if isinstance(value, np.generic):
            return value.item()
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{cls.__name__}.{name} cannot be saved: it holds a {type(value).__name__}")
        if value.dtype.kind not in "biuf" or min(value.strides, default=1) < 0:
            raise TypeError(f"{cls.__name__}.{name} cannot be saved: it is an array of {value.dtype}")
        if value.nbytes <= LARGE_ARRAY_BYTES:
            return form_of(value), value.tobytes()
        place = name if name not in arrays else f"{name} {len(arrays)}"
        arrays[place] = form_of(value), value
        return place

    for name, value in zip(layout.names, values, strict=True):
        if name in layout.many:
            fields[name] = msgspec.Raw(msgspec.msgpack.encode(tuple(value)))
        elif name not in layout.one:
            fields[name] = msgspec.Raw(msgspec.msgpack.encode(value, enc_hook=plain))
    return Part(msgspec.msgpack.encode(fields), arrays)


def decode(cls: type[R], parts: Mapping[str, Part], key: str = "") -> R:
    """Return the record that is made of these parts.

    Raises
    ------
    DamagedError
        A part is missing, or does not match the class.
    """
    if key not in parts:
        raise DamagedError(f"the state of the tracker is damaged: '{key}' is missing")
    kind_of_record: Any = cls
    layout, part = layout_of(kind_of_record), parts[key]

    def array(kind: Any, value: Any) -> AnyArray:
        form, content = part.arrays[value] if isinstance(value, str) else value
        found = from_bytes(form, content) if isinstance(content, bytes) else from_form(form, content)
        (expected,) = get_args(get_args(kind)[1])
        if found.dtype != np.dtype(expected):
            raise ValueError(f"an array of {found.dtype}, expected {np.dtype(expected)}")
        return found

    try:
        row = msgspec.msgpack.decode(part.fields, type=layout.row, dec_hook=array)
    except (msgspec.DecodeError, KeyError) as error:
        raise DamagedError(f"the state of the tracker is damaged: '{key}': {error}") from None
    values = {name: getattr(row, name) for name in layout.names if name not in layout.one}
    values |= {name: decode(kind, parts, _path(key, name)) for name, kind in layout.one.items()}
    for name, kind in layout.many.items():
        values[name] = {number: decode(kind, parts, f"{_path(key, name)}/{number}") for number in values[name]}
    return cls(**values)
