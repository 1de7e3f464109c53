"""The value types of all formats, each with its range; and checks that need several values together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, TypeAlias

import msgspec
import numpy as np
from msgspec import Meta

from cuboid.ground.geometry.se3 import MAX_FROM_ORIGIN_M

# The largest frame number of a recording: 38 days at 30 frames a second.
LAST_FRAME = 100_000_000
# The largest label and number of points that `map.ply` can store.
LAST_NUMBER = 2**31 - 1
# Latest timestamp, seconds since 1970: the year 33658; rounded to a microsecond it fits in 64 bits.
LATEST_S = 1e12
LARGEST_IMAGE_PX = 100_000

# Allowed deviation of a unit vector, or of a rotation matrix, written with four digits.
UNIT_TOLERANCE = 1e-3
# Allowed deviation of a quaternion's length from 1: files with 4 digits deviate by 1e-4. Beyond it the four
# numbers are probably not a quaternion, or the columns are in another order and include a translation.
QUATERNION_TOLERANCE = 0.01

Metres: TypeAlias = Annotated[float, Meta(ge=-MAX_FROM_ORIGIN_M, le=MAX_FROM_ORIGIN_M, description="metres")]
Side: TypeAlias = Annotated[float, Meta(ge=0.0, le=MAX_FROM_ORIGIN_M, description="metres")]
Cosine: TypeAlias = Annotated[float, Meta(ge=-1.0 - UNIT_TOLERANCE, le=1.0 + UNIT_TOLERANCE)]
QuaternionPart: TypeAlias = Annotated[float, Meta(ge=-1.0 - QUATERNION_TOLERANCE, le=1.0 + QUATERNION_TOLERANCE)]
Fraction: TypeAlias = Annotated[float, Meta(ge=0.0, le=1.0, description="0 to 1")]
Seconds: TypeAlias = Annotated[float, Meta(ge=-LATEST_S, le=LATEST_S, description="seconds")]
Amount: TypeAlias = Annotated[float, Meta(ge=0.0, le=1e15)]
Pixel: TypeAlias = Annotated[float, Meta(ge=-1e7, le=1e7, description="pixels")]
FocalLength: TypeAlias = Annotated[float, Meta(ge=1e-3, le=1e7, description="pixels")]
Level: TypeAlias = Annotated[float, Meta(ge=0.0, le=255.0, description="0 to 255")]
FrameNumber: TypeAlias = Annotated[int, Meta(ge=0, le=LAST_FRAME, description="counts from 0")]
Count: TypeAlias = Annotated[int, Meta(ge=0, le=LAST_NUMBER)]
Label: TypeAlias = Annotated[int, Meta(ge=1, le=LAST_NUMBER, description="1 or more")]
LabelOrNone: TypeAlias = Annotated[int, Meta(ge=0, le=LAST_NUMBER, description="0: none")]
ImageSide: TypeAlias = Annotated[int, Meta(ge=1, le=LARGEST_IMAGE_PX, description="pixels")]
ObjectKind: TypeAlias = Literal["volume", "flat", "box", "support"]
EventName: TypeAlias = Literal["appeared", "moved", "gone", "back"]
# Status of an object at the end of a recording; its change since the visit before; what later frames show of it.
ObjectStatus: TypeAlias = Literal["present", "unlikely", "gone", "merged", "forgotten"]
VisitChange: TypeAlias = Literal["unchanged", "moved", "gone", "new", "found", "not looked at"]
LaterStatus: TypeAlias = Literal["there", "gone", "not looked at", "not seen"]
RelationKind: TypeAlias = Literal["on", "in", "beside", "under", "against", "supports"]
SideName: TypeAlias = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
Surface: TypeAlias = Annotated[str, Meta(pattern=r"^(plane|wall):\d{1,9}$", max_length=20)]
Text: TypeAlias = Annotated[str, Meta(max_length=1000)]
Name: TypeAlias = Annotated[str, Meta(max_length=200)]

Point: TypeAlias = tuple[Metres, Metres, Metres]
Sides: TypeAlias = tuple[Side, Side, Side]
Direction: TypeAlias = tuple[Cosine, Cosine, Cosine]
Rotation: TypeAlias = tuple[Direction, Direction, Direction]


class Entry(msgspec.Struct, frozen=True):
    """A part of a JSON document; fields that are not declared are ignored."""


class PinholeEntry(Entry, frozen=True):
    """A pinhole of a camera."""

    fx: FocalLength
    fy: FocalLength
    cx: Pixel
    cy: Pixel
    width: ImageSide
    height: ImageSide


def refuse_no_unit(name: str, direction: Sequence[float]) -> None:
    """Raise ValueError unless a direction has length 1."""
    length = float(np.linalg.norm(direction))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise ValueError(f"{name} has length {length:.4g}, expected 1")


def refuse_no_rotation(rotation: Rotation) -> None:
    """Raise ValueError unless three rows form a rotation matrix."""
    R = np.array(rotation)
    if np.abs(R @ R.T - np.eye(3)).max() > UNIT_TOLERANCE or np.linalg.det(R) < 0:
        raise ValueError(f"expected a rotation matrix, got {R.tolist()}")


def refuse_no_quaternion(*parts: float) -> None:
    """Raise ValueError unless four numbers form a unit quaternion."""
    length = float(np.linalg.norm(parts))
    if not abs(length - 1.0) <= QUATERNION_TOLERANCE:
        raise ValueError(f"the quaternion has length {length:.3g}, expected 1")


def refuse_twice(name: str, values: Sequence[int]) -> None:
    """Raise ValueError if a value occurs twice."""
    seen: set[int] = set()
    for value in values:
        if value in seen:
            raise ValueError(f"{name} {value} is there twice")
        seen.add(value)
