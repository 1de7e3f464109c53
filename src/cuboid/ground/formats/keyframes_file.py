"""Keyframes: rectangles with identities that a person drew into some frames of a recording."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from typing import Annotated, Literal

from msgspec import Meta

from cuboid.ground.core.values import Entry, Fraction, FrameNumber, Label, Name, Pixel, refuse_twice

FORMAT: Literal["cuboid-keyframes"] = "cuboid-keyframes"
VERSION: Literal[1] = 1

Rect = Annotated[tuple[Pixel, Pixel, Pixel, Pixel], Meta(description="x0, y0, x1, y1, ends exclusive")]
Number = Annotated[int, Meta(ge=0, le=2**63 - 1)] | Annotated[float, Meta(ge=0.0, le=1e15)] | Name


class DrawnObjectEntry(Entry, frozen=True):
    """An object that a person has drawn."""

    id: Annotated[Label, Meta(description="identity of the object")]
    name: Annotated[Name | None, Meta(description="name of the object")] = None
    group: Annotated[bool, Meta(description="true for several objects that may also count as one")] = False


class DrawnEntry(Entry, frozen=True):
    """The rectangle of an object in a frame."""

    id: Annotated[Label, Meta(description="identity of the object")]
    rect: Rect
    visible: Annotated[Fraction, Meta(description="visible fraction of the object")] = 1.0
    group: bool = False

    def __post_init__(self) -> None:
        refuse_no_rect(self.rect)


class KeyframeEntry(Entry, frozen=True):
    """A frame with rectangles."""

    frame: FrameNumber
    boxes: list[DrawnEntry]
    ignore: Annotated[list[Rect] | None, Meta(description="rectangles in which results are not judged")] = None
    number: Annotated[Number | None, Meta(description="the number in the name of the frame's file")] = None

    def __post_init__(self) -> None:
        refuse_twice("id", [item.id for item in self.boxes])
        for rect in self.ignore or ():
            refuse_no_rect(rect)
        try:
            finite = self.number is None or Decimal(str(self.number)).is_finite()
        except InvalidOperation:
            finite = False
        if not finite:
            raise ValueError("number must be a number")


class KeyframesDocument(Entry, frozen=True):
    """Rectangles that a person has drawn: `keyframes.json`."""

    format: Literal["cuboid-keyframes"]
    version: Literal[1]
    objects: list[DrawnObjectEntry]
    frames: list[KeyframeEntry]
    name: Annotated[Name | None, Meta(description="name of the truth; default: the name of the file")] = None

    def __post_init__(self) -> None:
        refuse_twice("object id", [item.id for item in self.objects])
        refuse_twice("frame", [item.frame for item in self.frames])


def refuse_no_rect(rect: tuple[float, float, float, float]) -> None:
    """Raise ValueError unless a rectangle has an area."""
    if not (rect[0] < rect[2] and rect[1] < rect[3]):
        raise ValueError(f"expected a rectangle [x0, y0, x1, y1] with x0 < x1 and y0 < y1, got {list(rect)}")
