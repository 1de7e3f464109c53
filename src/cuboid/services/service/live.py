"""The map of a served run in the process that answers: as the last update of the tracker has it."""

from __future__ import annotations

import threading
from collections import defaultdict, deque
from collections.abc import Sequence
from multiprocessing.connection import Connection

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import MapPoints, ObjectEvent, SupportPlane, TrackedObject
from cuboid.ground.core.values import ObjectStatus
from cuboid.results.files.object_table import ObjectTable
from cuboid.results.files.queries import MapQueries, PointCloud
from cuboid.services.queries.answers import Later, Seen, SightingAnswer
from cuboid.services.queries.looking import seen_from
from cuboid.services.queries.sources import Source
from cuboid.services.service.updates import Update

# Sightings that are kept of an object, the latest; a run of hours has more than anybody asks for.
KEPT_SIGHTINGS = 1000
# A cloud is waited for so long, seconds: the tracker gives it after a frame, once it has the time.
CLOUD_S = 10.0


class LiveMap(MapQueries):
    """The map of a running tracker, without points except for requested clouds.

    Parameters
    ----------
    connection : Connection
        To the tracker's process.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._news = threading.Condition()
        self._objects: dict[int, TrackedObject] = {}
        self._planes: tuple[SupportPlane, ...] = ()
        self._up: Float64Array | None = None
        self._clouds: dict[int, PointCloud] = {}
        self._ended = False

    def take(self, update: Update) -> None:
        """Take in what changed."""
        with self._news:
            objects = self._objects | {item.label: item for item in update.objects}
            self._objects = {label: objects[label] for label in sorted(objects.keys() - set(update.gone))}
            self._planes, self._up = update.planes, update.up
            self._clouds |= update.clouds
            self._news.notify_all()

    def end(self) -> None:
        """Note that the run has ended."""
        with self._news:
            self._ended = True
            self._news.notify_all()

    @property
    def objects(self) -> ObjectTable:
        """The confirmed objects, by label."""
        return ObjectTable(self._objects.values())

    @property
    def planes(self) -> Sequence[SupportPlane]:
        """The supporting planes."""
        return self._planes

    @property
    def up(self) -> Float64Array | None:
        """Up in the world."""
        return self._up

    def map_points(self) -> MapPoints:
        """Raise InputError: the tracker keeps the points of the map."""
        raise InputError("the points of the whole map are in the results, once the run has ended")

    def cloud(self, label: int) -> PointCloud:
        """Return the points of one object, which the tracker gives between two frames."""
        with self._news:
            self._clouds.pop(label, None)
            self._connection.send(label)
            self._news.wait_for(lambda: label in self._clouds or self._ended, CLOUD_S)
            if label not in self._clouds:
                raise InputError("the run gave no points: it stands still, or has ended")
            return self._clouds.pop(label)

    def _views(self, item: TrackedObject) -> list[object]:  # type: ignore[override]
        """Raise InputError: views are the tracker's too."""
        raise InputError("meshes are made from the results, once the run has ended")


class RunSource(Source):
    """A run that goes on, as a place that is asked.

    Parameters
    ----------
    title : str
    connection : Connection
        To the tracker's process.
    """

    kind = "run"
    map: LiveMap

    def __init__(self, title: str, connection: Connection) -> None:
        self.title, self.running = title, True
        self.map = self.aside = LiveMap(connection)
        self._updates = 0
        self._frames: list[int] = []
        self._seconds: list[float] = []
        self._poses: dict[int, Float64Array] = {}
        self._pictures: dict[int, bytes] = {}
        self._sightings: dict[int, deque[SightingAnswer]] = defaultdict(lambda: deque(maxlen=KEPT_SIGHTINGS))

    def take(self, update: Update) -> tuple[ObjectEvent, ...]:
        """Apply an update; return the events of the run in it."""
        self.map.take(update)
        self._pictures |= update.pictures
        for label, seen in update.sightings.items():
            self._sightings[label].append(seen)
        self._frames.append(update.frame)
        self._seconds.append(update.seconds)
        self._poses[update.frame] = update.T_world_camera
        self._updates += 1
        return update.events

    def end(self) -> None:
        """Note that the run has ended."""
        self.running = False
        self.map.end()

    def version(self) -> object:
        """Return the number of updates so far."""
        return self._updates

    def _seen(self, frame: int, item: TrackedObject) -> Seen:
        """Return a frame with its time, interpolated between those of the updates, and the camera of its update."""
        if not self._frames:
            return Seen(frame)
        time_s = float(np.interp(frame, self._frames, self._seconds))
        return seen_from(frame, item.box, time_s=time_s, camera=self.title, T_world_camera=self._poses.get(frame))

    def later(self, item: TrackedObject, state: ObjectStatus) -> Later | None:
        """Return that an object is there if the last frame saw it; more is known at the end of the run."""
        return Later("there") if self._frames and item.last_frame >= self._frames[-1] else None

    def picture(self, item: TrackedObject) -> bytes | None:
        """Return an object's picture."""
        return self._pictures.get(item.label)

    def sightings(self, item: TrackedObject) -> list[SightingAnswer]:
        """Return the latest sightings of an object: those of the frames with an update."""
        found = [one for label in (*item.merged_labels, item.label) for one in self._sightings.get(label, ())]
        return sorted(found, key=lambda one: one.frame)
