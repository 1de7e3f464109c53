"""The state that a scene file keeps of a class: named, typed fields, declared beside the class.

A state is a `Record`: a dataclass of plain values, enums, arrays, containers and dataclasses of these, and of records.
Classes that do more than hold data have a state of their own, `state()` to take it and `from_state()` for the way back:

- Each attribute is a field of the state under the same name, without a leading underscore, or stands in `NOT_SAVED`:
  it follows from the others, or is given to `from_state()`. A test holds every class to that.
- What a field of a state holds is never changed afterwards: `state()` copies what its class writes into.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import cache
from typing import Any, TypeVar

import numpy as np

R = TypeVar("R", bound="Record")

# Metadata of a field of a record that is not saved: it follows from the others; it needs a default.
TRANSIENT = {"transient": True}

# Metadata of a field of a record that states of earlier versions lack: what its factory makes holds there.
ADDED = {"added": True}


class Record:
    """Base of the dataclasses that are rows of their own in a scene file."""

    __slots__ = ()


class WatchedRecord(Record):
    """A record that changes seldom: its snapshots are one and the same object until an attribute is assigned.

    Whatever changes an array in place also assigns to an attribute, or calls `note_change`.
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
    return tuple(one.name for one in fields(cls) if not one.metadata.get("transient"))


@cache
def added_fields(cls: Any) -> dict[str, Callable[[], Any]]:
    """Return the factories of the fields of a record that states of earlier versions lack, by name."""
    found: dict[str, Any] = {one.name: one.default_factory for one in fields(cls) if one.metadata.get("added")}
    return found


def snapshot(record: R) -> R:
    """Return a copy of a record that stays as it is: arrays are copied, and so are records within it."""
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
