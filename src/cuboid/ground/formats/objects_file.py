"""`objects.json`: the map of objects at the end of a run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType

from cuboid.ground.core.records import columns_of
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.core.values import (
    Direction,
    Entry,
    Label,
    Metres,
    Name,
    PinholeEntry,
    Point,
    Rotation,
    Sides,
    refuse_no_rotation,
    refuse_no_unit,
    refuse_twice,
)
from cuboid.ground.formats.relations import WallEntry, refuse_unknown

FORMAT: Literal["cuboid-objects"] = "cuboid-objects"
VERSION: Literal[1] = 1


class IntrinsicsEntry(PinholeEntry, frozen=True):
    """A pinhole; the centre of the top-left pixel is (0, 0)."""


class PlaneEntry(Entry, frozen=True):
    """A supporting plane: normal . p + offset = 0 in the world."""

    normal: Annotated[Direction, Meta(description="unit vector, up")]
    offset: Metres
    extent: Annotated[list[Point], Meta(description="outline of the seen part, metres")]

    def __post_init__(self) -> None:
        refuse_no_unit("normal", self.normal)


def _fields() -> Iterator[tuple[str, Any] | tuple[str, Any, UnsetType]]:
    """Iterate over the fields of an object: those of `TrackedObject`, and those of its box after the label."""
    label, *others = (
        (one.name, Annotated[one.plain_kind, Meta(description=one.meaning)], one) for one in columns_of(TrackedObject)
    )
    yield label[:2]
    yield "center", Annotated[Point, Meta(description="centre of its box in the world, metres")]
    yield "size", Annotated[Sides, Meta(description="length, width and height along the axes of the box, metres")]
    yield (
        "rotation",
        Annotated[
            Rotation, Meta(description="rotation matrix by rows; its columns are the axes of the box in the world")
        ],
    )
    for name, kind, one in sorted(others, key=lambda item: item[2].optional):
        yield (name, kind | UnsetType, UNSET) if one.optional else (name, kind)


_Fields: Any = msgspec.defstruct("_Fields", _fields(), bases=(Entry,), frozen=True)


class ObjectEntry(_Fields, frozen=True):  # type: ignore[misc, call-arg]
    """An object of the map."""

    def __post_init__(self) -> None:
        refuse_no_rotation(self.rotation)
        if self.first_frame > self.last_frame:
            raise ValueError(f"first_frame {self.first_frame} comes after last_frame {self.last_frame}")


class GoneEntry(Entry, frozen=True):
    """The name of an object that is gone, which the map no longer has."""

    label: Label
    name: Name

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError("expected a name that is not empty")


class ObjectsDocument(Entry, frozen=True):
    """The map of objects at the end of a run: `objects.json`."""

    format: Literal["cuboid-objects"]
    version: Literal[1]
    up: Annotated[Direction | None, Meta(description="up in the world; null if unknown")]
    intrinsics: Annotated[IntrinsicsEntry, Meta(description="intrinsics of the recording's color images at full size")]
    planes: list[PlaneEntry]
    objects: list[ObjectEntry]
    walls: Annotated[tuple[WallEntry, ...], Meta(description="walls that objects are against")] = ()
    gone: Annotated[tuple[GoneEntry, ...], Meta(description="names of objects that left before the end")] = ()

    def __post_init__(self) -> None:
        if self.up is not None:
            refuse_no_unit("up", self.up)
        refuse_twice("label", [*(item.label for item in self.objects), *(item.label for item in self.gone)])
        labels = {item.label for item in self.objects}
        for item in self.objects:
            if item.relations is not UNSET:
                named = ((one.to, f"object {item.label}") for one in item.relations)
                refuse_unknown(named, labels, len(self.planes), len(self.walls))
            if item.plane is not None and item.plane >= len(self.planes):
                raise ValueError(f"object {item.label} stands on plane {item.plane} of {len(self.planes)} planes")
            if item.planes is not UNSET and max(item.planes, default=-1) >= len(self.planes):
                raise ValueError(f"furniture {item.label} bears plane {max(item.planes)} of {len(self.planes)} planes")
