"""What a scene answers when it is asked: its recordings, its objects, and their sightings."""

from __future__ import annotations

from dataclasses import dataclass

from cuboid.frame import Float64Array
from cuboid.geometry.box import Box


@dataclass(frozen=True, slots=True)
class SceneObject:
    """An object of a scene.

    Attributes
    ----------
    label : int
    name : str
        What people call it; empty where nobody gave it a name.
    state : str
        "present", "gone", "merged" or "forgotten".
    merged_into : int or None
        The label that it lives on under, where it was merged.
    box : Box
        In the scene's world, as known last.
    score : float
        Confidence that it is an object, 0..1.
    heat : float
        Mean heat of its points, 0..1.
    points : int
        Voxels that its box was fitted to.
    mean_color : (3,) float64
        RGB, 0..255.
    first_seen, last_seen : (int, int)
        Recording and frame of it.
    frames_seen : int
    """

    label: int
    name: str
    state: str
    merged_into: int | None
    box: Box
    score: float
    heat: float
    points: int
    mean_color: Float64Array
    first_seen: tuple[int, int]
    last_seen: tuple[int, int]
    frames_seen: int


@dataclass(frozen=True, slots=True)
class SceneRecording:
    """A recording that went into a scene.

    Attributes
    ----------
    number : int
        From 1.
    path, format, poses : str
    begun : str
        When tracking it began, UTC, ISO 8601.
    complete : bool
        False where the run was broken off.
    frames : int
        How many it has.
    frames_used : int
        Of these, so many have a pose.
    """

    number: int
    path: str
    format: str
    poses: str
    begun: str
    complete: bool
    frames: int
    frames_used: int


@dataclass(frozen=True, slots=True)
class ScenePast:
    """A sighting of an object.

    Attributes
    ----------
    label : int
        That it had then.
    recording, frame : int
    time_s : float
        Of the frame, as the recording tells it.
    box : Box
        In the scene's world, as known then.
    iou : float or None
        Overlap of the frame's own box with it; None where the frame has none.
    visible : float
        Fraction of its near side that was seen, 0..1.
    rect_xyxy : (4,) float64
        Pixels of the image.
    """

    label: int
    recording: int
    frame: int
    time_s: float
    box: Box
    iou: float | None
    visible: float
    rect_xyxy: Float64Array
