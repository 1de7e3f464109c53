"""What a running tracker tells the process that answers about its map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.results import ObjectEvent, SupportPlane, TrackedObject
from cuboid.results.files.queries import PointCloud
from cuboid.services.queries.answers import SightingAnswer


@dataclass(frozen=True, slots=True)
class Update:
    """The changes of a map since the last update.

    Attributes
    ----------
    frame : int
    seconds : float
        Of the frame.
    T_world_camera : (4, 4) float64
        Of the frame.
    objects : tuple of TrackedObject
        Those that are new, or have changed.
    gone : tuple of int
        Labels that are no longer there.
    planes : tuple of SupportPlane
        All of them.
    up : (3,) float64 or None
    sightings : mapping of int to SightingAnswer
        Of this frame, by label.
    pictures : mapping of int to bytes
        New pictures, by label.
    clouds : mapping of int to PointCloud
        Requested clouds, by label.
    events : tuple of ObjectEvent
        Events of the run.
    """

    frame: int
    seconds: float
    T_world_camera: Float64Array
    objects: tuple[TrackedObject, ...]
    gone: tuple[int, ...]
    planes: tuple[SupportPlane, ...]
    up: Float64Array | None
    sightings: Mapping[int, SightingAnswer] = field(default_factory=dict)
    pictures: Mapping[int, bytes] = field(default_factory=dict)
    clouds: Mapping[int, PointCloud] = field(default_factory=dict)
    events: tuple[ObjectEvent, ...] = ()
