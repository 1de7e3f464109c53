"""Records of results: sightings in a frame, objects of the map, supporting planes, the point map, changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Self, get_args

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec import Meta

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.display import png_of
from cuboid.ground.core.records import COLOR_LEVEL, PIXEL, column
from cuboid.ground.core.values import (
    Count,
    Entry,
    EventName,
    Fraction,
    FrameNumber,
    Label,
    LabelOrNone,
    Level,
    Metres,
    ObjectKind,
    Pixel,
    RelationKind,
    SideName,
    Sides,
    Surface,
    VisitChange,
)
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import transform

# The rectangle of a record in its frame's image.
RECTANGLE = column("rectangle in the color image", kind=Pixel, digits=PIXEL, parts=("x0", "y0", "x1", "y1"))
# Kinds of relations between objects and surfaces.
RELATIONS: tuple[RelationKind, ...] = get_args(RelationKind)
# The kind, in `TrackedObject.kind`, of furniture that bears supporting planes.
SUPPORT = "support"
# Number of further class names in results.
NEXT_NAMES = 3


@dataclass(frozen=True, slots=True)
class Proposal3D:
    """A 3D proposal of a frame, from this frame alone.

    Attributes
    ----------
    label : int
        Label of its object; 0 while the object is not confirmed.
    box : Box
        In the world.
    score : float
        Mean heat of the points, 0..1.
    rect_xyxy : (4,) float64
        Rectangle in the frame's image, pixels, end exclusive.
    """

    label: LabelOrNone = field(metadata=column("label of the object; 0: none"))
    box: Box
    score: Fraction = field(metadata=column("mean heat of the points, 0 to 1"))
    rect_xyxy: Float64Array = field(metadata=RECTANGLE)

    def __repr__(self) -> str:
        return (
            f"Proposal3D({tag_of(self.label) if self.label else 'no label'}: {self.box.text()}; score {self.score:.2f})"
        )


@dataclass(frozen=True, slots=True)
class Sighting:
    """A sighting: a confirmed object that a frame shows.

    Attributes
    ----------
    label : int
    box : Box
        Box of the object in the map after the frame, in the world.
    iou : float or None
        3D IoU of the frame's 3D proposal with that box; None if the frame has no proposal of the object.
    visible : float
        Visible fraction of the object's near side, 0..1.
    rect_xyxy : (4,) float64
        Rectangle in the frame's image, pixels, end exclusive, clipped to the image.
    probability : float or None
        Probability that the object is one whole object, after the frame, 0..1; None in results of an older version.
    """

    label: Label = field(metadata=column("label of the object, 1 or more"))
    box: Box
    iou: Fraction | None = field(
        metadata=column("3D IoU of the frame's proposal with the box of the object; null without a proposal")
    )
    visible: Fraction = field(metadata=column("visible fraction of the object, 0 to 1"))
    rect_xyxy: Float64Array = field(metadata=RECTANGLE)
    probability: Fraction | None = field(
        default=None,
        kw_only=True,
        metadata=column("probability that it is one whole object, after the frame, 0 to 1; absent in older files"),
    )

    def __repr__(self) -> str:
        return f"Sighting({tag_of(self.label)}: {self.box.text()}; {self.visible:.0%} visible)"


@dataclass(frozen=True, slots=True)
class ObjectEvent:
    """A change of an object while the camera runs.

    Attributes
    ----------
    event : {"appeared", "moved", "gone", "back"}
        "appeared": the object stands at a place that was empty. "moved": it stands at another place. "gone": its place
        is empty. "back": it was gone, and stands there again.
    label : int
    from_m, to_m : (3,) float64 or None
        Centre of its box before and after, in the world; None if the object was, or is, not in the scene.
    score : float
        Confidence that it is the same object, 0..1.
    """

    event: EventName = field(metadata=column("kind of the event"))
    label: Label = field(metadata=column("label of the object, 1 or more"))
    from_m: Float64Array | None = field(
        metadata=column("centre of its box before", kind=Metres | None, parts=("from_x", "from_y", "from_z"))
    )
    to_m: Float64Array | None = field(
        metadata=column("centre of its box after", kind=Metres | None, parts=("to_x", "to_y", "to_z"))
    )
    score: Fraction = field(metadata=column("confidence that it is the same object, 0 to 1"))

    def moved(self, T_new_old: Float64Array) -> Self:
        """Return the event in other world coordinates, after a rigid transform (4, 4)."""
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
        Objects seen in this frame that have a label and at least the probability `TrackerConfig.min_probability`, by
        label.
    proposals : tuple of Proposal3D
        3D proposals of the frame, without those larger than `max_size_m`.
    objects_known : int
        Number of objects of the map with a label and at least that probability, visible or not.
    heat : (H, W) float32
        2D heat after the correction by depth, 0..1, for views.
    milliseconds : dict of str to float
        Time of each stage, in the order of work.
    left_out : mapping of str to int
        Numbers of proposals, clusters (segments) and candidates beyond the limits of a frame, see `core.limits`.
    size : (int, int) or None
        Width and height of the frame, pixels; None: the size of the heat.
    events : tuple of ObjectEvent
        Events of objects at this frame.
    agents : tuple of Box
        Boxes of moving things that are not objects: people, hands, doors.
    camera : str
        Name of the frame's camera in the rig; empty if all frames are of one camera.
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
    camera: str = ""

    def __repr__(self) -> str:
        labels = ", ".join(f"#{seen.label}" for seen in self.sightings) or "nothing"
        return f"FrameResult(frame {self.index}: sees {labels}; {self.objects_known} objects known)"

    def _repr_png_(self) -> bytes:
        """Show the heat and the objects that are seen, in a notebook."""
        return png_of(self)


class Relation(Entry, frozen=True):
    """A relation of an object to another one or to a surface."""

    to: Annotated[Label | Surface, Meta(description="label of the other object, or plane:k, or wall:k, counted from 0")]
    kind: Annotated[RelationKind, Meta(description="kind of the relation of the object to the other one")] = (
        msgspec.field(name="is")
    )
    score: Annotated[Fraction, Meta(description="probability of the relation, 0 to 1")]

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
        Probability that it is one whole object, 0..1: of many labels with this value, that fraction is one.
    heat : float
        Mean heat of its points, 0..1.
    first_frame, last_frame, frames_seen : int
        First and last frame that saw it, and the number of frames that saw it.
    points : int
        Number of its points: in a tracker, those used for its box; in results, those of `map.ply`.
    mean_color : (3,) float64
        RGB, 0..255.
    plane : int or None
        Index of its supporting plane; None if unknown.
    merged_labels : tuple of int
        Younger labels that were merged into this one.
    name : str or None
        Name given by a user, else class from a detector; None without one.
    name_score : float or None
        Probability of the class, 0..1; None for a user's name, or without a name.
    names : tuple of (str, float)
        The next most likely classes, at most three, with their probabilities.
    kind : str
        "volume"; for objects without depth readings "flat" (on a plane) or "box"; "support" for furniture that bears
        supporting planes.
    size_sigma_m : tuple of float
        Standard deviations of the three sizes of the box, metres; empty for furniture and in older results.
    center_sigma_m : tuple of float
        Standard deviations of the centre along the axes of the world, metres; empty for objects without depth readings,
        for furniture, and in older results.
    sides_seen : tuple of str
        The sides of the box that a camera saw as faces, such as "+x" (the side at the end of the first axis) and "+z"
        (the top); empty if unknown.
    relations : tuple of Relation
        Relations to other objects and to surfaces; empty if they were not requested.
    planes : tuple of int
        Indices of the supporting planes that furniture bears; empty for objects.
    """

    label: Label = field(metadata=column("label of the object, 1 or more"))
    box: Box
    score: Fraction = field(
        metadata=column("probability that it is one whole object, 0 to 1; 0 for furniture", also="probability")
    )
    heat: Fraction = field(metadata=column("mean heat of its points, 0 to 1"))
    first_frame: FrameNumber = field(
        metadata=column("first frame that saw it, from 0; its rows in `tracks.csv` begin when it is confirmed")
    )
    last_frame: FrameNumber = field(metadata=column("last frame that saw it, from 0"))
    frames_seen: Count = field(metadata=column("number of frames that saw it"))
    points: Count = field(metadata=column("number of its points in the map"))
    mean_color: Float64Array = field(
        metadata=column(
            "mean color of its points: red, green, blue, 0 to 255",
            kind=Level,
            digits=COLOR_LEVEL,
            parts=("red", "green", "blue"),
            stored=False,
        )
    )
    plane: Count | None = field(metadata=column("index of its supporting plane in planes", stored=False))
    # A factory, since files always contain it: they omit a field with a plain default.
    merged_labels: tuple[Label, ...] = field(
        default_factory=tuple, metadata=column("younger labels that were merged into this one")
    )
    name: str | None = field(
        default=None,
        metadata=column("name given by a user, else class from a detector"),
    )
    name_score: Fraction | None = field(
        default=None, metadata=column("probability of the class; absent for a user's name", tables=False)
    )
    names: tuple[tuple[str, Fraction], ...] = field(
        default=(),
        metadata=column(
            "the next most likely classes, at most 3, with their probabilities", tables=False, stored=False
        ),
    )
    kind: str = field(
        default="volume",
        metadata=column(
            "`volume`, also where absent; `flat` (on a plane) or `box` for objects without depth readings; `support` "
            "for furniture that bears supporting planes, and is no object",
            kind=ObjectKind,
            tables=False,
        ),
    )
    size_sigma_m: tuple[float, ...] = field(
        default=(),
        metadata=column(
            "standard deviations of `size`, metres; absent in older files", kind=Sides, tables=False, stored=False
        ),
    )
    center_sigma_m: tuple[float, ...] = field(
        default=(),
        metadata=column(
            "standard deviations of `center` along the axes of the world, metres; absent in older files, and for "
            "objects without depth readings",
            kind=Sides,
            tables=False,
            stored=False,
        ),
    )
    sides_seen: tuple[SideName, ...] = field(
        default=(),
        metadata=column(
            "sides of the box that a camera saw as faces, by axis of the box: `+z` is the top",
            tables=False,
            stored=False,
        ),
    )
    relations: tuple[Relation, ...] = field(
        default=(),
        metadata=column(
            "relations to other objects and surfaces; absent if they were not requested", tables=False, stored=False
        ),
    )
    planes: tuple[Count, ...] = field(
        default=(),
        metadata=column(
            "indices of the supporting planes that furniture bears; absent for objects", tables=False, stored=False
        ),
    )

    @property
    def probability(self) -> float:
        """Probability that it is one whole object, 0..1: the `score`, under the name of its meaning."""
        return self.score

    def with_given_name(self, name: str) -> Self:
        """Return the object with a name given by a user; the class from a detector becomes the first of `names`."""
        seen = () if self.name is None or self.name_score is None else ((self.name, self.name_score),)
        return replace(self, name=name, name_score=None, names=(*seen, *self.names)[:NEXT_NAMES])

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({tag_of(self.label, self.name)}: {self.box.text()}; "
            f"probability {self.score:.2f}, seen in {self.frames_seen} frames)"
        )


def tag_of(label: int, name: str | None = None) -> str:
    """Return a label as all outputs show it, with its name if there is one."""
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
        Outline of the seen part, a polygon on the plane, in the world.
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
        Corners of the upright rectangle around the seen part, in the world.
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
        Label of the confirmed object; 0: none.
    """

    xyz: Float32Array
    rgb: UInt8Array
    heat: Float32Array
    label: npt.NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))

    def __repr__(self) -> str:
        return f"MapPoints({len(self.xyz)} points)"

    def of_object(self, label: int) -> MapPoints:
        """Return the points with a label."""
        chosen = self.label == label
        return MapPoints(self.xyz[chosen], self.rgb[chosen], self.heat[chosen], self.label[chosen])

    def counted(self, objects: Iterable[TrackedObject]) -> tuple[TrackedObject, ...]:
        """Return the objects with their numbers of points in this map."""
        items = tuple(objects)
        counts = np.bincount(self.label, minlength=1 + max((item.label for item in items), default=0))
        return tuple(replace(item, points=int(counts[item.label])) for item in items)


@dataclass(frozen=True, slots=True)
class SceneChange:
    """A change of one object of a scene between two visits.

    Attributes
    ----------
    recording : int
        The visit.
    label : int
    name : str or None
        Name given by a user; None without one.
    change : str
        "unchanged", "moved", "gone", "new", "found" (at a place that was not seen before) or "not looked at".
    box : Box
        Its last known box, at its last orientation.
    from_m, to_m : (3,) float64 or None
        Centre of its box before and after, in the world.
    metres : float or None
        Distance of the move.
    sure : float
        Confidence that the moved object is the same one, 0..1.
    before, after : bytes or None
        Its pictures, JPEG.
    """

    recording: int
    label: int
    name: str | None
    change: VisitChange
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
