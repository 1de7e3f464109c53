"""Relations between objects and surfaces, as results and truths hold them."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Annotated

import msgspec
from msgspec import Meta

from cuboid.ground.core.values import Direction, Entry, Label, Metres, Point, RelationKind, Surface, refuse_no_unit


class WallEntry(Entry, frozen=True):
    """A wall: normal . p + offset = 0 in the world."""

    normal: Annotated[
        Direction, Meta(description="horizontal unit vector, towards the side from which the wall was seen")
    ]
    offset: Metres
    extent: Annotated[
        tuple[Point, Point, Point, Point],
        Meta(description="corners of the upright rectangle around the seen part, metres"),
    ]

    def __post_init__(self) -> None:
        refuse_no_unit("normal", self.normal)


class PlaneOfTruth(Entry, frozen=True):
    """A level surface or a wall: normal . p + offset = 0."""

    normal: Direction
    offset: Metres

    def __post_init__(self) -> None:
        refuse_no_unit("normal", self.normal)


class RelationOfTruth(Entry, frozen=True):
    """A relation that holds, or an open one, which is not judged."""

    subject: Annotated[Label, Meta(description="id of the object")] = msgspec.field(name="from")
    kind: Annotated[RelationKind, Meta(description="kind of the relation of the object to the other one")] = (
        msgspec.field(name="is")
    )
    to: Annotated[Label | Surface, Meta(description="id of the other object, or plane:k, or wall:k, counted from 0")]
    judged: Annotated[bool, Meta(description="false: results for it are not judged")] = True


def refuse_unknown(
    relations: Iterable[tuple[int | str, str]], labels: Collection[int], planes: int, walls: int
) -> None:
    """Raise ValueError where a relation names an object or a surface that does not exist.

    Parameters
    ----------
    relations : iterable of (int or str, str)
        What each is to, and whose it is, for the message.
    labels : collection of int
        The objects that are there.
    planes, walls : int
        How many there are.
    """
    counts = {"plane": planes, "wall": walls}
    for to, whose in relations:
        if isinstance(to, int):
            there = to in labels
        else:
            what, _, number = to.partition(":")
            there = int(number) < counts[what]
        if not there:
            raise ValueError(f"{whose} has a relation to {to}, which is not there")
