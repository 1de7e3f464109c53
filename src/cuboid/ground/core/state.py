"""The state that a scene file keeps of a class: named, typed fields, declared beside the class.

A state is a `Record`: a dataclass of plain values, enums, arrays, containers and dataclasses of these, and records.
A class that does more than hold data has a separate state: `state()` returns it and `from_state()` restores the class.

- Each attribute is a field of the state under the same name, without a leading underscore, or is listed in `NOT_SAVED`:
  then it follows from the other fields, or is passed to `from_state()`. A test checks this for every class.
- The values in a state are never changed afterwards: `state()` copies arrays that the class writes to.
"""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from typing import Any, TypeVar

import numpy as np

R = TypeVar("R", bound="Record")

# Metadata of a record field that is not saved because it follows from the others; the field needs a default.
TRANSIENT = {"transient": True}


class Record:
    """Base of the dataclasses that are stored as separate rows in a scene file."""

    __slots__ = ()


class WatchedRecord(Record):
    """A record that seldom changes: all its snapshots are the same object until an attribute is assigned.

    Code that changes an array in place must also assign an attribute, or call `note_change`.
    """

    __slots__ = ("_snapshot",)

    _snapshot: Any

    def __setattr__(self, name: str, value: object) -> None:
        object.__setattr__(self, "_snapshot", None)
        object.__setattr__(self, name, value)

    def note_change(self) -> None:
        """Note that an array was changed in place."""
        object.__setattr__(self, "_snapshot", None)


@cache
def saved_fields(cls: Any) -> tuple[str, ...]:
    """Return the names of the fields of a record that are saved, in order."""
    return tuple(item.name for item in fields(cls) if not item.metadata.get("transient"))


def snapshot(record: R) -> R:
    """Return a copy of a record that later changes do not affect: arrays and nested records are copied."""
    cls: Any = type(record)
    last: Any = record._snapshot if isinstance(record, WatchedRecord) else None
    values: dict[str, Any] = {}
    for name in saved_fields(cls):
        value = getattr(record, name)
        if isinstance(value, Record):
            values[name] = snapshot(value)
        elif last is not None:
            values[name] = getattr(last, name)
        else:
            values[name] = value.copy() if type(value) is np.ndarray else value
    if last is not None and all(value is getattr(last, name) for name, value in values.items()):
        same: R = last
        return same
    taken: R = cls(**values)
    if isinstance(record, WatchedRecord):
        object.__setattr__(record, "_snapshot", taken)
    return taken
