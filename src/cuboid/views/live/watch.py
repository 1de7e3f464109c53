"""Data taken from a run while it goes: as little as possible, and only while somebody looks."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cuboid.core.frame import Float32Array, Float64Array, Frame, UInt8Array
from cuboid.core.results import FrameResult, MapPoints, Sighting, SupportPlane, TrackedObject
from cuboid.outputs.rows import EventRow

# Eyes see motion from here on. On a slow or busy machine moments are rarer: what is done for them (a picture is drawn
# and packed, 5 ms) takes no more than this fraction of the tracker's own processor time.
MOMENT_EVERY_S = 0.15
MOMENT_FRACTION = 0.02

# The map likewise: to copy and to pack 360 000 points takes 20 ms.
MAP_EVERY_S = 1.0
MAP_FRACTION = 0.015

# The camera's path has a corner after each step of this length, metres; a page gets at most this many (16 kB).
STRIDE_M = 0.01
MAX_PLACES = 1000

# The page lists this many events, the last ones.
EVENTS_SHOWN = 20

# Who has asked for nothing for so long has gone, or looks at another tab.
GONE_AFTER_S = 3.0

# How long the end of a run waits for those who look to ask for it, and then for the answers to leave.
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
        """Up in the world."""

    def map_points(self) -> MapPoints:
        """Return the global point map."""


@dataclass(frozen=True, slots=True)
class Moment:
    """A run at one moment.

    Attributes
    ----------
    number : int
        Counts moments from 1.
    frame, used : int
        Frame of the recording; frames used so far.
    color : (H, W, 3) uint8
        RGB, of the recording's own size; not to be changed.
    T_world_camera : (4, 4) float64
    sightings, objects, planes :
        What the tracker knows.
    up : (3,) float64 or None
    milliseconds : float
        Mean time of a frame of late.
    path : (N, 3) float32
        Where the camera has been.
    events : tuple of EventRow
        The last ones, by frame.
    """

    number: int
    frame: int
    used: int
    color: UInt8Array
    T_world_camera: Float64Array
    sightings: tuple[Sighting, ...]
    objects: tuple[TrackedObject, ...]
    planes: tuple[SupportPlane, ...]
    up: Float64Array | None
    milliseconds: float
    path: Float32Array
    events: tuple[EventRow, ...] = ()


class Ration:
    """Tells a thread when something is due: every so often, and rarer where it costs much.

    Parameters
    ----------
    every_s : float
        At most so often.
    fraction : float
        What may be spent on it, as a fraction of the processor time of the thread that asks, 0..1.
    """

    def __init__(self, every_s: float, fraction: float) -> None:
        self._every_s = every_s
        self._fraction = fraction
        self._begun_s = self._own_s = -np.inf
        self._cost_s = 0.0

    @property
    def due(self) -> bool:
        """Whether it is time."""
        waited = time.monotonic() - self._begun_s >= self._every_s
        return waited and (time.thread_time() - self._own_s) * self._fraction >= self._cost_s

    def begin(self) -> None:
        """Note that it is done now."""
        self._begun_s, self._own_s = time.monotonic(), time.thread_time()
        self._cost_s = 0.0

    @contextmanager
    def charged(self) -> Iterator[None]:
        """Charge it with the processor time that this thread spends inside."""
        begun_s = time.thread_time()
        yield
        self._cost_s += time.thread_time() - begun_s


class LiveView:
    """Takes moments and maps from a run, for those who look at it from other threads.

    Call it after each used frame; it does nothing that costs while nobody looks.

    Attributes
    ----------
    moments, maps : Ration
        Charged with what is done for them.
    """

    def __init__(self) -> None:
        self.moments = Ration(MOMENT_EVERY_S, MOMENT_FRACTION)
        self.maps = Ration(MAP_EVERY_S, MAP_FRACTION)
        self._changed = threading.Condition()
        self._moment: Moment | None = None
        self._map: tuple[int, MapPoints] | None = None
        self._last: tuple[Frame, FrameResult, TrackerView] | None = None
        self._first: Float64Array | None = None
        self._places: list[Float64Array] = []
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
        """Look at a run after a frame."""
        now_s = time.monotonic()
        self._used += 1
        if self._frame_s:
            took_s = now_s - self._frame_s
            self._mean_s += (took_s - self._mean_s) * (1.0 if self._used == 2 else 0.05)
        self._frame_s = now_s
        self._last = frame, result, tracker
        self._follow(result.T_world_camera)
        for one in result.events:
            self._events.append(
                EventRow(one.event, one.label, one.from_m, one.to_m, one.score, result.index, result.timestamp_s)
            )
        if not (self.is_watched and self.moments.due):
            return
        self.moments.begin()
        self._take_moment()
        if self._map_asked and self.maps.due:
            self._take_map()

    @property
    def is_watched(self) -> bool:
        """Whether somebody waits for an answer, or has asked of late."""
        return self._waiting > 0 or time.monotonic() - self._asked_s < GONE_AFTER_S

    @property
    def ended(self) -> bool | None:
        """None while the run goes; then whether it was complete."""
        return self._ended

    @property
    def first_pose(self) -> Float64Array | None:
        """The camera's pose in the first used frame, (4, 4)."""
        return self._first

    def moment_after(self, number: int, timeout_s: float) -> Moment | None:
        """Wait for a later moment than the one of this number; None where none comes, or the run has ended."""
        with self._changed:
            self._wait(lambda: self._is_later(number), timeout_s)
            return self._moment if self._is_later(number) else None

    def map_after(self, number: int, timeout_s: float) -> tuple[int, MapPoints] | None:
        """Wait for a later map than the one of this number, and return it with its own; None where none comes."""
        with self._changed:
            self._map_asked = True
            self._wait(lambda: self._is_later_map(number), timeout_s)
            return self._map if self._is_later_map(number) else None

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of the run; empty until it has ended."""
        return self._warnings

    def end(self, complete: bool, warnings: Sequence[str] = ()) -> None:
        """Take the last moment and the last map, and give those who look the time to fetch them.

        Parameters
        ----------
        complete : bool
            False where the run was broken off.
        warnings : sequence of str
            What is likely to be wrong with it.
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
        """Note that a client has received the end."""
        with self._changed:
            self._farewells += 1
            self._changed.notify_all()

    def _wait(self, met: Callable[[], bool], timeout_s: float) -> None:
        """Wait until something is met or the run has ended."""
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

    def _follow(self, T_world_camera: Float64Array) -> None:
        """Note where the camera is, if that is news."""
        if self._first is None:
            self._first = T_world_camera
        place = T_world_camera[:3, 3]
        if not self._places or np.abs(place - self._places[-1]).max() >= STRIDE_M:
            self._places.append(place)

    def _path(self) -> Float32Array:
        places = self._places[:: 1 + len(self._places) // MAX_PLACES]
        return np.array(places, np.float32).reshape(-1, 3)

    def _take_moment(self) -> None:
        assert self._last is not None
        frame, result, tracker = self._last
        moment = Moment(
            number=1 if self._moment is None else self._moment.number + 1,
            frame=frame.index,
            used=self._used,
            color=frame.color,
            T_world_camera=result.T_world_camera,
            sightings=result.sightings,
            objects=tuple(tracker.objects),
            planes=tuple(tracker.planes),
            up=tracker.up,
            milliseconds=1e3 * self._mean_s,
            path=self._path(),
            events=tuple(self._events),
        )
        with self._changed:
            self._moment = moment
            self._changed.notify_all()

    def _take_map(self) -> None:
        assert self._last is not None
        self.maps.begin()
        with self.maps.charged():
            points = self._last[2].map_points()
        with self._changed:
            self._map = (1 if self._map is None else self._map[0] + 1), points
            self._map_asked = False
            self._changed.notify_all()
