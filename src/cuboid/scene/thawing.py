"""Live objects out of the parts that `freezing` made of them.

An attribute that a file does not have, since it was written by an earlier version, is what it is in a fresh object.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np

from cuboid.errors import InputError
from cuboid.posing import EstimatedPoses
from cuboid.scene.kinds import ENUMS, KINDS, VALUES, Part, attributes, fields_of
from cuboid.scene.localisation import ScenePoses
from cuboid.scene.packing import from_bytes, from_form
from cuboid.surfaces.grid import GroundPlan
from cuboid.tracker import Tracker

_UNKNOWN = object()
_BY_NAME = {kind.cls.__name__: kind for kind in KINDS.values()}
_VALUE_BY_NAME = {cls.__name__: cls for cls in VALUES}


def roots(fresh: Tracker) -> tuple[Tracker, ScenePoses, EstimatedPoses]:
    """Return new ones of all that a scene's state may hold, beginning with a tracker."""
    return fresh, ScenePoses(fresh.intrinsics, fresh.config), EstimatedPoses(fresh.intrinsics, 0.0)


def thaw(parts: Mapping[str, Part], *fresh: object) -> tuple[Any, ...]:
    """Return what was frozen, as live objects.

    Parameters
    ----------
    parts : mapping of str to Part
    *fresh : object
        A new one for each root: what the parts do not tell is as in it.

    Returns
    -------
    tuple
        The roots; None for one that was not frozen.

    Raises
    ------
    InputError
        The parts are not those of this version, nor of an earlier one.
    """
    return _Thawer(parts, fresh).thaw()


class _Thawer:
    def __init__(self, parts: Mapping[str, Part], roots: Sequence[object]) -> None:
        self._parts = parts
        self._roots = [type(root).__name__ for root in roots]
        self._live: dict[str, Any] = {}
        self._fresh: dict[str, Any] = {"GroundPlan": GroundPlan()}
        self._begun: dict[type, dict[str, Any]] = {}
        for root in roots:
            self._collect(root)

    def _collect(self, item: Any) -> None:
        name = type(item).__name__
        if type(item) in KINDS and name not in self._fresh and not dataclasses.is_dataclass(item):
            self._fresh[name] = item
            for attribute in attributes(item):
                self._collect(getattr(item, attribute))

    def thaw(self) -> tuple[Any, ...]:
        for key, part in self._parts.items():
            kind = _BY_NAME.get(part.kind)
            if kind is None:
                raise _strange(key)
            self._live[key] = _blank(kind.cls)
        for key, part in self._parts.items():
            self._fill(self._live[key], part.fields, part)
        found = tuple(self._live.get(root) for root in self._roots)
        for root, item in zip(self._roots, found, strict=True):
            if item is not None and type(item).__name__ != root:
                raise _strange(root)
        return found

    def _fill(self, item: Any, fields: Mapping[str, Any], part: Part) -> None:
        cls: Any = type(item)
        data = bool(fields_of(cls))
        for name, beginning in self._beginnings(cls).items():
            if name in fields:
                value = self._live_value(fields[name], part)
                if data and _other_shape(beginning, value):
                    raise _strange(f"{type(item).__name__}.{name}")
            elif beginning is _UNKNOWN:
                raise _strange(f"{type(item).__name__}.{name}")
            else:
                apart = type(item) in KINDS and name in KINDS[type(item)].excluded
                value = beginning if apart else deepcopy(beginning)
            object.__setattr__(item, name, value)

    def _beginnings(self, cls: type) -> dict[str, Any]:
        """Return what each attribute of a class begins as."""
        if cls not in self._begun:
            self._begun[cls] = self._begin(cls)
        return self._begun[cls]

    def _begin(self, cls: type) -> dict[str, Any]:
        if not dataclasses.is_dataclass(cls):
            if cls.__name__ not in self._fresh:
                raise _strange(cls.__name__)
            fresh = self._fresh[cls.__name__]
            return {name: getattr(fresh, name) for name in attributes(fresh)}
        found: dict[str, Any] = {}
        for one in dataclasses.fields(cls):
            made = one.default_factory() if one.default_factory is not dataclasses.MISSING else one.default
            found[one.name] = _UNKNOWN if made is dataclasses.MISSING else made
        return found

    def _live_value(self, value: Any, part: Part) -> Any:
        if not isinstance(value, list):
            return value
        tag, rest = value[0], value[1:]
        try:
            if tag == "array":
                return from_bytes(rest[0], rest[1])
            if tag == "large":
                form, plain = part.arrays[rest[0]]
                return from_form(form, plain)
            if tag == "part":
                return self._live[rest[0]]
            if tag == "enum":
                return ENUMS[rest[0]][rest[1]]
            if tag == "value":
                cls = _VALUE_BY_NAME[rest[0]]
                item = _blank(cls)
                self._fill(item, rest[1], part)
                return item
            items = [self._live_value(one, part) for one in rest]
            if tag == "dict":
                return dict(zip(items[::2], items[1::2], strict=True))
            return {"list": list, "tuple": tuple, "set": set, "deque": deque}[tag](items)
        except (KeyError, ValueError, TypeError, IndexError):
            raise _strange(part.kind) from None


def _other_shape(beginning: Any, value: Any) -> bool:
    """Tell whether an array of a fixed shape has had another one."""
    both = isinstance(beginning, np.ndarray) and isinstance(value, np.ndarray)
    return both and beginning.size > 0 and beginning.shape != value.shape


def _blank(cls: type) -> Any:
    """Return an object of a class without attributes."""
    return object.__new__(cls)


def _strange(what: str) -> InputError:
    return InputError(f"what the tracker needs to go on was written by another version of Cuboid ({what})")
