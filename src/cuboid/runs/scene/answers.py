"""Queries of a scene: its recordings, its objects, and their sightings."""

from __future__ import annotations

from dataclasses import dataclass

from cuboid.ground.core.results import ObjectEvent, Sighting, TrackedObject, tag_of
from cuboid.ground.core.values import ObjectStatus, RelationKind


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class SceneObject(TrackedObject):
    """An object of a scene.

    The other attributes are those of `TrackedObject`. The box is the latest one, in the scene's world; `first_frame`
    and `last_frame` count the frames of all recordings; `points` are the voxels that the box was fitted to.

    Attributes
    ----------
    state : str
        "present", "gone", "merged" or "forgotten"; "unlikely": its probability is below `min_probability`.
    merged_into : int or None
        Older label into which this one was merged.
    first_seen, last_seen : (int, int)
        Number of the recording, and index of the frame in that recording.
    """

    state: ObjectStatus
    merged_into: int | None
    first_seen: tuple[int, int]
    last_seen: tuple[int, int]


@dataclass(frozen=True, slots=True)
class SceneRecording:
    """A recording that was added to a scene.

    Attributes
    ----------
    number : int
        Number of the recording, from 1.
    path, format, poses : str
    begun : str
        Time at which tracking began, UTC, ISO 8601.
    complete : bool
        False if the run was interrupted.
    frames : int
        Number of frames in the recording.
    frames_used : int
        Number of frames with a pose.
    """

    number: int
    path: str
    format: str
    poses: str
    begun: str
    complete: bool
    frames: int
    frames_used: int


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ScenePast(Sighting):
    """A sighting of an object of a scene.

    The other attributes are those of `Sighting`; label and box are those at that time, the box in the scene's world.

    Attributes
    ----------
    recording, frame : int
    time_s : float
        Time of the frame in the recording.
    """

    recording: int
    frame: int
    time_s: float

    def __repr__(self) -> str:
        where = f"recording {self.recording}, frame {self.frame}"
        return f"ScenePast({where}, {tag_of(self.label)}: {self.box.text()}; {self.visible:.0%} visible)"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class SceneEvent(ObjectEvent):
    """An event of an object in view of a recording: it appeared, moved, is gone or is back.

    The other attributes are those of `ObjectEvent`; the label is the one at that time.

    Attributes
    ----------
    recording, frame : int
        The frame that reported it.
    time_s : float
        Time of the frame in the recording.
    """

    recording: int
    frame: int
    time_s: float

    def __repr__(self) -> str:
        where = f"recording {self.recording}, frame {self.frame}"
        return f"SceneEvent({where}, {tag_of(self.label)}: {self.event}; score {self.score:.2f})"


@dataclass(frozen=True, slots=True)
class PastRelation:
    """A present or past relation of an object of a scene, with the recordings that showed it.

    Attributes
    ----------
    label : int
        Label of the object at that time.
    kind : {"on", "in", "beside", "under", "against", "supports"}
    to : int or str
        Present label of the other object; "plane:k" for the supporting plane k of the scene, "plane" for one that
        is no longer known, "wall" for a wall.
    first_recording, last_recording : int
        It held at the end of these, and of each recording between them whose relations were stored.
    score : float
        Probability, 0..1, at the end of the last one.
    """

    label: int
    kind: RelationKind
    to: int | str
    first_recording: int
    last_recording: int
    score: float

    def __repr__(self) -> str:
        to = self.to if isinstance(self.to, str) else tag_of(self.to)
        when = f"recordings {self.first_recording} to {self.last_recording}"
        return f"PastRelation({tag_of(self.label)} {self.kind} {to}, {when}; score {self.score:.2f})"
