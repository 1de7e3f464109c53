"""Records of results: sightings in a frame, objects of the map, supporting planes, the point map, changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Self, get_args

import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float32Array, Float64Array, UInt8Array
from cuboid.core.records import LEVEL, PIXEL, column
from cuboid.core.values import (
    Count,
    EventName,
    Fraction,
    FrameNumber,
    Label,
    LabelOrNone,
    Level,
    Metres,
    Pixel,
    RelationKind,
)
from cuboid.geometry.box import Box
from cuboid.geometry.se3 import transform

# The rectangle of a record in its frame's image.
RECTANGLE = column("rectangle in the color image", kind=Pixel, digits=PIXEL, parts=("x0", "y0", "x1", "y1"))
# Kinds of relations between objects and surfaces.
RELATIONS: tuple[RelationKind, ...] = get_args(RelationKind)
# Names that results tell beside the first.
NEXT_NAMES = 3


@dataclass(frozen=True, slots=True)
class Proposal3D:
    """One 3D proposal of a frame, as that frame alone gave it.

    Attributes
    ----------
    label : int
        The object's label; 0 while the object that it belongs to is not confirmed.
    box : Box
        In the world.
    score : float
        Mean heat of the points, 0..1.
    rect_xyxy : (4,) float64
        Rectangle in the frame's image, pixels, end exclusive.
    """

    label: LabelOrNone = field(metadata=column("of the object; 0: none"))
    box: Box
    score: Fraction = field(metadata=column("mean heat of the points, 0 to 1"))
    rect_xyxy: Float64Array = field(metadata=RECTANGLE)

    def __repr__(self) -> str:
        return (
            f"Proposal3D({tag_of(self.label) if self.label else 'no label'}: {self.box.text()}; score {self.score:.2f})"
        )


@dataclass(frozen=True, slots=True)
class Sighting:
    """A confirmed object that is seen in a frame.

    Attributes
    ----------
    label : int
    box : Box
        The object's box in the world as the map has it after the frame.
    iou : float or None
        3D IoU of the frame's own proposal with that box; None where the frame has no proposal of its own.
    visible : float
        Fraction of the object's near side that is seen, 0..1.
    rect_xyxy : (4,) float64
        Rectangle in the frame's image, pixels, end exclusive, clipped to the image.
    """

    label: Label = field(metadata=column("of the object, 1 or more"))
    box: Box
    iou: Fraction | None = field(metadata=column("of the frame's own proposal with the object's box; null without one"))
    visible: Fraction = field(metadata=column("fraction of the object that is seen, 0 to 1"))
    rect_xyxy: Float64Array = field(metadata=RECTANGLE)

    def __repr__(self) -> str:
        return f"Sighting({tag_of(self.label)}: {self.box.text()}; {self.visible:.0%} visible)"


@dataclass(frozen=True, slots=True)
class ObjectEvent:
    """A change of an object while the camera watched.

    Attributes
    ----------
    event : {"appeared", "moved", "gone", "back"}
        "appeared": it stands where nothing stood. "moved": it stands elsewhere. "gone": its place is empty. "back": it
        was gone, and is there again.
    label : int
    from_m, to_m : (3,) float64 or None
        Middle of its box before and after, in the world; None where it was not, or is not, there.
    score : float
        How sure it is that this is the object, 0..1.
    """

    event: EventName = field(metadata=column("what happened"))
    label: Label = field(metadata=column("of the object, 1 or more"))
    from_m: Float64Array | None = field(
        metadata=column("middle of its box before", kind=Metres | None, parts=("from_x", "from_y", "from_z"))
    )
    to_m: Float64Array | None = field(
        metadata=column("middle of its box after", kind=Metres | None, parts=("to_x", "to_y", "to_z"))
    )
    score: Fraction = field(metadata=column("how sure it is that this is the object, 0 to 1"))

    def moved(self, T_new_old: Float64Array) -> Self:
        """Return it in another world, by a rigid motion (4, 4)."""
        from_m, to_m = (None if at is None else transform(T_new_old, at) for at in (self.from_m, self.to_m))
        return replace(self, from_m=from_m, to_m=to_m)

    def __repr__(self) -> str:
        places = " to ".join(
            "nowhere" if at is None else f"({at[0]:z.2f}, {at[1]:z.2f}, {at[2]:z.2f})"
            for at in (self.from_m, self.to_m)
        )
        return f"ObjectEvent({tag_of(self.label)} {self.event}: {places}; score {self.score:.2f})"


@dataclass(frozen=True, slots=True)
class FrameResult:
    """The result of `Tracker.update` for one frame.

    Attributes
    ----------
    index, timestamp_s :
        Those of the frame.
    T_world_camera : (4, 4) float64
    sightings : tuple of Sighting
        Confirmed objects seen in this frame, by label.
    proposals : tuple of Proposal3D
        The frame's own boxes, but those larger than an object may be.
    objects_known : int
        Confirmed objects in the map, seen now or not.
    heat : (H, W) float32
        2D heat after depth's correction, 0..1, for views.
    milliseconds : dict of str to float
        Time of each stage, in the order of work.
    left_out : mapping of str to int
        How many proposals, clusters (segments) and candidates were more than a frame may bring, see `core.limits`.
    size : (int, int) or None
        Width and height of the frame, pixels; None is the heat's.
    events : tuple of ObjectEvent
        What this frame told of objects that move.
    agents : tuple of Box
        Where something moves that is no object: people, hands, doors.
    """

    index: int
    timestamp_s: float
    T_world_camera: Float64Array
    sightings: tuple[Sighting, ...]
    proposals: tuple[Proposal3D, ...]
    objects_known: int
    heat: Float32Array
    milliseconds: dict[str, float]
    left_out: Mapping[str, int] = field(default_factory=dict)
    size: tuple[int, int] | None = None
    events: tuple[ObjectEvent, ...] = ()
    agents: tuple[Box, ...] = ()

    def __repr__(self) -> str:
        labels = ", ".join(f"#{seen.label}" for seen in self.sightings) or "nothing"
        return f"FrameResult(frame {self.index}: sees {labels}; {self.objects_known} objects known)"

    def _repr_png_(self) -> bytes:
        """Show the heat and the objects that are seen, in a notebook."""
        from cuboid.core.display import png_of

        return png_of("result_png", self)


@dataclass(frozen=True, slots=True)
class Relation:
    """A relation of an object to another one, to a supporting plane, or to a wall.

    Attributes
    ----------
    kind : {"on", "in", "beside", "under", "against", "supports"}
        Of `RELATIONS`: the object is on, in, beside, under or against the other, or supports it.
    to : int or str
        Label of the other object; "plane:k" for the supporting plane k, "wall:k" for the wall k.
    score : float
        Probability, 0..1; `cuboid.relations` says of what.
    """

    kind: RelationKind
    to: int | str
    score: float

    def __repr__(self) -> str:
        to = self.to if isinstance(self.to, str) else tag_of(self.to)
        return f"Relation({self.kind} {to}; score {self.score:.2f})"


@dataclass(frozen=True, slots=True)
class TrackedObject:
    """An object of the map; the fields are those of `objects.json`.

    Attributes
    ----------
    label : int
    box : Box
        In the world.
    score : float
        Confidence that it is an object, 0..1.
    heat : float
        Mean heat of its points, 0..1.
    first_frame, last_frame, frames_seen : int
        Frames of the recording.
    points : int
        Points of the map that belong to it: of a tracker those that decide, of results those of `map.ply`.
    mean_color : (3,) float64
        RGB, 0..255.
    plane : int or None
        Index into the tracker's planes.
    merged_labels : tuple of int
        Younger labels that turned out to be this object.
    name : str or None
        Name that a user gave it, else that of its class by a detector; None where there is none.
    name_score : float or None
        Probability of the class, 0..1; None where the name is a user's, or there is none.
    names : tuple of (str, float)
        The next likely classes, at most three, with their probabilities.
    kind : str
        "volume"; of things that depth does not read, "flat" on a plane, or else "box".
    relations : tuple of Relation
        Relations to other objects and to surfaces; empty where nobody asked for them.
    """

    label: Label = field(metadata=column("of the object, 1 or more"))
    box: Box
    score: Fraction = field(metadata=column("confidence that it is an object, 0 to 1"))
    heat: Fraction = field(metadata=column("mean heat of its points, 0 to 1"))
    first_frame: FrameNumber = field(metadata=column("first frame that saw it, from 0"))
    last_frame: FrameNumber = field(metadata=column("last frame that saw it, from 0"))
    frames_seen: Count = field(metadata=column("frames that saw it"))
    points: Count = field(metadata=column("points of the map that belong to it"))
    mean_color: Float64Array = field(
        metadata=column(
            "mean color of its points: red, green, blue, 0 to 255",
            kind=Level,
            digits=LEVEL,
            parts=("red", "green", "blue"),
            stored=False,
        )
    )
    plane: Count | None = field(metadata=column("index into planes: what it stands on", stored=False))
    merged_labels: tuple[Label, ...] = field(
        default=(), metadata=column("younger labels that turned out to be this object")
    )
    name: str | None = field(
        default=None,
        metadata=column("a user's name, else its class by a detector; left out where there is none", stored=False),
    )
    name_score: float | None = None
    names: tuple[tuple[str, float], ...] = ()
    kind: str = "volume"
    relations: tuple[Relation, ...] = ()

    def with_given_name(self, name: str) -> Self:
        """Return it with a name that a user gave: the class that a detector saw is then the first of the next ones."""
        seen = () if self.name is None or self.name_score is None else ((self.name, self.name_score),)
        return replace(self, name=name, name_score=None, names=(*seen, *self.names)[:NEXT_NAMES])

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({tag_of(self.label, self.name)}: {self.box.text()}; "
            f"score {self.score:.2f}, seen in {self.frames_seen} frames)"
        )


def tag_of(label: int, name: str | None = None) -> str:
    """Return a label as it is shown everywhere: with its name, where there is one."""
    return f"#{label} {name}" if name else f"#{label}"


def names_of(objects: Iterable[TrackedObject]) -> dict[int, str]:
    """Return the names of those objects that have one, by label."""
    return {item.label: item.name for item in objects if item.name}


@dataclass(frozen=True, slots=True)
class SupportPlane:
    """A supporting plane, n.p + d = 0 in the world, n pointing up.

    Attributes
    ----------
    normal : (3,) float64
    offset : float
        Metres.
    extent : (N, 3) float64
        Outline of what was seen of it, a polygon on the plane, in the world.
    """

    normal: Float64Array
    offset: float
    extent: Float64Array

    def __repr__(self) -> str:
        normal = ", ".join(f"{value:z.2f}" for value in self.normal)
        return f"SupportPlane(normal {normal}; offset {self.offset:z.3f} m; outline of {len(self.extent)} points)"


@dataclass(frozen=True, slots=True)
class Wall:
    """A wall, n.p + d = 0 in the world, n level and pointing to the side from which it was seen.

    Attributes
    ----------
    normal : (3,) float64
    offset : float
        Metres.
    extent : (4, 3) float64
        Corners of the upright rectangle around what was seen of it, in the world.
    """

    normal: Float64Array
    offset: float
    extent: Float64Array

    def __repr__(self) -> str:
        normal = ", ".join(f"{value:z.2f}" for value in self.normal)
        return f"Wall(normal {normal}; offset {self.offset:z.3f} m)"


@dataclass(frozen=True, slots=True)
class MapPoints:
    """The global point map.

    Attributes
    ----------
    xyz : (N, 3) float32
        World, metres.
    rgb : (N, 3) uint8
    heat : (N,) float32
        0..1.
    label : (N,) int32
        0 where the point belongs to no confirmed object.
    """

    xyz: Float32Array
    rgb: UInt8Array
    heat: Float32Array
    label: npt.NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))

    def __repr__(self) -> str:
        return f"MapPoints({len(self.xyz)} points)"

    def counted(self, objects: Iterable[TrackedObject]) -> tuple[TrackedObject, ...]:
        """Return objects with the number of points that each has here."""
        known = tuple(objects)
        counts = np.bincount(self.label, minlength=1 + max((item.label for item in known), default=0))
        return tuple(replace(item, points=int(counts[item.label])) for item in known)


@dataclass(frozen=True, slots=True)
class SceneChange:
    """A change of one object of a scene between two visits.

    Attributes
    ----------
    recording : int
        The visit.
    label : int
    name : str or None
        Name that a user gave it; None where there is none.
    change : str
        "unchanged", "moved", "gone", "new", "found" (it stands where nothing was seen before) or "not looked at".
    box : Box
        As known last; turned as it last stood.
    from_m, to_m : (3,) float64 or None
        Where its middle was, and is.
    metres : float or None
        How far it was moved.
    sure : float
        How sure it is that what was moved is the same, 0..1.
    before, after : bytes or None
        Its pictures, JPEG.
    """

    recording: int
    label: int
    name: str | None
    change: str
    box: Box
    from_m: Float64Array | None
    to_m: Float64Array | None
    metres: float | None
    sure: float
    before: bytes | None
    after: bytes | None

    def __repr__(self) -> str:
        moved = "" if self.metres is None else f" by {self.metres:.2f} m"
        return f"SceneChange(recording {self.recording}, {tag_of(self.label, self.name)}: {self.change}{moved})"
