"""An object without depth readings, and its box; see `unread`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cuboid.ground.core.frame import Float64Array
from cuboid.ground.core.state import ADDED
from cuboid.ground.geometry.box import Box
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS
from cuboid.method.objects.naming import merged_evidence

# From this fraction of readings in its rectangle on, an object counts as seen by depth.
READ_FRACTION = 0.5
# Hits required for a label: two may come from a reflection.
MIN_HITS = 3
# An object lies flat on a plane if its centre is at most this high above it, and then has this thickness, metres.
FLAT_M, THIN_M = 0.05, 0.02
# Smallest sine of the angle from which a flat object is seen: at grazing angles its rectangle does not show its
# extent.
MIN_SINE = 0.2
# Shortest side, metres.
MIN_SIDE_M = 0.01
# Standard deviation of the sides of a detector's rectangle, as a fraction of them: small detectors' are off by a tenth.
SIDE = 0.1
# A rectangle does not show the rotation of an object about up: its width may be that of a side half as long. Standard
# deviation of a side that is uniformly distributed between the two, as a fraction of the width.
TURNED = 0.5 / 3**0.5
# A flat object is up to twice `FLAT_M` thick. Root mean square difference of `THIN_M` from a thickness that is
# uniformly distributed up to there.
THICKNESS_M = ((FLAT_M - THIN_M) ** 2 + (2.0 * FLAT_M) ** 2 / 12.0) ** 0.5
# The side away from the camera is a guess; its standard deviation is this fraction of it.
GUESSED = 0.5


@dataclass(slots=True, eq=False)
class UnreadObject:
    """An object that a detector sees and depth does not, with or without a label.

    Attributes
    ----------
    number : int
        Number from 1; never reused.
    first_frame, last_frame, frames_seen : int
    information : (3, 3) float64
        Inverse covariance of its position.
    vector : (3,) float64
        Information matrix times position.
    size_m : (2,) float64
        Width and height across the line of sight, metres.
    weight : float
        Sum of the weights of the sightings in `size_m`.
    size_scatter_m2 : (2,) float64
        Weighted variance of the sizes of the sightings.
    distance_m : float
        Weighted mean distance of the camera at the sightings.
    label : int
        Label, 0 until confirmed.
    hits : int
        Number of its detections.
    log_odds : float
        Log-odds that it exists.
    read : float
        Mean fraction of its rectangles with depth readings.
    keyframe : int
        Keyframe to which the last hit is anchored.
    meetings : dict of int to int
        Number of frames in which it had the rectangle of an object of the map, by that object's number.
    partner : int
        Number of the object of the map into which it was merged; 0: none.
    merged_labels : list of int
        Labels of other objects that were merged into it.
    name_log_odds, views :
        As in `MapObject`.
    """

    number: int
    first_frame: int
    last_frame: int
    information: Float64Array
    vector: Float64Array
    size_m: Float64Array = field(default_factory=lambda: np.zeros(2))
    weight: float = 0.0
    frames_seen: int = 0
    label: int = 0
    hits: int = 0
    log_odds: float = 0.0
    read: float = 0.0
    keyframe: int = 0
    meetings: dict[int, int] = field(default_factory=dict)
    partner: int = 0
    merged_labels: list[int] = field(default_factory=list)
    name_log_odds: dict[str, float] = field(default_factory=dict)
    views: Float64Array = field(default_factory=lambda: np.zeros((0, 4)))
    size_scatter_m2: Float64Array = field(default_factory=lambda: np.zeros(2), metadata=ADDED)
    distance_m: float = field(default_factory=float, metadata=ADDED)

    @property
    def center(self) -> Float64Array:
        """Its centre in the map, (3,) metres."""
        return np.asarray(np.linalg.solve(self.information, self.vector))

    @property
    def score(self) -> float:
        """Confidence that it exists, 0..1."""
        return float(1.0 / (1.0 + np.exp(-self.log_odds)))

    def add_size(self, size_m: Float64Array, distance_m: float, weight: float) -> None:
        """Add the size (2,) of a sighting from a distance to the mean, metres."""
        self.weight += weight
        part = weight / self.weight
        off_m = size_m - self.size_m
        self.size_m = self.size_m + off_m * weight / self.weight
        self.size_scatter_m2 = (1.0 - part) * (self.size_scatter_m2 + part * off_m**2)
        self.distance_m += part * (distance_m - self.distance_m)

    @property
    def is_sure(self) -> bool:
        """Whether it certainly exists and depth does not show it."""
        return self.log_odds >= CERTAIN_LOG_ODDS and self.hits >= MIN_HITS and self.read < READ_FRACTION


@dataclass(frozen=True, slots=True)
class Planes:
    """Up direction and supporting planes, in the map.

    Attributes
    ----------
    up : (3,) float64
    supporting : sequence of ((3,) float64, float)
        Normal and offset of each plane: normal.p + offset = 0.
    """

    up: Float64Array
    supporting: Sequence[tuple[Float64Array, float]]


def box_of(unread: UnreadObject, planes: Planes) -> tuple[Box, str]:
    """Return the box of an object and its kind: "flat" on a plane, otherwise a "box" that faces its viewers.

    Parameters
    ----------
    unread : UnreadObject
    planes : Planes
    """
    center, (width, height) = unread.center, np.maximum(unread.size_m, MIN_SIDE_M).tolist()
    toward = _toward(unread, planes)
    across = _across(toward, planes)
    rotation = np.column_stack([across, np.cross(planes.up, across), planes.up])
    above_m = [float(normal @ center + offset) for normal, offset in planes.supporting]
    if any(0.0 <= away <= FLAT_M for away in above_m):
        sine = max(float(toward @ planes.up), MIN_SINE)
        reach = max((height - THIN_M * (1.0 - sine)) / sine, MIN_SIDE_M)
        return Box(center, np.array([width, reach, THIN_M]), rotation), "flat"
    return Box(center, np.array([width, min(width, height), height]), rotation), "box"


def size_sigma_of(unread: UnreadObject, planes: Planes, kind: str) -> Float64Array:
    """Return the standard deviations (3,) of the sides of the box of an object, metres.

    Those of width and height follow from the scatter of the rectangles, from the error of a rectangle that all frames
    share, and from the uncertainty of the triangulated distance. Two quantities that a rectangle does not show are
    added: the rotation of the object, and its extent away from the camera.

    Parameters
    ----------
    unread : UnreadObject
    planes : Planes
    kind : str
        The kind from `box_of`.
    """
    sides = np.maximum(unread.size_m, MIN_SIDE_M)
    width, height = sides.tolist()
    toward = _toward(unread, planes)
    covariance = np.linalg.inv(unread.information)
    along_m = float(np.sqrt(toward @ covariance @ toward))
    relative = np.hypot(SIDE, along_m / max(unread.distance_m, along_m))
    seen = np.sqrt(unread.size_scatter_m2 + (relative * sides) ** 2)
    wide = float(np.hypot(seen[0], TURNED * width))
    sine = max(float(toward @ planes.up), 0.0)
    cosine = float(np.sqrt(max(0.0, 1.0 - sine**2)))
    if kind == "flat":
        # Its thickness is twice the height of its middle above the plane.
        thick = float(np.hypot(THICKNESS_M, 2.0 * np.sqrt(planes.up @ covariance @ planes.up)))
        reach = np.array([seen[1], TURNED * height, thick * cosine]) / max(sine, MIN_SINE)
        return np.array([wide, float(np.linalg.norm(reach)), thick])
    cosine, deep = max(cosine, MIN_SINE), min(width, height)
    # The height of the rectangle is between that of an object without depth and that of one as deep as the box.
    shown = max(abs(height / cosine - height), abs(height - (height - deep * sine) / cosine)) / 3**0.5
    return np.array([wide, GUESSED * deep, float(np.hypot(seen[1], shown))])


def absorb(kept: UnreadObject, gone: UnreadObject, planes: Planes) -> None:
    """Merge an object into another one; the rectangle of the result holds both, seen from the mean direction."""
    toward = _toward(kept, planes) + _toward(gone, planes)
    toward = toward / max(float(np.linalg.norm(toward)), 1e-9)
    across = _across(toward, planes)
    axes = np.array([across, np.cross(toward, across)])
    information = kept.information + gone.information
    center = np.linalg.solve(information, kept.vector + gone.vector)
    half_m = np.array([unread.size_m / 2.0 for unread in (kept, gone)])
    middle_m = np.array([axes @ unread.center for unread in (kept, gone)])
    low_m, high_m = (middle_m - half_m).min(axis=0), (middle_m + half_m).max(axis=0)
    center = center + ((low_m + high_m) / 2.0 - axes @ center) @ axes
    kept.information, kept.vector = information, information @ center
    kept.size_m = high_m - low_m
    kept.size_scatter_m2 = np.maximum(kept.size_scatter_m2, gone.size_scatter_m2)
    whole = max(kept.weight + gone.weight, 1e-9)
    kept.distance_m = (kept.weight * kept.distance_m + gone.weight * gone.distance_m) / whole
    kept.weight = max(kept.weight, gone.weight)
    kept.read = (kept.hits * kept.read + gone.hits * gone.read) / max(kept.hits + gone.hits, 1)
    kept.log_odds, kept.hits = max(kept.log_odds, gone.log_odds), max(kept.hits, gone.hits)
    kept.first_frame, kept.last_frame = min(kept.first_frame, gone.first_frame), max(kept.last_frame, gone.last_frame)
    kept.frames_seen = max(kept.frames_seen, gone.frames_seen)
    kept.name_log_odds = merged_evidence(kept.name_log_odds, gone.name_log_odds)
    kept.views = np.vstack([kept.views, gone.views])


def _across(toward: Float64Array, planes: Planes) -> Float64Array:
    """Return the horizontal direction (3,) across a line of sight; any horizontal one for a line from above."""
    across = np.cross(planes.up, toward)
    if np.linalg.norm(across) < 1e-3:
        across = np.cross(planes.up, np.eye(3)[int(np.abs(planes.up).argmin())])
    return np.asarray(across / np.linalg.norm(across))


def _toward(unread: UnreadObject, planes: Planes) -> Float64Array:
    """Return the mean direction (3,) from an object to the cameras that saw it; up if none is known."""
    toward = unread.views[:, :3].sum(axis=0) if len(unread.views) else planes.up
    return np.asarray(toward / max(float(np.linalg.norm(toward)), 1e-9))
