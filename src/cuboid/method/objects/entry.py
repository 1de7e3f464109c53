"""An object in the map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.frame import Float64Array
from cuboid.ground.core.state import ADDED, TRANSIENT, Record
from cuboid.ground.geometry.box import Box
from cuboid.method.surfaces.kernels.outlines import KINDS


class State(Enum):
    """Stage of an object's life."""

    CANDIDATE = "candidate"
    CONFIRMED = "confirmed"
    RETIRED = "retired"


@dataclass(slots=True, eq=False)
class MapObject(Record):
    """An object of the map, confirmed (with a label) or not.

    Values of attributes are replaced, never changed in place; this includes arrays, dicts and lists.

    Attributes
    ----------
    number : int
        Owner number in the voxel map, from 1; never reused.
    box : Box
    state : State
        "candidate", "confirmed" or "retired".
    label : int
        Label, 0 until confirmed.
    keyframe : int
        Keyframe to which most of its points are anchored; -1 (unknown) after a frame has fused new points.
    plane : int or None
        Identity of its supporting plane.
    points : (N, 3) float32
        Positions of its voxels in the world at the last fit.
    colors : (N, 3) uint8
        Their colors.
    heat : float
        Mean heat of its voxels.
    first_frame : int
        First frame that saw it.
    last_frame : int
        Last frame that saw it.
    frames_seen : int
        Frames that saw it.
    sightings : int
        Number of frames whose proposals it matched.
    log_odds : float
        Evidence that it is an object, from its sightings so far.
    outline : (4, KINDS) float64
        Kinds of its boundary in its sightings, by side and kind; see `kernels.outlines.outlines`.
    supports : dict of int to int
        Number of its pixels seen above each plane, by the identity of the plane.
    merged_labels : list of int
        Labels of objects that were merged into it.
    fitted : int
        Number of sightings at the last fit of its box.
    supports_plane : bool
        Whether it supported its plane at the last fit, as furniture does.
    holder : int
        Number of the object that it is attached to, if nothing supported it from below at the last fit; 0: none.
    name_log_odds : dict of str to float
        Evidence for each class from a detector, by name; see `naming`. Empty without a detector.
    views : (V, 4) float64
        Directions from which a detector saw it (unit vectors), with the number of times for each.
    moved : bool
        Whether it was seen to move by itself.
    taken_by : MapObject or None
        The object into which it was merged.
    """

    number: int
    box: Box
    first_frame: int
    last_frame: int
    state: State = State.CANDIDATE
    label: int = 0
    keyframe: int = -1
    plane: int | None = None
    points: npt.NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    colors: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    heat: float = 0.0
    frames_seen: int = 0
    sightings: int = 0
    log_odds: float = 0.0
    outline: Float64Array = field(default_factory=lambda: np.zeros((4, KINDS)))
    supports: dict[int, int] = field(default_factory=dict)
    merged_labels: list[int] = field(default_factory=list)
    fitted: int = 0
    supports_plane: bool = False
    holder: int = 0
    name_log_odds: dict[str, float] = field(default_factory=dict, metadata=ADDED)
    views: Float64Array = field(default_factory=lambda: np.zeros((0, 4)), metadata=ADDED)
    moved: bool = field(default_factory=bool, metadata=ADDED)
    taken_by: MapObject | None = field(default=None, metadata=TRANSIENT)

    @property
    def survivor(self) -> MapObject:
        """The object into which it was merged, transitively; the object itself if it was not merged."""
        entry = self
        while entry.taken_by is not None:
            entry = entry.taken_by
        return entry

    @property
    def confirmed(self) -> bool:
        """Whether it has a label and is not retired."""
        return self.state is State.CONFIRMED

    @property
    def center(self) -> Float64Array:
        """Centre of its box, (3,) metres."""
        return self.box.center

    @property
    def mean_color(self) -> Float64Array:
        """RGB, 0..255."""
        return self.colors.mean(0) if len(self.colors) else np.zeros(3)

    @property
    def score(self) -> float:
        """Confidence that it is an object, 0..1."""
        return float(1.0 / (1.0 + np.exp(-self.log_odds)))


def summed_counts(first: Mapping[int, int], second: Mapping[int, int]) -> dict[int, int]:
    """Return the sums of two counts by key."""
    return {**first, **{key: first.get(key, 0) + count for key, count in second.items()}}
