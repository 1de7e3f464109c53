"""Data taken from a run in progress: as little as possible, and only while a client is connected."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.frame import Frame, RigCamera
from cuboid.ground.core.results import FrameResult, MapPoints, Sighting, SupportPlane, TrackedObject
from cuboid.results.files.rows import EventRow

# Interval between moments, seconds: the eye still perceives motion. On a slow or busy machine moments are rarer, since
# their cost (drawing and packing a picture, 5 ms) is limited to this fraction of the tracker's processor time.
MOMENT_EVERY_S = 0.15
MOMENT_FRACTION = 0.02

# The same for the map: copying and packing 360 000 points takes 20 ms.
MAP_EVERY_S = 1.0
MAP_FRACTION = 0.015

# Distance between vertices of the camera's path, metres; a page gets at most this many vertices (16 kB).
STRIDE_M = 0.01
MAX_PLACES = 1000

# A camera of a rig without a frame for this time, in seconds of the recording, has ended: the page says so. One with
# long intervals (`--every`) has ended after so many of its own: frames are lost one or two in a row.
SILENCE_S = 2.0
SILENCE_INTERVALS = 3

# The page lists this many of the latest events.
EVENTS_SHOWN = 20

# A client without a request for this time, seconds, has closed the page or shows another tab.
GONE_AFTER_S = 3.0

# At the end of a run, seconds: wait for clients to request the end, and then for the answers to be sent.
FAREWELL_S = 1.5
LAST_WORDS_S = 0.3


class TrackerView(Protocol):
    """The parts of a tracker that are shown."""

    @property
    def objects(self) -> list[TrackedObject]:
        """The confirmed objects."""

    @property
    def planes(self) -> list[SupportPlane]:
        """The supporting planes."""

    @property
    def up(self) -> Float64Array | None:
        """The up direction in the world."""

    def map_points(self) -> MapPoints:
        """Return the global point map."""


@dataclass(frozen=True, slots=True)
class CameraView:
    """The last frame of one camera.

    Attributes
    ----------
    color : (H, W, 3) uint8
        RGB, in the size of the recording; read-only.
    T_world_camera : (4, 4) float64
    sightings : tuple of Sighting
        Objects in this frame.
    path : (N, 3) float32
        Positions of the camera so far.
    camera : RigCamera or None
        None without a rig.
    ended : bool
        Whether the other cameras have had frames for a while since.
    """

    color: UInt8Array
    T_world_camera: Float64Array
    sightings: tuple[Sighting, ...]
    path: Float32Array
    camera: RigCamera | None = None
    ended: bool = False


@dataclass(frozen=True, slots=True)
class Moment:
    """The state of a run at one moment.

    Attributes
    ----------
    number : int
        Number of the moment, from 1.
    frame, used : int
        Frame of the recording; number of frames used so far.
    cameras : tuple of CameraView
        The cameras of a rig in the order of their first frames; one without a rig.
    objects, planes :
        Results of the tracker after this frame.
    up : (3,) float64 or None
    milliseconds : float
        Running mean of the time of a frame.
    events : tuple of EventRow
        The latest events, by frame.
    """

    number: int
    frame: int
    used: int
    cameras: tuple[CameraView, ...]
    objects: tuple[TrackedObject, ...]
    planes: tuple[SupportPlane, ...]
    up: Float64Array | None
    milliseconds: float
    events: tuple[EventRow, ...] = ()

    @property
    def seen(self) -> frozenset[int]:
        """Labels of the objects in the last frames of the cameras."""
        return frozenset(item.label for view in self.cameras if not view.ended for item in view.sightings)


class _CameraPath:
    """The last frame of a camera with its result, and the places of the camera so far."""

    def __init__(self) -> None:
        self._last: tuple[Frame, FrameResult] | None = None
        self._interval_s = 0.0
        self._places: list[Float64Array] = []

    def add(self, frame: Frame, result: FrameResult) -> None:
        """Store a frame, and the position of the camera if it has moved."""
        if self._last is not None:
            self._interval_s = frame.timestamp_s - self._last[0].timestamp_s
        self._last = frame, result
        place = result.T_world_camera[:3, 3]
        if not self._places or np.abs(place - self._places[-1]).max() >= STRIDE_M:
            self._places.append(place)

    def view(self, time_s: float) -> CameraView:
        """Return the camera at the time of the last frame of all cameras."""
        assert self._last is not None
        frame, result = self._last
        silence_s = max(SILENCE_S, SILENCE_INTERVALS * self._interval_s)
        places = self._places[:: 1 + len(self._places) // MAX_PLACES]
        return CameraView(
            color=frame.color,
            T_world_camera=result.T_world_camera,
            sightings=result.sightings,
            path=np.array(places, np.float32).reshape(-1, 3),
            camera=frame.camera,
            ended=time_s - frame.timestamp_s > silence_s,
        )


class RateLimiter:
    """Limits how often a thread does a task: by an interval, and by a fraction of its processor time.

    Parameters
    ----------
    every_s : float
        Minimum interval, seconds.
    fraction : float
        Largest cost of the task as a fraction of the processor time of the calling thread, 0..1.
    """

    def __init__(self, every_s: float, fraction: float) -> None:
        self._every_s = every_s
        self._fraction = fraction
        self._begun_s = self._begun_thread_s = -np.inf
        self._cost_s = 0.0

    @property
    def due(self) -> bool:
        """Whether the task is due."""
        waited = time.monotonic() - self._begun_s >= self._every_s
        return waited and (time.thread_time() - self._begun_thread_s) * self._fraction >= self._cost_s

    def begin(self) -> None:
        """Start a new interval: the task is done now."""
        self._begun_s, self._begun_thread_s = time.monotonic(), time.thread_time()
        self._cost_s = 0.0

    @contextmanager
    def charged(self) -> Iterator[None]:
        """Add the processor time of this thread within the context to the cost."""
        begun_s = time.thread_time()
        yield
        self._cost_s += time.thread_time() - begun_s


class LiveView:
    """Takes moments and maps from a run, for clients in other threads.

    Call it after each used frame. Without clients it does nothing expensive.

    Attributes
    ----------
    moments, maps : RateLimiter
        Limits of the cost of moments and of maps.
    """

    def __init__(self) -> None:
        self.moments = RateLimiter(MOMENT_EVERY_S, MOMENT_FRACTION)
        self.maps = RateLimiter(MAP_EVERY_S, MAP_FRACTION)
        self._changed = threading.Condition()
        self._moment: Moment | None = None
        self._map: tuple[int, MapPoints] | None = None
        self._last: tuple[Frame, TrackerView] | None = None
        self._first: Float64Array | None = None
        self._cameras: dict[str, _CameraPath] = {}
        self._events: deque[EventRow] = deque(maxlen=EVENTS_SHOWN)
        self._used = 0
        self._mean_s = 0.0
        self._frame_s = 0.0
        self._asked_s = -GONE_AFTER_S
        self._waiting = 0
        self._map_asked = False
        self._ended: bool | None = None
        self._warnings: tuple[str, ...] = ()
        self._farewells = 0

    def __call__(self, frame: Frame, result: FrameResult, tracker: TrackerView) -> None:
        """Take the data of a frame."""
        now_s = time.monotonic()
        self._used += 1
        if self._frame_s:
            took_s = now_s - self._frame_s
            self._mean_s += (took_s - self._mean_s) * (1.0 if self._used == 2 else 0.05)
        self._frame_s = now_s
        self._events.extend(EventRow.of(event, result) for event in result.events)
        self._last = frame, tracker
        if self._first is None:
            self._first = result.T_world_camera
        self._cameras.setdefault(frame.camera_name, _CameraPath()).add(frame, result)
        if not (self.is_watched and self.moments.due):
            return
        self.moments.begin()
        self._take_moment()
        if self._map_asked and self.maps.due:
            self._take_map()

    @property
    def is_watched(self) -> bool:
        """Whether a client waits for an answer, or has sent a request recently."""
        return self._waiting > 0 or time.monotonic() - self._asked_s < GONE_AFTER_S

    @property
    def ended(self) -> bool | None:
        """None during the run; after it, whether it was complete."""
        return self._ended

    @property
    def first_pose(self) -> Float64Array | None:
        """T_world_camera of the first used frame, (4, 4)."""
        return self._first

    def moment_after(self, number: int, timeout_s: float) -> Moment | None:
        """Wait for a moment after the given number; None if none comes in time, or the run has ended."""
        with self._changed:
            self._wait(lambda: self._is_later(number), timeout_s)
            return self._moment if self._is_later(number) else None

    def map_after(self, number: int, timeout_s: float) -> tuple[int, MapPoints] | None:
        """Wait for a map after the given number, and return its number and the map; None if none comes in time."""
        with self._changed:
            self._map_asked = True
            self._wait(lambda: self._is_later_map(number), timeout_s)
            return self._map if self._is_later_map(number) else None

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of the run; empty until it has ended."""
        return self._warnings

    def end(self, complete: bool, warnings: Sequence[str] = ()) -> None:
        """Take the last moment and the last map, and give clients the time to fetch them.

        Parameters
        ----------
        complete : bool
            False if the run was interrupted or failed.
        warnings : sequence of str
            Probable problems of the run.
        """
        watched = self.is_watched
        if watched and self._last is not None:
            self._take_moment()
            self._take_map()
        with self._changed:
            self._ended, self._warnings = complete, tuple(warnings)
            self._changed.notify_all()
            if watched:
                self._changed.wait_for(lambda: self._farewells > 0, FAREWELL_S)
        if watched:
            time.sleep(LAST_WORDS_S)

    def farewell(self) -> None:
        """Count a client that has received the end."""
        with self._changed:
            self._farewells += 1
            self._changed.notify_all()

    def _wait(self, met: Callable[[], bool], timeout_s: float) -> None:
        """Wait until a condition is met or the run has ended."""
        self._waiting += 1
        try:
            self._changed.wait_for(lambda: met() or self._ended is not None, timeout_s)
        finally:
            self._waiting -= 1
            self._asked_s = time.monotonic()

    def _is_later(self, number: int) -> bool:
        return self._moment is not None and self._moment.number > number

    def _is_later_map(self, number: int) -> bool:
        return self._map is not None and self._map[0] > number

    def _take_moment(self) -> None:
        assert self._last is not None
        frame, tracker = self._last
        moment = Moment(
            number=1 if self._moment is None else self._moment.number + 1,
            frame=frame.index,
            used=self._used,
            cameras=tuple([camera.view(frame.timestamp_s) for camera in self._cameras.values()]),
            objects=tuple(tracker.objects),
            planes=tuple(tracker.planes),
            up=tracker.up,
            milliseconds=1e3 * self._mean_s,
            events=tuple(self._events),
        )
        with self._changed:
            self._moment = moment
            self._changed.notify_all()

    def _take_map(self) -> None:
        assert self._last is not None
        self.maps.begin()
        with self.maps.charged():
            points = self._last[1].map_points()
        with self._changed:
            self._map = (1 if self._map is None else self._map[0] + 1), points
            self._map_asked = False
            self._changed.notify_all()
