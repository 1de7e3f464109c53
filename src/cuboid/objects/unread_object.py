"""An object without depth readings, and its box; see `unread`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cuboid.core.frame import Float64Array
from cuboid.geometry.box import Box
from cuboid.objects.affinity import CERTAIN_LOG_ODDS

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

    @property
    def center(self) -> Float64Array:
        """Its centre in the map, (3,) metres."""
        return np.asarray(np.linalg.solve(self.information, self.vector))

    @property
    def score(self) -> float:
        """Confidence that it exists, 0..1."""
        return float(1.0 / (1.0 + np.exp(-self.log_odds)))

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


def box_of(one: UnreadObject, planes: Planes) -> tuple[Box, str]:
    """Return the box of an object and its kind: "flat" on a plane, otherwise a "box" that faces its viewers.

    Parameters
    ----------
    one : UnreadObject
    planes : Planes
    """
    center, (width, height) = one.center, np.maximum(one.size_m, MIN_SIDE_M).tolist()
    toward = one.views[:, :3].sum(axis=0) if len(one.views) else planes.up
    toward = toward / max(float(np.linalg.norm(toward)), 1e-9)
    across = np.cross(planes.up, toward)
    if np.linalg.norm(across) < 1e-3:  # seen from above: use any horizontal direction
        across = np.cross(planes.up, np.eye(3)[int(np.abs(planes.up).argmin())])
    across = across / np.linalg.norm(across)
    rotation = np.column_stack([across, np.cross(planes.up, across), planes.up])
    above_m = [float(normal @ center + offset) for normal, offset in planes.supporting]
    if any(0.0 <= away <= FLAT_M for away in above_m):
        sine = max(float(toward @ planes.up), MIN_SINE)
        reach = max((height - THIN_M * (1.0 - sine)) / sine, MIN_SIDE_M)
        return Box(center, np.array([width, reach, THIN_M]), rotation), "flat"
    return Box(center, np.array([width, min(width, height), height]), rotation), "box"
