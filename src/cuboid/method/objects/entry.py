"""The record of an object: with depth, or without depth from the rectangles of a detector.

Attributes are assigned only by the modules of `objects.store`; all other code reads. Values of attributes are replaced,
never changed in place; this includes arrays, dicts and lists.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from enum import Enum

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.state import TRANSIENT, Record
from cuboid.ground.geometry.box import Box
from cuboid.method.surfaces.kernels.outlines import KINDS

# Weight of a view without the object, before all others: one view is not certain.
PRIOR_LOOK = 0.5
# Two views show different sides of an object if their directions differ by this, radians: ten degrees.
NEW_DIRECTION_RAD = 0.175


class State(Enum):
    """Stage of an object's life."""

    CANDIDATE = "candidate"
    CONFIRMED = "confirmed"
    RETIRED = "retired"


@dataclass(slots=True, eq=False)
class ObjectRecord(Record):
    """The part of the record that all objects have: identity, label, evidence.

    Attributes
    ----------
    number : int
        Number from 1, never reused; objects with and without depth are numbered separately.
    first_frame : int
        First frame that saw it.
    last_frame : int
        Last frame that saw it.
    state : State
        "candidate", "confirmed" or "retired".
    label : int
        Label, 0 until confirmed.
    keyframe : int
        Keyframe to which most of its points, or its last detection, are anchored; -1: unknown.
    frames_seen : int
        Frames that saw it.
    merged_labels : list of int
        Labels of objects that were merged into it.
    name_log_odds : dict of str to float
        Evidence for each class from a detector, by name; see `naming`. Empty without a detector.
    views : (V, 4) float64
        Directions from which a detector saw it (unit vectors), with the number of times for each.
    """

    number: int
    first_frame: int
    last_frame: int
    _: KW_ONLY
    state: State = State.CANDIDATE
    label: int = 0
    keyframe: int = -1
    frames_seen: int = 0
    merged_labels: list[int] = field(default_factory=list)
    name_log_odds: dict[str, float] = field(default_factory=dict)
    views: Float64Array = field(default_factory=lambda: np.zeros((0, 4)))

    @property
    def confirmed(self) -> bool:
        """Whether it has a label and is not retired."""
        return self.state is State.CONFIRMED

    @property
    def score(self) -> float:
        """Probability that it is an object, 0..1."""
        raise NotImplementedError

    def is_reported(self, min_probability: float) -> bool:
        """Return whether results contain it: it has a label, is not retired, and has at least this probability."""
        return self.confirmed and self.score >= min_probability

    @property
    def center(self) -> Float64Array:
        """Its centre in the map, (3,) metres."""
        raise NotImplementedError


@dataclass(slots=True, eq=False)
class MapObject(ObjectRecord):
    """An object of the map, confirmed (with a label) or not.

    Its number is the owner number in the voxel map.

    Attributes
    ----------
    box : Box
    plane : int or None
        Identity of its supporting plane.
    points : (N, 3) float32
        Positions of its voxels in the world at the last fit.
    colors : (N, 3) uint8
        Their colors.
    heat : float
        Mean heat of its voxels.
    probability : float
        Probability that it is one whole thing, 0..1; see `objectness`.
    sightings : float
        Weight of the frames whose proposals it matched; see `weight_of`.
    shown : float
        Weight of the frames with pixels of it.
    missed : float
        Weight of the frames in a row with pixels of it, or of its place, whose proposals it did not match.
    agreement : float
        Sum of the similarities of its segments, each with the weight of its frame.
    compared : float
        Weight of the frames in that sum: all but the first one with the object.
    whole_log_odds : float
        Sum of the log-odds that its segments show one whole thing, by the fitted score of regions, weighted.
    scored : float
        Weight of these log-odds.
    largest_px : int
        Working pixels of its largest segment.
    directions : (D, 3) float32
        Unit vectors, different by `NEW_DIRECTION_RAD` or more, along which cameras saw it.
    outline : (4, KINDS) float64
        Kinds of its boundary in its sightings, by side and kind; see `kernels.outlines.outlines`.
    supports : dict of int to int
        Number of its pixels seen above each plane, by the identity of the plane.
    fitted : float
        Weight of the sightings at the last fit of its box.
    supports_plane : bool
        Whether it supported its plane at the last fit, as furniture does.
    continuing : int
        Number of its sides that continued into a surface outside all objects at the last fit.
    filled : float
        Area of its points over the area of its box at the last fit.
    noise_m : float
        Standard deviation of its points at the last fit, metres.
    sides_m : (V, 4) float64
        Its length and width, and their standard deviations, metres, in the most exact of the views that showed edges
        of its top; NaN where one of both was not clear; see `measured_sides`.
    measured : float
        Weight of the sightings when the edges of its top were last looked for.
    holder : int
        Number of the object that it is attached to, if nothing supported it from below at the last fit; 0: none.
    moved : bool
        Whether it was seen to move by itself.
    replaced : bool
        Whether an object of regions with its pixels is reported in its place; see `by_regions`.
    doubt : float
        Log-odds that it is not in its place, from the frames since it was last seen there; see `presence.doubts`.
    merged_into : MapObject or None
        The object into which it was merged.
    """

    box: Box
    _: KW_ONLY
    plane: int | None = None
    points: npt.NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    colors: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    heat: float = 0.0
    probability: float = 0.0
    sightings: float = 0.0
    shown: float = 0.0
    missed: float = 0.0
    agreement: float = 0.0
    compared: float = 0.0
    whole_log_odds: float = 0.0
    scored: float = 0.0
    largest_px: int = 0
    directions: npt.NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    outline: Float64Array = field(default_factory=lambda: np.zeros((4, KINDS)))
    supports: dict[int, int] = field(default_factory=dict)
    fitted: float = 0.0
    supports_plane: bool = False
    continuing: int = 0
    filled: float = 0.0
    noise_m: float = 0.0
    sides_m: Float64Array = field(default_factory=lambda: np.zeros((0, 4)))
    measured: float = 0.0
    holder: int = 0
    moved: bool = False
    doubt: float = 0.0
    replaced: bool = False
    merged_into: MapObject | None = field(default=None, metadata=TRANSIENT)

    @property
    def survivor(self) -> MapObject:
        """The object into which it was merged, transitively; the object itself if it was not merged."""
        entry = self
        while entry.merged_into is not None:
            entry = entry.merged_into
        return entry

    def is_reported(self, min_probability: float) -> bool:
        """Return whether results contain it; those of a replaced object contain the object of regions."""
        return not self.replaced and ObjectRecord.is_reported(self, min_probability)

    @property
    def score(self) -> float:
        """Probability that it is one whole thing, 0..1."""
        return self.probability

    @property
    def center(self) -> Float64Array:
        """Centre of its box, (3,) metres."""
        return self.box.center

    @property
    def mean_color(self) -> Float64Array:
        """RGB, 0..255."""
        return self.colors.mean(0) if len(self.colors) else np.zeros(3)


@dataclass(slots=True, eq=False)
class ObjectWithoutDepth(ObjectRecord):
    """An object that a detector or regions of color show and depth does not, with or without a label.

    Attributes
    ----------
    information : (3, 3) float64
        Inverse covariance of its position.
    log_odds : float
        Evidence that it exists, from its detections so far.
    vector : (3,) float64
        Information matrix times position.
    size_m : (2,) float64
        Width and height across the line of sight, metres.
    weight : float
        Sum of the weights of the sightings in `size_m`.
    hits : int
        Number of its detections.
    read : float
        Mean fraction of its rectangles with depth readings.
    meetings : dict of int to int
        Number of frames in which it had the rectangle of an object of the map, by that object's number.
    partner : int
        Number of the object of the map that it is, 0: none.
    size_scatter_m2 : (2,) float64
        Weighted variance of the sizes of the sightings.
    distance_m : float
        Weighted mean distance of the camera at the sightings.
    by_regions : bool
        Whether regions of color and depth show it, and not a detector; see `by_regions`.
    looks, regions : float
        Weight of the views of its place, and sum of the probabilities of its regions, times the weights.
    rivals : tuple of int
        Numbers of the labelled objects of the map that owned pixels of its last region.
    seen_box : Box or None
        Box of the readings of its most probable region.
    likeliest : float
        Probability of that region.
    """

    information: Float64Array
    vector: Float64Array
    _: KW_ONLY
    log_odds: float = 0.0
    size_m: Float64Array = field(default_factory=lambda: np.zeros(2))
    weight: float = 0.0
    hits: int = 0
    read: float = 0.0
    meetings: dict[int, int] = field(default_factory=dict)
    partner: int = 0
    size_scatter_m2: Float64Array = field(default_factory=lambda: np.zeros(2))
    distance_m: float = 0.0
    by_regions: bool = False
    looks: float = 0.0
    regions: float = 0.0
    rivals: tuple[int, ...] = ()
    seen_box: Box | None = None
    likeliest: float = 0.0

    @property
    def score(self) -> float:
        """Probability that it exists, 0..1."""
        if self.by_regions:
            return self.regions / (self.looks + PRIOR_LOOK)
        return float(1.0 / (1.0 + np.exp(-self.log_odds)))

    @property
    def center(self) -> Float64Array:
        """Its centre in the map, (3,) metres."""
        return np.asarray(np.linalg.solve(self.information, self.vector))


def with_direction(directions: npt.NDArray[np.float32], ray: Float64Array) -> npt.NDArray[np.float32]:
    """Return directions of view (D, 3) with that of a ray (3,) added, if it differs from all of them."""
    length = float(np.sqrt(ray @ ray))
    direction = (ray / max(length, 1e-9)).astype(np.float32)
    if len(directions) and float((directions @ direction).max()) > np.cos(NEW_DIRECTION_RAD):
        return directions
    return np.vstack([directions, direction[None]])


def summed_counts(first: Mapping[int, int], second: Mapping[int, int]) -> dict[int, int]:
    """Return the sums of two counts by key."""
    return {**first, **{key: first.get(key, 0) + count for key, count in second.items()}}
