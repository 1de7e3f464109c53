"""A graph of live objects as plain parts, exactly; `thawing` is the way back.

Every attribute of every object is taken, so that a new one cannot be forgotten; what is of a type that is not known
here is refused.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from operator import attrgetter
from typing import Any

import numpy as np

from cuboid.scene.kinds import ENUMS, KINDS, UNCHANGED, VALUES, AnyArray, Kind, Part, attributes, fields_of
from cuboid.scene.packing import form_of

# An array larger than this, bytes, is a row of its own in the file, and written only when it changes.
LARGE_BYTES = 512


def freeze(root: object) -> dict[str, Part]:
    """Return the parts of all that can be reached from an object, by key; large arrays are copies.

    Raises
    ------
    TypeError
        Something is of a type that cannot be saved: a fault of the program.
    """
    return Freezer().freeze(root)


@dataclass(frozen=True, slots=True)
class Taken:
    """How objects were at one moment: nothing in it changes any more.

    Attributes
    ----------
    parts : dict of str to Part or (Kind, tuple)
        By key; of a kind of which there are many, what the attributes of the object hold.
    """

    parts: dict[str, Part | tuple[Kind, tuple[Any, ...]]]


class Freezer:
    """Freezes the same objects again and again: of those of which there are many, only what changed.

    An object that is as it was last time is the same part.
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[str, Any]] = deque()
        self._keys: dict[int, str] = {}
        self._copied = True
        # Of objects of a kind of which there are many, by key: what each held last time, and its part.
        self._last: dict[str, tuple[tuple[Any, ...], Part]] = {}
        # Of objects of a kind that has stamps, by key: the last one, and the part.
        self._stamped: dict[str, tuple[object, Part]] = {}

    def freeze(self, root: object) -> dict[str, Part]:
        """Return the parts of all that can be reached from an object, by key; large arrays are copies.

        Raises
        ------
        TypeError
            Something is of a type that cannot be saved: a fault of the program.
        """
        return self.parts(self.take(root))

    def take(self, root: object) -> Taken:
        """Take how all that can be reached from an object is now; the live objects may change as soon as this returns.

        Raises
        ------
        TypeError
            Something is of a type that cannot be saved: a fault of the program.
        """
        self._keys = {}
        self._refer(root)
        parts: dict[str, Part | tuple[Kind, tuple[Any, ...]]] = {}
        stamped, self._stamped = self._stamped, {}
        while self._waiting:
            key, item = self._waiting.popleft()
            if key in parts:
                raise TypeError(f"two objects have the key {key}")
            kind = KINDS[type(item)]
            if kind.many:
                held = self._held(kind, item)
                parts[key] = kind, held
                continue
            stamp, last = kind.stamp and kind.stamp(item), stamped.get(key)
            if last is not None and last[0] == stamp:
                self._held(kind, item)
                part = last[1]
            else:
                part = self._part(kind, [getattr(item, name) for name in attributes(item)], attributes(item))
            if kind.stamp is not None:
                self._stamped[key] = stamp, part
            parts[key] = part
        return Taken(parts)

    def _held(self, kind: Kind, item: Any) -> tuple[Any, ...]:
        """Return what the attributes of an object hold; those among it that are parts of their own are taken too."""
        held = _getter(kind.cls)(item)
        for value in held:
            if type(value) in KINDS:
                self._refer(value)
        return held

    def parts(self, taken: Taken, rest: Callable[[], None] = lambda: None) -> dict[str, Part]:
        """Return the parts of what was taken last, by key; may be done in another thread.

        Parameters
        ----------
        taken : Taken
        rest : callable
            Called now and then.

        Raises
        ------
        TypeError
            Something is of a type that cannot be saved: a fault of the program.
        """
        parts: dict[str, Part] = {}
        last, self._last = self._last, {}
        for key, item in taken.parts.items():
            if isinstance(item, Part):
                parts[key] = item
                continue
            kind, held = item
            before = last.get(key)
            same = before is not None and all(a is b for a, b in zip(before[0], held, strict=True))
            parts[key] = before[1] if before and same else self._part(kind, held, fields_of(kind.cls))
            self._last[key] = held, parts[key]
            rest()
        return parts

    def _part(self, kind: Kind, values: Sequence[Any], names: Sequence[str]) -> Part:
        part = Part(kind.cls.__name__, {})
        self._copied = not kind.many
        for name, value in zip(names, values, strict=True):
            if name not in kind.excluded:
                part.fields[name] = self._plain(value, name, part)
        return part

    def _refer(self, item: Any) -> str:
        known = self._keys.get(id(item))
        if known is None:
            kind = KINDS[type(item)]
            known = self._keys[id(item)] = f"{kind.cls.__name__} {kind.key(item)}".strip()
            self._waiting.append((known, item))
        return known

    def _plain(self, value: Any, path: str, part: Part) -> Any:
        kind = type(value)
        if value is None or kind in (bool, int, float, str):
            return value
        if kind is np.ndarray:
            return self._array(value, path, part)
        if kind in (list, tuple, deque):
            return [kind.__name__, *(self._plain(item, f"{path}.{k}", part) for k, item in enumerate(value))]
        if kind is set:
            items = [self._plain(item, path, part) for item in value]
            return ["set", *sorted(items, key=None if all(type(item) is int for item in items) else str)]
        if kind is dict:
            flat: list[Any] = ["dict"]
            for name, item in value.items():
                flat += [self._plain(name, path, part), self._plain(item, f"{path}.{name}", part)]
            return flat
        if kind in KINDS:
            return ["part", self._refer(value)]
        if kind in VALUES:
            copied, self._copied = self._copied, self._copied and kind not in UNCHANGED
            own = {name: self._plain(getattr(value, name), f"{path}.{name}", part) for name in attributes(value)}
            self._copied = copied
            return ["value", kind.__name__, own]
        if isinstance(value, Enum) and kind.__name__ in ENUMS:
            return ["enum", kind.__name__, value.name]
        if isinstance(value, (np.float64, np.integer, np.bool_)):
            return value.item()
        raise TypeError(f"{part.kind}.{path} cannot be saved: it is a {kind.__name__}")

    def _array(self, array: AnyArray, path: str, part: Part) -> list[Any]:
        if array.dtype.kind not in "biuf" or min(array.strides, default=1) < 0:
            raise TypeError(f"{part.kind}.{path} cannot be saved: it is an array of {array.dtype}")
        if array.nbytes <= LARGE_BYTES:
            return ["array", form_of(array), array.tobytes()]
        part.arrays[path] = form_of(array), array.copy() if self._copied else array
        return ["large", path]


@cache
def _getter(cls: Any) -> attrgetter[tuple[Any, ...]]:
    """Return what gets all attributes of an object at once."""
    return attrgetter(*fields_of(cls))
