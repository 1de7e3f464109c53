"""Objects that came while the camera watched: something moved at their place, and an earlier view saw it empty."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.tolerances import DRIFT_M
from cuboid.method.heatmap.kernels.cubes import keys_of
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.kernels.leaving import count_passed

# A reading belongs to a point if it lies within this distance and noise of it, metres.
IN_PLACE_M = DRIFT_M / 2.0
# An object came if something moved in cells of this edge, metres, that hold at least this fraction of its points, and
# an earlier view saw through this fraction of them: the lower part of an object is too near to its support.
MOTION_CELL_M, MOTION_FRACTION, SEEN_THROUGH_FRACTION = 0.04, 0.25, 1.0 / 3.0
# An object was not there if an earlier view saw through this fraction of its points: it is .83 to 1 for hands and arms
# in made recordings, and at most .63 for objects at rest in TUM fr1/xyz.
ABSENT_BEFORE_FRACTION = 0.75
# A view is stored at this interval, seconds; this is the largest number of views.
VIEW_EVERY_S, MAX_STORED_VIEWS = 2.0, 64


@dataclass(frozen=True, slots=True)
class _View:
    """The depth of an earlier frame, every other pixel in both directions, with its camera."""

    depth_m: Float32Array
    pinhole: Float64Array
    T_camera_world: Float64Array


class Arrivals:
    """Earlier views, and the cells of the map in which something moved.

    Parameters
    ----------
    noise_per_m : float
        Standard deviation of depth divided by depth squared, 1/metre.
    """

    def __init__(self, noise_per_m: float) -> None:
        self._noise_per_m = noise_per_m
        self._views: deque[_View] = deque(maxlen=MAX_STORED_VIEWS)
        # Time of the last stored view of each camera of the rig, seconds.
        self._stored_s: dict[str, float] = {}
        self._cells: dict[int, None] = {}

    def raise_noise(self, noise_per_m: float) -> None:
        """Use this larger noise from now on."""
        self._noise_per_m = noise_per_m

    def note_view(self, seen: Observation, time_s: float) -> None:
        """Store the depth of a frame, if the last one was stored long enough ago."""
        last_s = self._stored_s.get(seen.camera)
        if last_s is not None and time_s - last_s < VIEW_EVERY_S:
            return
        self._stored_s[seen.camera] = time_s
        depth_m = np.ascontiguousarray(seen.image.depth_m[::2, ::2])
        T_camera_world = np.ascontiguousarray(seen.T_camera_world)
        self._views.append(_View(depth_m, seen.image.camera.pinhole / 2, T_camera_world))

    def note_motion(self, points: Float32Array) -> None:
        """Store the cells in which points (N, 3), in the world, move."""
        self._cells.update(dict.fromkeys(_keys(points)))

    def has_come(self, entry: MapObject) -> bool:
        """Return whether an object came while the camera watched: something moved at its place, which was empty."""
        if not self._cells or not len(entry.points):
            return False
        keys = _keys(_sample(entry))
        moved = sum(key in self._cells for key in keys) >= MOTION_FRACTION * len(keys)
        return moved and self._was_seen_through(entry, SEEN_THROUGH_FRACTION)

    def was_absent(self, entry: MapObject) -> bool:
        """Return whether an earlier view shows that an object was not there."""
        return self._was_seen_through(entry, ABSENT_BEFORE_FRACTION)

    def _was_seen_through(self, entry: MapObject, min_fraction: float) -> bool:
        """Return whether an earlier view saw through at least this fraction of the points of an object."""
        points = _sample(entry)
        for view in self._views:
            seen = view.depth_m, view.pinhole, view.T_camera_world
            _, passed = count_passed(points, *seen, IN_PLACE_M, self._noise_per_m)
            if passed >= min_fraction * len(points):
                return True
        return False


def _sample(entry: MapObject) -> Float32Array:
    """Return some points (N, 3) of an object."""
    return np.ascontiguousarray(entry.points[:: 1 + len(entry.points) // SAMPLE_POINTS])


def _keys(points: Float32Array) -> list[int]:
    """Return the numbers of the cells that points (N, 3) lie in."""
    cells = np.floor(points.astype(np.float64) / MOTION_CELL_M).astype(np.int64)
    found: list[int] = np.unique(keys_of(cells)).tolist()
    return found
