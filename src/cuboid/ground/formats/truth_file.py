"""Truth files: the objects, the judged region, and the visible objects of each frame."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from cuboid.ground.core.values import (
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
from cuboid.ground.formats.relations import PlaneOfTruth, RelationOfTruth, refuse_unknown
from cuboid.ground.formats.run_file import MAX_FRAMES
from cuboid.ground.geometry.se3 import MAX_FROM_ORIGIN_M

# Frames times objects: what is visible is held as a table of both.
MAX_FRACTIONS = 20_000_000

Run = tuple[Fraction, Count]
FrameCount = Annotated[int, Meta(ge=0, le=MAX_FRAMES)]
Move = tuple[FrameNumber, Metres, Metres, Metres, QuaternionPart, QuaternionPart, QuaternionPart, QuaternionPart]
Moves = Annotated[
    list[Move],
    Meta(description="poses of its box: frame from which it holds, centre, quaternion (w first)"),
]
PositiveSide = Annotated[float, Meta(gt=0.0, le=MAX_FROM_ORIGIN_M, description="metres")]


class BoxOfTruth(Entry, frozen=True):
    """A place in which results are not judged."""

    center: Point
    size: tuple[PositiveSide, PositiveSide, PositiveSide]
    rotation: Annotated[
        Rotation, Meta(description="rotation matrix by rows; its columns are the axes of the box in the world")
    ]

    def __post_init__(self) -> None:
        refuse_no_rotation(self.rotation)


class ObjectOfTruth(BoxOfTruth, frozen=True, kw_only=True):
    """A true object."""

    id: Annotated[Label, Meta(description="identity of the object")]
    name: Annotated[Name | None, Meta(description="name")] = None
    judged: Annotated[bool, Meta(description="false: results for it are not judged")] = True
    round: Annotated[bool, Meta(description="symmetric about its third axis")] = False
    moves: Moves | None = None

    def __post_init__(self) -> None:
        refuse_no_rotation(self.rotation)
        _refuse_moves(self.moves or [])


class AgentOfTruth(Entry, frozen=True):
    """A rigid part of a person, which is never an object."""

    size: tuple[PositiveSide, PositiveSide, PositiveSide]
    moves: Moves
    name: Annotated[Name | None, Meta(description="name")] = None

    def __post_init__(self) -> None:
        _refuse_moves(self.moves)


class EventOfTruth(Entry, frozen=True):
    """A change of an object while the camera runs."""

    event: EventName
    id: Annotated[Label, Meta(description="identity of the object")]
    begin: Annotated[FrameNumber, Meta(description="frame in which the object leaves its place")]
    end: Annotated[FrameNumber, Meta(description="frame in which it is at rest again, or has left the scene")]
    begun_at: Annotated[Point | None, Meta(description="centre of its box before, metres; null: not in the scene")] = (
        msgspec.field(default=None, name="from")
    )
    to: Annotated[Point | None, Meta(description="centre of its box after, metres; null: not in the scene")] = None

    def __post_init__(self) -> None:
        if self.end < self.begin:
            raise ValueError(f"the event ends in frame {self.end}, before it begins in frame {self.begin}")


class RegionOfTruth(Entry, frozen=True):
    """The judged part of the world: a prism over a polygon on a plane."""

    normal: Annotated[Point, Meta(description="normal of the plane normal . p + offset = 0")]
    offset: Metres
    polygon: Annotated[list[Point], Meta(min_length=3, max_length=10_000, description="corners in order, metres")]
    hmin: Annotated[Metres, Meta(description="least height above the plane, along the normal, metres")]
    hmax: Metres

    def __post_init__(self) -> None:
        if np.linalg.norm(self.normal) < 1e-6:
            raise ValueError("the normal has no direction")


class VisibilityOfTruth(Entry, frozen=True):
    """The visible fraction of each object in each frame."""

    frames: FrameCount
    objects: Annotated[dict[str, list[Run]], Meta(description="by id: [fraction, number of consecutive frames], ...")]


class TruthDocument(Entry, frozen=True):
    """The true objects of a recording: `truth.json`."""

    format: Literal["cuboid-truth"]
    version: Literal[1]
    objects: list[ObjectOfTruth]
    name: Annotated[Name | None, Meta(description="name of the truth; default: the name of the file")] = None
    frames: Annotated[FrameCount | None, Meta(description="number of frames of the recording")] = None
    judged_region: Annotated[RegionOfTruth | None, Meta(description="null: everything is judged")] = None
    ignore: list[BoxOfTruth] | None = None
    visibility: VisibilityOfTruth | None = None
    events: Annotated[list[EventOfTruth] | None, Meta(description="events in the order of their ends")] = None
    agents: Annotated[list[AgentOfTruth] | None, Meta(description="rigid parts of people")] = None
    relations: Annotated[
        list[RelationOfTruth] | None, Meta(description="relations of the objects; null: relations are not judged")
    ] = None
    planes: Annotated[tuple[PlaneOfTruth, ...], Meta(description="level surfaces in relations")] = ()
    walls: Annotated[tuple[PlaneOfTruth, ...], Meta(description="walls in relations")] = ()

    def __post_init__(self) -> None:
        refuse_twice("object id", [item.id for item in self.objects])
        object_ids = {item.id for item in self.objects}
        for happened in self.events or []:
            if happened.id not in object_ids:
                raise ValueError(f"an event is of object {happened.id}, which is not there")
        if self.relations is not None:
            ends = [(end, f"object {one.subject}") for one in self.relations for end in (one.subject, one.to)]
            refuse_unknown(ends, {item.id for item in self.objects}, len(self.planes), len(self.walls))
        if self.visibility is not None:
            _refuse_visibility(self.visibility, self.objects, self.frames)


def _refuse_moves(moves: list[Move]) -> None:
    """Raise ValueError where frames do not increase, or a quaternion is not one."""
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
