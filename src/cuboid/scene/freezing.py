"""A graph of live objects as plain parts, and back, exactly.

Every attribute of every object is taken, so that a new one cannot be forgotten; what is of a type that is not known
here is refused. An attribute that a file does not have, since it was written by an earlier version, is what it is in
a fresh object.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from operator import attrgetter
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.config import TrackerConfig
from cuboid.errors import InputError
from cuboid.frame import Intrinsics
from cuboid.geometry.box import Box
from cuboid.heatmap.anchors import Anchor, Anchors
from cuboid.heatmap.row_blocks import RowBlocks
from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.objects.affinity import Affinity
from cuboid.objects.boxing import Boxing
from cuboid.objects.entry import MapObject, State
from cuboid.objects.object_map import ObjectMap
from cuboid.objects.store import ObjectStore
from cuboid.poses.alignment import Points, Reference
from cuboid.poses.atlas import Atlas
from cuboid.poses.estimator import PoseEstimator
from cuboid.poses.graph import Edge
from cuboid.poses.keyframes import Keyframe
from cuboid.poses.places import Appearance
from cuboid.poses.pyramid import SmallImage
from cuboid.posing import EstimatedPoses
from cuboid.scene.packing import form_of, from_bytes, from_form
from cuboid.scene.placing import ScenePoses
from cuboid.surfaces.grid import GroundPlan
from cuboid.surfaces.plane import Plane
from cuboid.surfaces.planes import PlaneTracker
from cuboid.surfaces.up import UpVote
from cuboid.surfaces.windows import Windows
from cuboid.tracker import Tracker

AnyArray = npt.NDArray[Any]

_UNKNOWN = object()
# An array larger than this, bytes, is a row of its own in the file, and written only when it changes.
LARGE_BYTES = 512


@dataclass(frozen=True, slots=True)
class Kind:
    """A class whose objects are parts.

    Attributes
    ----------
    cls : type
    key : callable
        Returns what tells an object from others of its class; none where there is only one.
    kept_apart : frozenset of str
        Attributes that are saved elsewhere, are given anew, or follow from others.
    many : bool
        There may be many, of which few change. What their attributes hold is only replaced, never changed: those that
        hold the same things as before are as they were, and nothing of them needs a copy.
    """

    cls: type
    key: Callable[[Any], object] = lambda item: ""
    kept_apart: frozenset[str] = frozenset()
    many: bool = False


# Rows of the map are saved in blocks: see `saving`.
_ROWS = frozenset(
    {"memory_mb", "_room", "_shelf", "_points", "_cubes", "_seen", "_marks", "_last_look", "_ready", "before_visit"}
)

KINDS = {
    kind.cls: kind
    for kind in (
        Kind(Tracker, kept_apart=frozenset({"intrinsics", "_propose", "_memory_mb"})),
        Kind(PlaneTracker),
        Kind(UpVote),
        Kind(Windows),
        Kind(Plane, key=lambda plane: plane.identity),
        Kind(VoxelMap, kept_apart=_ROWS),
        Kind(RowBlocks),
        Kind(Anchors, kept_apart=frozenset({"owes", "motions", "_keyframes", "_of", "_pairs"})),
        Kind(Anchor, key=lambda anchor: anchor.number, many=True),
        Kind(ObjectMap),
        Kind(Boxing),
        Kind(ObjectStore, kept_apart=frozenset({"_bounds"})),
        Kind(Affinity),
        Kind(MapObject, key=lambda entry: entry.number, many=True),
        Kind(ScenePoses, kept_apart=frozenset({"intrinsics"})),
        Kind(EstimatedPoses),  # of files from before there were parts
        Kind(PoseEstimator, kept_apart=frozenset({"intrinsics"})),
        Kind(Atlas),
        Kind(Keyframe, key=lambda keyframe: keyframe.number, kept_apart=frozenset({"_reference"})),
    )
}
_BY_NAME = {kind.cls.__name__: kind for kind in KINDS.values()}

# Values: they lie within the part that has them.
VALUES: tuple[type, ...] = (
    Box, TrackerConfig, Intrinsics, GroundPlan, SmallImage, Points, Reference, Appearance, Edge,
)  # fmt: skip
# Of these, also the arrays are never changed.
UNCHANGED = frozenset({SmallImage, Points, Reference, Appearance, Edge})
_VALUE_BY_NAME = {cls.__name__: cls for cls in VALUES}
ENUMS = {"State": State}


@dataclass(frozen=True, slots=True)
class Part:
    """An object as it is saved.

    Attributes
    ----------
    kind : str
        Its class.
    fields : dict of str to values
        None, truth values, numbers, texts; a list is any other thing: its first item says what.
    arrays : dict of str to (str, array)
        The large ones, by their path in the fields, each with its form. One that is the same object as before has not
        changed.
    """

    kind: str
    fields: dict[str, Any]
    arrays: dict[str, tuple[str, AnyArray]] = field(default_factory=dict)


def attributes(item: object) -> Sequence[str]:
    """Return the names of all attributes that an object has, in order."""
    cls: Any = type(item)
    return _fields(cls) or list(vars(item))


@cache
def _fields(cls: Any) -> tuple[str, ...]:
    return tuple(one.name for one in dataclasses.fields(cls)) if dataclasses.is_dataclass(cls) else ()


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
        while self._waiting:
            key, item = self._waiting.popleft()
            if key in parts:
                raise TypeError(f"two objects have the key {key}")
            kind = KINDS[type(item)]
            if kind.many:
                held = _getter(kind.cls)(item)
                for value in held:
                    if type(value) in KINDS:
                        self._refer(value)
                parts[key] = kind, held
            else:
                parts[key] = self._part(kind, [getattr(item, name) for name in attributes(item)], attributes(item))
        return Taken(parts)

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
            parts[key] = before[1] if before and same else self._part(kind, held, _fields(kind.cls))
            self._last[key] = held, parts[key]
            rest()
        return parts

    def _part(self, kind: Kind, values: Sequence[Any], names: Sequence[str]) -> Part:
        part = Part(kind.cls.__name__, {})
        self._copied = not kind.many
        for name, value in zip(names, values, strict=True):
            if name not in kind.kept_apart:
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
        if kind in _VALUE_BY_NAME.values():
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
    return attrgetter(*_fields(cls))


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
        data = bool(_fields(cls))
        for name, beginning in self._beginnings(cls).items():
            if name in fields:
                value = self._live_value(fields[name], part)
                if data and _other_shape(beginning, value):
                    raise _strange(f"{type(item).__name__}.{name}")
            elif beginning is _UNKNOWN:
                raise _strange(f"{type(item).__name__}.{name}")
            else:
                apart = type(item) in KINDS and name in KINDS[type(item)].kept_apart
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
