"""Typed answers of a place: plain data in metres, seconds and the world, the same over HTTP, MCP and in Python.

The classes have no slots: the SDK of MCP takes their schemas from the attributes of the class.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from cuboid.ground.core.values import LaterStatus, ObjectStatus, RelationKind, SideName
from cuboid.method.relations import SurfaceKind

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
ChangeName = Literal["confirmed", "moved", "gone", "renamed", "merged", "appeared", "back"]


@dataclass(frozen=True)
class Seen:
    """The frame and the time at which an object was seen, and the camera that saw it.

    Attributes
    ----------
    frame : int
        Frame of the recording.
    recording : int or None
        Number of the recording in a scene, from 1; None without a scene.
    time : str or None
        UTC, ISO 8601; None if the recording has no calendar times.
    camera : str or None
        Name of the recording, or of the live camera.
    camera_m : (3,) or None
        Position of the camera in the world; None if it is not known.
    distance_m : float or None
        Distance of the camera from the centre of the box, metres.
    """

    frame: int
    recording: int | None = None
    time: str | None = None
    camera: str | None = None
    camera_m: Vector | None = None
    distance_m: float | None = None


@dataclass(frozen=True)
class Later:
    """What is known of an object after its last sighting.

    Attributes
    ----------
    state : {"there", "gone", "not looked at", "not seen"}
        "there": the last frame saw it. "gone": its place was seen empty. "not looked at": no later frame has the place
        of the whole object in view. "not seen": a later frame has, but did not see it: it is hidden, or not recognised.
    at : Seen or None
        For "gone" and "not seen" the first such frame.
    """

    state: LaterStatus
    at: Seen | None = None


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
    state : {"present", "unlikely", "gone", "merged", "forgotten"}
    kind : str
        "volume"; "flat" or "box" for objects without depth readings.
    classes : tuple of (str, float)
        The next most likely classes from a detector, with their probabilities.
    score, probability : float
        Probability that it is one whole object, 0..1: both have the same value.
    center_m, size_m : (3,)
        Centre of its box in the world, and length, width and height along the axes of the box, metres.
    quat_wxyz : (4,)
        Rotation from the axes of the box to the world.
    color : str or None
        The color word of most of its points.
    colors : tuple of str
        The color words of at least 30 % of its points, the most frequent first.
    plane : int or None
        Index of the plane that supports it.
    first_seen, last_seen : Seen
    later : Later or None
        What is known since then; None while a run goes on.
    size_sigma_m, center_sigma_m : (3,) or None
        Standard deviations of `size_m`, and of `center_m` along the axes of the world, metres; None if unknown.
    sides_seen : tuple of str or None
        Sides of the box that a camera saw as faces, by axis of the box: "+z" is the top; None if unknown.
    frames_seen : int
    distance_m : float or None
        Distance from the place or object of the query, metres; None if the query has none.
    text_score : float or None
        Cosine of the angle between the vectors of a text and of the object's pictures, -1..1; None without a text.
    relations : tuple of Related or None
        None if the query does not request them.
    """

    label: int
    name: str | None
    state: ObjectStatus
    kind: str
    classes: tuple[tuple[str, float], ...]
    score: float
    probability: float
    center_m: Vector
    size_m: Vector
    quat_wxyz: Quaternion
    color: str | None
    colors: tuple[str, ...]
    plane: int | None
    first_seen: Seen
    last_seen: Seen
    frames_seen: int
    distance_m: float | None = None
    text_score: float | None = None
    relations: tuple[Related, ...] | None = None
    later: Later | None = None
    size_sigma_m: Vector | None = None
    center_sigma_m: Vector | None = None
    sides_seen: tuple[SideName, ...] | None = None


@dataclass(frozen=True)
class Answer:
    """The answer to a question in English.

    Attributes
    ----------
    understood : tuple of str
        The conditions of the question, in words.
    objects : tuple of FoundObject
    note : str or None
        Why there are none, if a name is not known.
    """

    understood: tuple[str, ...]
    objects: tuple[FoundObject, ...]
    note: str | None = None


@dataclass(frozen=True)
class Surface:
    """A supporting plane.

    Attributes
    ----------
    surface : str
        "plane:k".
    center_m : (3,)
        Centre of its seen part.
    normal : (3,)
        Unit vector, up.
    height_m : float
        Height above the lowest surface.
    area_m2 : float
        Area of its seen part.
    objects : tuple of int
        Labels of the objects with the relation "on" to it.
    furniture : int or None
        Label of the furniture that bears it, if the run looked for furniture: `on` takes it as well.
    name : str or None
        Name that a user gave to the furniture.
    kind : {"floor", "table"} or None
        `on` takes these words as well.
    """

    surface: str
    center_m: Vector
    normal: Vector
    height_m: float
    area_m2: float
    objects: tuple[int, ...]
    furniture: int | None = None
    name: str | None = None
    kind: SurfaceKind | None = None


@dataclass(frozen=True)
class FreePlace:
    """The nearest free place on a surface.

    Attributes
    ----------
    surface : str
    center_m : (3,)
        Centre of the footprint, on the surface.
    along : (3,)
        Direction of the length, a unit vector.
    length_m, width_m : float
    distance_m : float
        Distance from the wanted place.
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
    """A present or past relation of an object, and the recordings of the scene at whose end it held."""

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
        The present label: if the object was merged, the label of the merged object.
    merged_labels : tuple of int
    count : int
        Number of sightings.
    sightings : tuple of SightingAnswer
        At most the requested number: the first, the last, and equally spaced ones between them.
    relations : tuple of PastRelated
        Only in a scene whose recordings were tracked with relations.
    """

    label: int
    merged_labels: tuple[int, ...]
    count: int
    sightings: tuple[SightingAnswer, ...]
    relations: tuple[PastRelated, ...]


@dataclass(frozen=True)
class TreeNode:
    """A surface or an object, with the objects on it and in it: `cuboid.method.relations.Branch` with names.

    The name of a surface is that of the furniture that bears it.
    """

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
        Number of the change, in order from 1.
    change : {"confirmed", "moved", "gone", "renamed", "merged", "appeared", "back"}
        "appeared" and "back" are events that the run reports.
    label : int
    name : str or None
    from_m, to_m : (3,) or None
        Centre of its box before and after the change.
    into : int or None
        The label into which it was merged.
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
        Whether the run is active.
    """

    title: str
    kind: Literal["results", "scene", "run"]
    objects: int
    up: Vector | None
    changes: int
    running: bool
