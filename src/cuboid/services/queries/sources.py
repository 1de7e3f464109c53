"""Sources of a place: a result folder or a scene file, with the history of their objects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import TrackedObject, Wall
from cuboid.ground.formats.folder import OBJECTS
from cuboid.method.text_search import TextModel
from cuboid.results.files import Results
from cuboid.results.files.queries import MapQueries
from cuboid.runs.scene import Scene, SceneObject
from cuboid.services.queries.answers import PastRelated, Seen, SightingAnswer, State, Vector
from cuboid.services.queries.filters import label_of

# Times from this one on (2001) are calendar times; the times of cameras that start at zero stay below it for 30 years.
CALENDAR_S = 1.0e9


@dataclass(frozen=True, slots=True)
class Bearer:
    """Furniture that bears supporting planes.

    Attributes
    ----------
    label : int
        Its own label, or one that ended in it.
    name : str or None
    planes : tuple of int
    """

    label: int
    name: str | None
    planes: tuple[int, ...]

    def is_called(self, what: str) -> bool:
        """Return whether this is its label or its name."""
        label = label_of(what)
        return self.label == label if label is not None else (self.name or "").lower() == what.strip().lower()


class Source(ABC):
    """A map that can be queried, with the history of its objects; calls come from one thread at a time.

    The methods of this class are those of one recording: all its objects are present, and its frames need no number of
    a recording.

    Attributes
    ----------
    title : str
    kind : {"results", "scene", "run"}
    running : bool
        Whether a run is active.
    map : MapQueries
        The present map.
    aside : MapQueries
        The same map, opened a second time for slow queries in another thread.
    """

    title: str
    kind: Literal["results", "scene", "run"]
    running = False
    map: MapQueries
    aside: MapQueries

    @abstractmethod
    def version(self) -> object:
        """Return a value that changes with each change of the map."""

    def walls(self) -> Sequence[Wall]:
        """Return the walls for the relation `against`; none where finding them would need the whole map."""
        return ()

    def furniture(self) -> Sequence[Bearer]:
        """Return the furniture that was found, one entry for each label; only for the thread that uses `aside`."""
        return ()

    def vectors(self, model: TextModel) -> Mapping[int, Float32Array]:
        """Return the vectors of the objects by an image-text model, by label."""
        return {}

    def objects(self) -> list[tuple[TrackedObject, State]]:
        """Return all objects, gone ones included, sorted by label."""
        return [(item, "present") for item in self.map.objects]

    def first_seen(self, item: TrackedObject) -> Seen:
        """Return when an object was seen first."""
        return self._seen(item.first_frame)

    def last_seen(self, item: TrackedObject) -> Seen:
        """Return when an object was seen last."""
        return self._seen(item.last_frame)

    def _seen(self, frame: int) -> Seen:
        """Return a frame with its time."""
        return Seen(frame)

    @abstractmethod
    def picture(self, item: TrackedObject) -> bytes | None:
        """Return the picture of an object, JPEG; None if there is none."""

    @abstractmethod
    def sightings(self, item: TrackedObject) -> list[SightingAnswer]:
        """Return the sightings of an object, in order."""

    def past_relations(self, item: TrackedObject) -> list[PastRelated]:
        """Return the present and past relations of an object; only a scene has a history of them."""
        return []


class ResultsSource(Source):
    """A result folder.

    Parameters
    ----------
    folder : Path
    """

    kind = "results"
    map: Results
    aside: Results

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._open()

    def _open(self) -> None:
        self._stamp = self._read_stamp()
        self.map, self.aside = Results(self._folder), Results(self._folder)
        self.title = str(self._folder)
        self._pictures: dict[int, bytes | None] = {}

    def _read_stamp(self) -> object:
        try:
            found = (self._folder / OBJECTS).stat()
        except OSError as error:
            raise InputError(f"{self._folder / OBJECTS}: cannot be read: {error.strerror}") from None
        return found.st_mtime_ns, found.st_size

    def version(self) -> object:
        """Return a value that changes when the files are replaced or an object is named."""
        if self._read_stamp() != self._stamp:
            self._open()
        return self._stamp

    def walls(self) -> Sequence[Wall]:
        """Return the walls for the relation `against`."""
        return self.aside.walls

    def furniture(self) -> Sequence[Bearer]:
        """Return the furniture that was saved with the results."""
        pieces = self.aside.furniture
        return [Bearer(k, item.name, item.planes) for item in pieces for k in (item.label, *item.merged_labels)]

    def vectors(self, model: TextModel) -> Mapping[int, Float32Array]:
        """Return the vectors of the objects by an image-text model, by label."""
        return self.aside.vectors(model)

    def _seen(self, frame: int) -> Seen:
        pose = self.map.poses.get(frame)
        return Seen(frame, None, None if pose is None else calendar_time(pose.timestamp_s))

    def picture(self, item: TrackedObject) -> bytes | None:
        """Return the picture of an object, cut from the recording if that still exists."""
        from cuboid.results.views.report.pictures import best_sightings, cut_pictures

        if item.label not in self._pictures:
            results = self.aside
            best = best_sightings(results.sightings(item.label))
            rows = {item.label: best[item.label]} if item.label in best else {}
            try:
                read, boxes = results.recording.read, {item.label: item.box}
                found = cut_pictures(rows, read, boxes, results.poses, results.found.intrinsics)
            except InputError:
                found = {}
            self._pictures[item.label] = found[item.label].jpeg if found else None
        return self._pictures[item.label]

    def sightings(self, item: TrackedObject) -> list[SightingAnswer]:
        """Return the sightings of an object, in order."""
        return [
            SightingAnswer(row.frame, None, row.timestamp_s, vector(row.box.center), round(row.visible, 3))
            for row in self.map.sightings(item.label)
        ]


class SceneSource(Source):
    """A scene file, to which another program may write at the same time.

    Parameters
    ----------
    path : Path
    """

    kind = "scene"
    map: Scene
    aside: Scene

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise InputError(f"{path}: there is no such scene file")
        self._path = path
        self.map, self.aside = Scene.open(path), Scene.open(path)
        self.title = str(path)
        self._begun: dict[int, str] = {}
        self.version()

    def version(self) -> object:
        """Return a value that changes with each commit."""
        recordings = self.map.recordings
        self._begun = {one.number: one.begun for one in recordings}
        self.running = bool(recordings) and not recordings[-1].complete
        return self.map.version, tuple(self._begun)

    def furniture(self) -> Sequence[Bearer]:
        """Return the furniture that runs into the scene have found."""
        names = self.aside.furniture_names
        return [Bearer(label, names.get(label), planes) for label, planes in self.aside.furniture_planes.items()]

    def vectors(self, model: TextModel) -> Mapping[int, Float32Array]:
        """Return the vectors of the objects by an image-text model, by label.

        New vectors are stored in the scene. It is opened for this call only: while it is open for writing, no run can
        add to it.
        """
        with Scene.open(self._path) as scene:
            return scene.vectors(model)

    def objects(self) -> list[tuple[TrackedObject, State]]:
        """Return all objects that ever had a label, sorted by label."""
        return [(item, item.state) for item in self.map.all_objects]  # type: ignore[misc]  # a literal in the file

    def first_seen(self, item: TrackedObject) -> Seen:
        """Return a frame and its recording with the time at which tracking of the recording began."""
        return self._seen_in(*item.first_seen) if isinstance(item, SceneObject) else self._seen(item.first_frame)

    def last_seen(self, item: TrackedObject) -> Seen:
        """Return the same of the last sighting."""
        return self._seen_in(*item.last_seen) if isinstance(item, SceneObject) else self._seen(item.last_frame)

    def _seen_in(self, recording: int, frame: int) -> Seen:
        return Seen(frame, recording, self._begun.get(recording))

    def picture(self, item: TrackedObject) -> bytes | None:
        """Return the picture of an object."""
        return self.map.picture(item.label)

    def sightings(self, item: TrackedObject) -> list[SightingAnswer]:
        """Return the sightings of an object, in order."""
        return [
            SightingAnswer(past.frame, past.recording, past.time_s, vector(past.box.center), round(past.visible, 3))
            for past in self.map.history(item.label)
        ]

    def past_relations(self, item: TrackedObject) -> list[PastRelated]:
        """Return the present and past relations of an object."""
        return [
            PastRelated(one.kind, one.to, one.first_recording, one.last_recording, round(one.score, 3))
            for one in self.map.relation_history(item.label)
        ]


def calendar_time(seconds: float) -> str | None:
    """Return a time as ISO 8601, UTC; None if it is not a calendar time."""
    if seconds < CALENDAR_S:
        return None
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")


def vector(values: Float64Array | Sequence[float]) -> Vector:
    """Return three numbers, rounded to a micrometre."""
    x, y, z = (round(float(value), 6) for value in values)
    return x, y, z
