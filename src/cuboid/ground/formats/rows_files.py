"""The tables of a result folder (`tracks.csv`, `proposals.csv`, `events.csv`, ...); boxes of others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, get_type_hints

import msgspec
from msgspec import Meta

from cuboid.ground.core.records import columns_of
from cuboid.ground.core.results import ObjectEvent, Proposal3D, Sighting
from cuboid.ground.core.values import (
    Count,
    Fraction,
    FrameNumber,
    Label,
    LabelOrNone,
    Metres,
    Pixel,
    QuaternionPart,
    Seconds,
    Side,
    refuse_no_quaternion,
)
from cuboid.ground.formats.rig_file import CameraName
from cuboid.ground.formats.table_validation import Row


class BoxEntry(Row, frozen=True):
    """A box of an object in a frame, from any tracker. The columns have any order; others are ignored."""

    frame: FrameNumber
    label: Label
    cx: Metres
    cy: Metres
    cz: Metres
    length: Side
    width: Side
    height: Side
    qw: QuaternionPart
    qx: QuaternionPart
    qy: QuaternionPart
    qz: QuaternionPart

    def __post_init__(self) -> None:
        refuse_no_quaternion(self.qw, self.qx, self.qy, self.qz)


class BoxerEntry(Row, frozen=True):
    """A box in the table of Boxer (https://github.com/facebookresearch/boxer) and WildDet3D."""

    time_ns: int
    tx_world_object: Metres
    ty_world_object: Metres
    tz_world_object: Metres
    qw_world_object: QuaternionPart
    qx_world_object: QuaternionPart
    qy_world_object: QuaternionPart
    qz_world_object: QuaternionPart
    scale_x: Side
    scale_y: Side
    scale_z: Side
    name: str | None
    instance: int
    sem_id: int
    prob: Fraction

    def __post_init__(self) -> None:
        refuse_no_quaternion(self.qw_world_object, self.qx_world_object, self.qy_world_object, self.qz_world_object)


class OwnBoxEntry(BoxEntry, frozen=True):
    """A 3D proposal of a frame, with the label of its object, or 0."""

    label: LabelOrNone


class RectEntry(Row, frozen=True):
    """A rectangle of an object in a frame, from any tracker. The columns have any order; others are ignored."""

    frame: FrameNumber
    label: Label
    x0: Pixel
    y0: Pixel
    x1: Pixel
    y1: Pixel


class OwnRectEntry(RectEntry, frozen=True):
    """A rectangle of a 3D proposal of a frame, with the label of its object, or 0."""

    label: LabelOrNone


def _line_of(record: type) -> Any:
    """Return the kind of a line with a frame and a record: its label, its box, then the other fields."""
    label, *others = _columns_of(record)
    return _of_a_frame(label, *_BOX, *others)


def _columns_of(record: type) -> Iterator[_Column]:
    """Iterate over the names and kinds of the columns of a record; an optional one may be absent or empty."""
    for one in columns_of(record):
        for name in one.names:
            yield (name, one.kind | None, None) if one.optional else (name, one.kind)


def _of_a_frame(*columns: _Column) -> Any:
    """Return the kind of a line with the frame, its time, and these columns."""
    stamp = (("frame", FrameNumber), ("timestamp", Seconds))
    return msgspec.defstruct("_Line", [*stamp, *columns], bases=(Row,), frozen=True)


_Column = tuple[str, Any] | tuple[str, Any, None]
_SEEN_IN = ("frame", "label")
_BOX: list[_Column] = [
    (name, kind) for name, kind in get_type_hints(BoxEntry, include_extras=True).items() if name not in _SEEN_IN
]
_Track: Any = _line_of(Sighting)
_Proposal: Any = _line_of(Proposal3D)
_Event: Any = _of_a_frame(*_columns_of(ObjectEvent))
_Agent: Any = _of_a_frame(*_BOX)


class TrackEntry(_Track, frozen=True):  # type: ignore[misc, call-arg]
    """A sighting of a confirmed object in a frame: `tracks.csv`. Only a rig of several cameras has the last column."""

    camera: Annotated[CameraName | None, Meta(description="name of the camera in the rig")] = None

    def __post_init__(self) -> None:
        _refuse_line(self)


class ProposalEntry(_Proposal, frozen=True):  # type: ignore[misc, call-arg]
    """A 3D proposal of a frame, from this frame alone: `proposals.csv`."""

    def __post_init__(self) -> None:
        _refuse_line(self)


class EventEntry(_Event, frozen=True):  # type: ignore[misc, call-arg]
    """A change of an object while the camera runs: `events.csv`."""

    def __post_init__(self) -> None:
        for name in ("from", "to"):
            if len({getattr(self, f"{name}_{axis}") is None for axis in "xyz"}) > 1:
                raise ValueError(f"expected {name}_x, {name}_y and {name}_z, or none of them")


class AgentEntry(_Agent, frozen=True):  # type: ignore[misc, call-arg]
    """A box, along the axes of the map, of what moves in a frame and is no object (a person, a hand): `agents.csv`."""

    def __post_init__(self) -> None:
        refuse_no_quaternion(self.qw, self.qx, self.qy, self.qz)


class ProposalLabel(Row, frozen=True):
    """Only the label of a line of `proposals.csv`."""

    label: LabelOrNone


class PoseEntry(Row, frozen=True):
    """A camera pose (camera to world) and its time, in the TUM format: `trajectory.txt`."""

    timestamp: Seconds
    tx: Metres
    ty: Metres
    tz: Metres
    qx: QuaternionPart
    qy: QuaternionPart
    qz: QuaternionPart
    qw: QuaternionPart

    def __post_init__(self) -> None:
        refuse_no_quaternion(self.qw, self.qx, self.qy, self.qz)


class RectangleEntry(Row, frozen=True):
    """A 2D proposal in a file of `--proposals precomputed`; boxes that are not finite are left out later."""

    x0: float
    y0: float
    x1: float
    y1: float
    score: float


class LabelEntry(Row, frozen=True):
    """A line of a `.label` file of RGB-D Scenes v2: first the number of points, then the class of each."""

    number: Count


def _refuse_line(line: Any) -> None:
    refuse_no_quaternion(line.qw, line.qx, line.qy, line.qz)
    if line.x1 < line.x0 or line.y1 < line.y0:
        raise ValueError(f"the rectangle ends before it begins: {line.x0:g}, {line.y0:g} to {line.x1:g}, {line.y1:g}")
