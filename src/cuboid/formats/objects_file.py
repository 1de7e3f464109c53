"""`objects.json`: the map of objects at the end of a run."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from cuboid.formats.values import (
    Count,
    Direction,
    Entry,
    FocalLength,
    Fraction,
    FrameNumber,
    ImageSide,
    Label,
    Level,
    Metres,
    Pixel,
    Point,
    Rotation,
    Sides,
    refuse_no_rotation,
    refuse_no_unit,
    refuse_twice,
)

FORMAT: Literal["cuboid-objects"] = "cuboid-objects"
VERSION: Literal[1] = 1


class IntrinsicsEntry(Entry, frozen=True):
    """A pinhole; the centre of the top-left pixel is (0, 0)."""

    fx: FocalLength
    fy: FocalLength
    cx: Pixel
    cy: Pixel
    width: ImageSide
    height: ImageSide


class PlaneEntry(Entry, frozen=True):
    """A supporting plane: normal . p + offset = 0 in the world."""

    normal: Annotated[Direction, Meta(description="unit vector, up")]
    offset: Metres
    extent: Annotated[list[Point], Meta(description="outline of what was seen of it, metres")]

    def __post_init__(self) -> None:
        refuse_no_unit("normal", self.normal)


class ObjectEntry(Entry, frozen=True):
    """An object of the map."""

    label: Label
    center: Annotated[Point, Meta(description="of its box in the world, metres")]
    size: Annotated[Sides, Meta(description="length, width, height along the box's axes, metres")]
    rotation: Annotated[Rotation, Meta(description="rows of a matrix whose columns are the box's axes in the world")]
    score: Annotated[Fraction, Meta(description="confidence that it is an object")]
    heat: Annotated[Fraction, Meta(description="mean heat of its points")]
    first_frame: FrameNumber
    last_frame: FrameNumber
    frames_seen: Count
    points: Annotated[Count, Meta(description="voxels of the map that belong to it")]
    mean_color: Annotated[tuple[Level, Level, Level], Meta(description="red, green, blue, 0 to 255")]
    plane: Annotated[Count | None, Meta(description="index into planes: what it stands on")]
    merged_labels: Annotated[list[Label], Meta(description="younger labels that turned out to be this object")]
    name: Annotated[str, Meta(description="a user's, else its class by a detector; absent where it has none")] = ""
    name_score: Annotated[Fraction | None, Meta(description="probability of the class; absent with a user's name")] = (
        None
    )
    names: Annotated[
        list[tuple[str, Fraction]], Meta(description="the next likely classes, at most 3, with their probabilities")
    ] = []  # noqa: RUF012  # msgspec copies it

    kind: Annotated[
        Literal["volume", "flat", "box", "support"],
        Meta(description="of what depth does not read, flat on a plane or a box; absent for volumes"),
    ] = "volume"

    def __post_init__(self) -> None:
        refuse_no_rotation(self.rotation)
        if self.first_frame > self.last_frame:
            raise ValueError(f"first_frame {self.first_frame} comes after last_frame {self.last_frame}")


class ObjectsDocument(Entry, frozen=True):
    """The map of objects at the end of a run: `objects.json`."""

    format: Literal["cuboid-objects"]
    version: Literal[1]
    up: Annotated[Direction | None, Meta(description="up in the world; null where it is unknown")]
    intrinsics: Annotated[IntrinsicsEntry, Meta(description="of the recording's color image at its full size")]
    planes: list[PlaneEntry]
    objects: list[ObjectEntry]

    def __post_init__(self) -> None:
        if self.up is not None:
            refuse_no_unit("up", self.up)
        refuse_twice("label", [item.label for item in self.objects])
        for item in self.objects:
            if item.plane is not None and item.plane >= len(self.planes):
                raise ValueError(f"object {item.label} stands on plane {item.plane} of {len(self.planes)} planes")
