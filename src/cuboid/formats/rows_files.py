"""The tables of a result folder: `tracks.csv`, `proposals.csv`, `trajectory.txt`; and boxes of other trackers."""

from __future__ import annotations

from cuboid.formats.table_validation import Row
from cuboid.formats.values import (
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


class BoxEntry(Row, frozen=True):
    """An object seen in a frame, as any tracker can say it; the columns may stand in any order, others among them."""

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


class OwnBoxEntry(BoxEntry, frozen=True):
    """A frame's own box before matching, with the label it was given, or 0."""

    label: LabelOrNone


class RectEntry(Row, frozen=True):
    """A rectangle seen in a frame, as any tracker can say it; the columns may stand in any order, others among them."""

    frame: FrameNumber
    label: Label
    x0: Pixel
    y0: Pixel
    x1: Pixel
    y1: Pixel


class OwnRectEntry(RectEntry, frozen=True):
    """A frame's own rectangle before matching, with the label it was given, or 0."""

    label: LabelOrNone


class TrackEntry(Row, frozen=True):
    """A confirmed object seen in a frame: `tracks.csv`."""

    frame: FrameNumber
    timestamp: Seconds
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
    iou: Fraction | None
    visible: Fraction
    x0: Pixel
    y0: Pixel
    x1: Pixel
    y1: Pixel

    def __post_init__(self) -> None:
        refuse_no_quaternion(self.qw, self.qx, self.qy, self.qz)
        _refuse_inverted(self.x0, self.y0, self.x1, self.y1)


class ProposalEntry(Row, frozen=True):
    """A 3D proposal of a frame, as that frame alone gave it: `proposals.csv`."""

    frame: FrameNumber
    timestamp: Seconds
    label: LabelOrNone
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
    score: Fraction
    x0: Pixel
    y0: Pixel
    x1: Pixel
    y1: Pixel

    def __post_init__(self) -> None:
        refuse_no_quaternion(self.qw, self.qx, self.qy, self.qz)
        _refuse_inverted(self.x0, self.y0, self.x1, self.y1)


class ProposalLabel(Row, frozen=True):
    """The label alone of a line of `proposals.csv`."""

    label: LabelOrNone


class PoseEntry(Row, frozen=True):
    """A camera pose (camera to world) and its time, the TUM form: `trajectory.txt`."""

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
    """A 2D proposal in a file of `--proposals precomputed`; what is no finite box is left out later."""

    x0: float
    y0: float
    x1: float
    y1: float
    score: float


class LabelEntry(Row, frozen=True):
    """A line of a `.label` file of RGB-D Scenes v2: first the number of points, then the class of each."""

    number: Count


def _refuse_inverted(x0: float, y0: float, x1: float, y1: float) -> None:
    if x1 < x0 or y1 < y0:
        raise ValueError(f"the rectangle ends before it begins: {x0:g}, {y0:g} to {x1:g}, {y1:g}")
