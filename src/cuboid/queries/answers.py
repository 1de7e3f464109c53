"""Typed answers of a place: plain data in metres, seconds and the world, the same over HTTP, MCP and in Python.

The classes have no slots: the SDK of MCP takes their schemas from the attributes of the class.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from cuboid.core.values import RelationKind

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
State = Literal["present", "gone", "merged", "forgotten"]
ChangeName = Literal["confirmed", "moved", "gone", "renamed", "merged", "appeared", "back"]


@dataclass(frozen=True)
class Seen:
    """When an object was seen.

    Attributes
    ----------
    frame : int
        Of the recording.
    recording : int or None
        Of a scene, from 1.
    time : str or None
        UTC, ISO 8601; None where the times of the recording are no calendar's.
    """

    frame: int
    recording: int | None = None
    time: str | None = None


@dataclass(frozen=True)
class Related:
    """A relation of an object.

    Attributes
    ----------
    kind : {"on", "in", "beside", "under", "against", "supports"}
    to : int or str
        Label of the other object; "plane:k" or "wall:k" for a surface.
    name : str or None
        Of the other object.
    score : float
        Probability, 0..1.
    """

    kind: RelationKind
    to: int | str
    name: str | None
    score: float


@dataclass(frozen=True)
class FoundObject:
    """An object of a place.

    Attributes
    ----------
    label : int
    name : str or None
    state : {"present", "gone", "merged", "forgotten"}
    kind : str
        "volume", or of what depth does not read "flat" or "box".
    classes : tuple of (str, float)
        The next likely classes of a detector, with their probabilities.
    score : float
        Confidence that it is an object, 0..1.
    center_m, size_m : (3,)
        Of its box in the world, metres; length, width and height along the box's own axes.
    quat_wxyz : (4,)
        Rotation from the box's axes to the world.
    color : str or None
        The color word of its mean color.
    plane : int or None
        Index of the supporting plane that it stands on.
    first_seen, last_seen : Seen
    frames_seen : int
    distance_m : float or None
        From what it was to be near.
    text_score : float or None
        Cosine of the angle between the vectors of a text and of the object's pictures, -1..1; None without a text.
    relations : tuple of Related or None
        None where they were not asked for.
    """

    label: int
    name: str | None
    state: State
    kind: str
    classes: tuple[tuple[str, float], ...]
    score: float
    center_m: Vector
    size_m: Vector
    quat_wxyz: Quaternion
    color: str | None
    plane: int | None
    first_seen: Seen
    last_seen: Seen
    frames_seen: int
    distance_m: float | None = None
    text_score: float | None = None
    relations: tuple[Related, ...] | None = None


@dataclass(frozen=True)
class Surface:
    """A supporting plane.

    Attributes
    ----------
    surface : str
        "plane:k".
    center_m : (3,)
        Middle of what was seen of it.
    normal : (3,)
        Up.
    height_m : float
        Over the lowest surface.
    area_m2 : float
        Of what was seen of it.
    objects : tuple of int
        Labels of those that stand on it.
    """

    surface: str
    center_m: Vector
    normal: Vector
    height_m: float
    area_m2: float
    objects: tuple[int, ...]


@dataclass(frozen=True)
class FreePlace:
    """The nearest free place on a surface.

    Attributes
    ----------
    surface : str
    center_m : (3,)
        Middle of the footprint, on the surface.
    along : (3,)
        Direction of the length, a unit vector.
    length_m, width_m : float
    distance_m : float
        From where it was to be near.
    """

    surface: str
    center_m: Vector
    along: Vector
    length_m: float
    width_m: float
    distance_m: float


@dataclass(frozen=True)
class SightingAnswer:
    """A sighting of an object."""

    frame: int
    recording: int | None
    seconds: float
    center_m: Vector
    visible: float


@dataclass(frozen=True)
class PastRelated:
    """A relation that an object has or had, and at the end of which recordings of the scene."""

    kind: RelationKind
    to: int | str
    first_recording: int
    last_recording: int
    score: float


@dataclass(frozen=True)
class History:
    """The history of a label.

    Attributes
    ----------
    label : int
        The label now: that which it was merged into, where it was.
    merged_labels : tuple of int
    count : int
        Sightings.
    sightings : tuple of SightingAnswer
        At most as many as were asked for: the first, the last, and those between at equal steps.
    relations : tuple of PastRelated
        Of a scene whose recordings were tracked with relations.
    """

    label: int
    merged_labels: tuple[int, ...]
    count: int
    sightings: tuple[SightingAnswer, ...]
    relations: tuple[PastRelated, ...]


@dataclass(frozen=True)
class TreeNode:
    """A surface or an object with what is on it and in it: `cuboid.relations.Branch` with names."""

    of: int | str
    name: str | None
    kind: str
    height_m: float | None
    children: tuple[TreeNode, ...]


@dataclass(frozen=True)
class MapChange:
    """A change of the map.

    Attributes
    ----------
    number : int
        From 1, in order.
    change : {"confirmed", "moved", "gone", "renamed", "merged", "appeared", "back"}
        The last two are events of the run itself.
    label : int
    name : str or None
    from_m, to_m : (3,) or None
        Middle of its box before and after.
    into : int or None
        The label that it was merged into.
    """

    number: int
    change: ChangeName
    label: int
    name: str | None = None
    from_m: Vector | None = None
    to_m: Vector | None = None
    into: int | None = None


@dataclass(frozen=True)
class About:
    """A place at this moment.

    Attributes
    ----------
    title : str
    kind : {"results", "scene", "run"}
    objects : int
    up : (3,) or None
    changes : int
        Number of the last change.
    running : bool
        Whether a run goes on.
    """

    title: str
    kind: Literal["results", "scene", "run"]
    objects: int
    up: Vector | None
    changes: int
    running: bool
