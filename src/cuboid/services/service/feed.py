"""The tracker's side of a served run: it gives what changed to another process, and never waits for it.

An update is taken only when the last one has left, and a limiter of the tracker's own time pays for it. So neither slow
clients nor a process that stands still slow the tracker down; they see an older map.
"""

from __future__ import annotations

import pickle
import threading
from collections.abc import Iterable, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection

from cuboid.ground.core.frame import Frame
from cuboid.ground.core.results import FrameResult, MapPoints, ObjectEvent, Sighting, TrackedObject
from cuboid.results.files.queries import PointCloud
from cuboid.results.views.live.watch import MAP_EVERY_S, MAP_FRACTION, RateLimiter
from cuboid.runs.scene.records import BestPictures
from cuboid.runs.tracking.types import MapLike
from cuboid.services.queries.answers import SightingAnswer
from cuboid.services.queries.looking import vector
from cuboid.services.service.updates import Update

# Updates are at least this far apart, seconds, and take no more than this fraction of the tracker's processor time.
UPDATE_EVERY_S, FRACTION = 0.1, 0.02
# The last message: nothing follows.
END = b""
# Events that wait for the next update; of more, the oldest are dropped.
MAX_EVENTS = 10_000


class MapFeed:
    """Tells another process of a running map; call it after each used frame.

    Parameters
    ----------
    connection : Connection
        To that process, both ways: updates go, labels whose clouds are wanted come.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._moments, self._maps = RateLimiter(UPDATE_EVERY_S, FRACTION), RateLimiter(MAP_EVERY_S, MAP_FRACTION)
        self._pictures = BestPictures()
        self._sent_states: dict[int, tuple[object, ...]] = {}
        self._events: list[ObjectEvent] = []
        self._wanted: set[int] = set()
        self._ready = threading.Condition()
        self._update: Update | None = None
        self._busy = self._ended = False
        self._last: tuple[Frame, FrameResult, MapLike] | None = None
        for target in (self._send_updates, self._hear):
            threading.Thread(target=target, name="map feed", daemon=True).start()

    def __call__(self, frame: Frame, result: FrameResult, tracker: MapLike) -> None:
        """Look at a run after a frame."""
        self._last = frame, result, tracker
        if not self._busy and not self._ended and self._moments.due:
            self._moments.begin()
            with self._moments.charged():
                self._take(frame, result, tracker)

    def add_events(self, events: Iterable[ObjectEvent]) -> None:
        """Take events that the run tells; they go with the next update."""
        self._events = [*self._events, *events][-MAX_EVENTS:]

    def end(self, timeout_s: float) -> None:
        """Tell of the map as it is in the end, and of the end; wait at most so long for the other process."""
        with self._ready:
            self._ready.wait_for(lambda: not self._busy or self._ended, timeout_s)
        if self._last is not None and not self._busy and not self._ended:
            self._take(*self._last)
        with self._ready:
            self._ready.wait_for(lambda: not self._busy or self._ended, timeout_s)
            self._ended = True
            self._ready.notify_all()

    def _take(self, frame: Frame, result: FrameResult, tracker: MapLike) -> None:
        objects = tracker.objects
        now = {item.label: item for item in objects}
        states = {label: _state(item) for label, item in now.items()}
        picture = self._pictures.take(frame, result.sightings)
        events, self._events = self._events, []
        update = Update(
            result.index,
            frame.timestamp_s,
            result.T_world_camera,
            tuple(now[label] for label, state in states.items() if self._sent_states.get(label) != state),
            tuple(self._sent_states.keys() - states.keys()),
            tuple(tracker.planes),
            tracker.up,
            {seen.label: _sighting(seen, result, frame) for seen in result.sightings},
            {} if picture is None else {picture[0]: picture[2]},
            self._clouds(tracker),
            tuple(events),
        )
        self._sent_states = states
        with self._ready:
            self._update, self._busy = update, True
            self._ready.notify_all()

    def _clouds(self, tracker: MapLike) -> Mapping[int, PointCloud]:
        """Return the clouds that are wanted, where it is time to read the points."""
        if not self._wanted or not self._maps.due:
            return {}
        self._maps.begin()
        with self._maps.charged():
            wanted, self._wanted = self._wanted, set()
            points = tracker.map_points()
            return {label: _cloud(points, label) for label in wanted}

    def _send_updates(self) -> None:
        """Send updates until the end; the other process may be slow, or gone."""
        while True:
            with self._ready:
                self._ready.wait_for(lambda: self._update is not None or self._ended)
                update, self._update = self._update, None
            if update is None:
                with suppress(OSError, ValueError):
                    self._connection.send_bytes(END)
                return
            try:
                with self._moments.charged():
                    content = pickle.dumps(update, pickle.HIGHEST_PROTOCOL)
                self._connection.send_bytes(content)
            except (OSError, ValueError):  # it has gone
                self._ended = True
            with self._ready:
                self._busy = False
                self._ready.notify_all()

    def _hear(self) -> None:
        """Note the labels whose clouds are wanted."""
        while True:
            try:
                label = self._connection.recv()
            except (OSError, EOFError, ValueError):
                self._connection.close()
                return
            self._wanted = self._wanted | {int(label)}


def _state(item: TrackedObject) -> tuple[object, ...]:
    """Return what differs when an object has changed."""
    box = item.box.center.tobytes(), item.box.size.tobytes(), item.box.rotation.tobytes()
    return *box, item.last_frame, item.name, item.merged_labels, item.plane, item.score


def _sighting(seen: Sighting, result: FrameResult, frame: Frame) -> SightingAnswer:
    return SightingAnswer(result.index, None, frame.timestamp_s, vector(seen.box.center), round(seen.visible, 3))


def _cloud(points: MapPoints, label: int) -> PointCloud:
    chosen = points.of_object(label)
    return PointCloud(chosen.xyz, chosen.rgb)
