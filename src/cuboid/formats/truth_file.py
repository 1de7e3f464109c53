"""Truth files: which objects there are, where they are judged, and which of them each frame shows."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from cuboid.core.values import (
    Count,
    Entry,
    EventName,
    Fraction,
    FrameNumber,
    Label,
    Metres,
    Name,
    Point,
    QuaternionPart,
    Rotation,
    refuse_no_quaternion,
    refuse_no_rotation,
    refuse_twice,
)
from cuboid.formats.relations import PlaneOfTruth, RelationOfTruth, refuse_unknown
from cuboid.formats.run_file import MAX_FRAMES
from cuboid.geometry.se3 import FARTHEST_M

# Frames times objects: what is visible is held as a table of both.
MAX_FRACTIONS = 20_000_000

Run = tuple[Fraction, Count]
FrameCount = Annotated[int, Meta(ge=0, le=MAX_FRAMES)]
Move = tuple[FrameNumber, Metres, Metres, Metres, QuaternionPart, QuaternionPart, QuaternionPart, QuaternionPart]
Moves = Annotated[
    list[Move],
    Meta(description="where its box is from a frame on, until the next one: frame, centre, quaternion (w first)"),
]
PositiveSide = Annotated[float, Meta(gt=0.0, le=FARTHEST_M, description="metres")]


class BoxOfTruth(Entry, frozen=True):
    """A place where finding something counts neither way."""

    center: Point
    size: tuple[PositiveSide, PositiveSide, PositiveSide]
    rotation: Annotated[Rotation, Meta(description="rows of a matrix whose columns are the box's axes in the world")]

    def __post_init__(self) -> None:
        refuse_no_rotation(self.rotation)


class ObjectOfTruth(BoxOfTruth, frozen=True, kw_only=True):
    """An object that is there."""

    id: Annotated[Label, Meta(description="its own")]
    name: Annotated[Name | None, Meta(description="for people")] = None
    judged: Annotated[bool, Meta(description="false where finding it counts neither way")] = True
    round: Annotated[bool, Meta(description="looks alike from all sides of its third axis")] = False
    moves: Moves | None = None

    def __post_init__(self) -> None:
        refuse_no_rotation(self.rotation)
        _refuse_moves(self.moves or [])


class AgentOfTruth(Entry, frozen=True):
    """A rigid part of a person: no object, wherever it is."""

    size: tuple[PositiveSide, PositiveSide, PositiveSide]
    moves: Moves
    name: Annotated[Name | None, Meta(description="for people")] = None

    def __post_init__(self) -> None:
        _refuse_moves(self.moves)


class EventOfTruth(Entry, frozen=True):
    """What happens to an object while the camera runs."""

    event: EventName
    id: Annotated[Label, Meta(description="of the object")]
    begin: Annotated[FrameNumber, Meta(description="frame in which it leaves its place")]
    end: Annotated[FrameNumber, Meta(description="frame in which it is at rest again, or out of the scene")]
    begun_at: Annotated[Point | None, Meta(description="middle of its box before, metres; null: not in the scene")] = (
        msgspec.field(default=None, name="from")
    )
    to: Annotated[Point | None, Meta(description="middle of its box after, metres; null: not in the scene")] = None

    def __post_init__(self) -> None:
        if self.end < self.begin:
            raise ValueError(f"the event ends in frame {self.end}, before it begins in frame {self.begin}")


class RegionOfTruth(Entry, frozen=True):
    """The part of the world that the truth speaks about: a prism over a polygon on a plane."""

    normal: Annotated[Point, Meta(description="of the plane normal . p + offset = 0")]
    offset: Metres
    polygon: Annotated[list[Point], Meta(min_length=3, max_length=10_000, description="corners in order, metres")]
    hmin: Annotated[Metres, Meta(description="from here along the normal")]
    hmax: Metres

    def __post_init__(self) -> None:
        if np.linalg.norm(self.normal) < 1e-6:
            raise ValueError("the normal has no direction")


class VisibilityOfTruth(Entry, frozen=True):
    """The visible fraction of each object in each frame."""

    frames: FrameCount
    objects: Annotated[dict[str, list[Run]], Meta(description="by id: [fraction, how many frames in a row], ...")]


class TruthDocument(Entry, frozen=True):
    """The true objects of a recording: `truth.json`."""

    format: Literal["cuboid-truth"]
    version: Literal[1]
    objects: list[ObjectOfTruth]
    name: Annotated[Name | None, Meta(description="for people; the file's name unless given")] = None
    frames: Annotated[FrameCount | None, Meta(description="length of the recording")] = None
    judged_region: Annotated[RegionOfTruth | None, Meta(description="null: everything is judged")] = None
    ignore: list[BoxOfTruth] | None = None
    visibility: VisibilityOfTruth | None = None
    events: Annotated[list[EventOfTruth] | None, Meta(description="in the order in which they end")] = None
    agents: Annotated[list[AgentOfTruth] | None, Meta(description="people, in rigid parts")] = None
    relations: Annotated[
        list[RelationOfTruth] | None, Meta(description="of the objects; null: relations are not judged")
    ] = None
    planes: Annotated[tuple[PlaneOfTruth, ...], Meta(description="level surfaces that relations name")] = ()
    walls: Annotated[tuple[PlaneOfTruth, ...], Meta(description="walls that relations name")] = ()

    def __post_init__(self) -> None:
        refuse_twice("object id", [item.id for item in self.objects])
        known = {item.id for item in self.objects}
        for happened in self.events or []:
            if happened.id not in known:
                raise ValueError(f"an event is of object {happened.id}, which is not there")
        if self.relations is not None:
            ends = [(end, f"object {one.subject}") for one in self.relations for end in (one.subject, one.to)]
            refuse_unknown(ends, {item.id for item in self.objects}, len(self.planes), len(self.walls))
        if self.visibility is not None:
            _refuse_visibility(self.visibility, self.objects, self.frames)


def _refuse_moves(moves: list[Move]) -> None:
    """Raise ValueError where frames do not increase, or a turn is none."""
    for k, (frame, _, _, _, *turn) in enumerate(moves):
        refuse_no_quaternion(*turn)
        if k and frame <= moves[k - 1][0]:
            raise ValueError(f"moves: frame {frame} comes after frame {moves[k - 1][0]}")


def _refuse_visibility(seen: VisibilityOfTruth, objects: list[ObjectOfTruth], frames: int | None) -> None:
    """Raise ValueError where visibility does not fit the objects or the recording."""
    if frames not in (None, seen.frames):
        raise ValueError(f"visibility speaks of {seen.frames} frames, the file of {frames}")
    if seen.frames * len(objects) > MAX_FRACTIONS:
        raise ValueError(
            f"{len(objects)} objects in {seen.frames} frames are more than {MAX_FRACTIONS} visible fractions"
        )
    for item in objects:
        runs = seen.objects.get(str(item.id))
        if runs is None and item.judged:
            raise ValueError(f"visibility of object {item.id} is missing")
        length = seen.frames if runs is None else sum(count for _, count in runs)
        if length != seen.frames:
            raise ValueError(f"visibility of object {item.id}: expected {seen.frames} frames, got {length}")
