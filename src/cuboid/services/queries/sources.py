"""Sources of a place: a result folder or a scene file, with the history of their objects."""

from __future__ import annotations

import tempfile
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import TrackedObject, Wall
from cuboid.ground.core.values import ObjectStatus
from cuboid.ground.formats.folder import OBJECTS, REPORT
from cuboid.inputs.readers.reopen import reopen_recording
from cuboid.method.text_search import TextModel
from cuboid.results.files import Results
from cuboid.results.files.queries import MapQueries
from cuboid.results.views.report.pictures import cut_picture
from cuboid.runs.scene import Scene, SceneObject, SceneRecording
from cuboid.services.queries.answers import Later, PastRelated, Seen, SightingAnswer
from cuboid.services.queries.filters import label_of
from cuboid.services.queries.in_results import later_in_results, name_of, seen_in_results
from cuboid.services.queries.likeness import color_fractions, colors_of
from cuboid.services.queries.looking import frames_that_show, seen_from, vector


@dataclass(frozen=True, slots=True)
class SupportingFurniture:
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

    def furniture(self) -> Sequence[SupportingFurniture]:
        """Return the furniture that was found, one entry for each label; only for the thread that uses `aside`."""
        return ()

    def colors(self) -> Mapping[int, tuple[str, ...]]:
        """Return the color words of the objects' points, by label; only for the thread that uses `aside`."""
        try:
            points = self.aside.map_points()
        except InputError:  # a run does not give the points of its whole map; a file is missing
            return {}
        order = np.argsort(points.label, kind="stable")
        labels, first = np.unique(points.label[order], return_index=True)
        parts = zip(labels.tolist(), np.split(points.rgb[order], first[1:]), strict=True) if len(labels) else ()
        return {label: colors_of(color_fractions(rgb)) for label, rgb in parts if label}

    def vectors(self, model: TextModel) -> Mapping[int, Float32Array]:
        """Return the vectors of the objects by an image-text model, by label."""
        return {}

    def objects(self) -> list[tuple[TrackedObject, ObjectStatus]]:
        """Return all objects, gone ones included, sorted by label."""
        return [(item, "present") for item in self.map.objects]

    def first_seen(self, item: TrackedObject) -> Seen:
        """Return when an object was seen first."""
        return self._seen(item.first_frame, item)

    def last_seen(self, item: TrackedObject) -> Seen:
        """Return when an object was seen last."""
        return self._seen(item.last_frame, item)

    def _seen(self, frame: int, item: TrackedObject) -> Seen:
        """Return a frame that saw an object, with its time."""
        return Seen(frame)

    def later(self, item: TrackedObject, state: ObjectStatus) -> Later | None:
        """Return what is known of an object after its last sighting; None if it is not known."""
        return None

    @abstractmethod
    def picture(self, item: TrackedObject) -> bytes | None:
        """Return the picture of an object, JPEG; None if there is none."""

    def last_picture(self, item: TrackedObject) -> bytes | None:
        """Return the picture of an object in its last sighting, JPEG; None if there is none."""
        return None

    def page(self) -> str | None:
        """Return the 3D page of the map, as HTML; None if there is none; any thread may call it."""
        return None

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

    def furniture(self) -> Sequence[SupportingFurniture]:
        """Return the furniture that was saved with the results."""
        pieces = self.aside.furniture
        return [
            SupportingFurniture(k, item.name, item.planes) for item in pieces for k in (item.label, *item.merged_labels)
        ]

    def vectors(self, model: TextModel) -> Mapping[int, Float32Array]:
        """Return the vectors of the objects by an image-text model, by label."""
        return self.aside.vectors(model)

    def objects(self) -> list[tuple[TrackedObject, ObjectStatus]]:
        """Return the objects, and those that were gone at the end, sorted by label."""
        present, gone = super().objects(), [(item, "gone") for item in self.map.gone]
        return sorted([*present, *gone], key=lambda one: one[0].label)  # type: ignore[list-item]  # a literal

    def _seen(self, frame: int, item: TrackedObject) -> Seen:
        return seen_in_results(self.map, frame, item)

    def later(self, item: TrackedObject, state: ObjectStatus) -> Later:
        """Return what the frames after the last sighting of an object show."""
        return later_in_results(self.map, item)

    def last_picture(self, item: TrackedObject) -> bytes | None:
        """Return the picture of the last sighting, cut from the recording if that still exists."""
        rows = self.aside.sightings(item.label)
        try:
            return cut_picture(self.aside.recording, rows[-1].frame, rows[-1].rect_xyxy) if rows else None
        except InputError:
            return None

    def page(self) -> str:
        """Return the 3D page: that of the folder, else a new one."""
        from cuboid.results.views.report import page_of, summarise

        try:
            return (self._folder / REPORT).read_text(encoding="utf-8")
        except OSError:
            pass
        results = Results(self._folder)
        try:
            read = results.recording.read
        except InputError:  # the recording is no longer there: a page without pictures
            return page_of(summarise(results, None))
        return page_of(summarise(results, read))

    def picture(self, item: TrackedObject) -> bytes | None:
        """Return the picture of an object, cut from the recording if that still exists."""
        from cuboid.results.views.report.pictures import best_sightings, cut_pictures

        if item.label not in self._pictures:
            results = self.aside
            best = best_sightings(results.sightings(item.label))
            rows = {item.label: best[item.label]} if item.label in best else {}
            try:
                read, boxes = results.recording.read, {item.label: item.box}
                found, _ = cut_pictures(rows, read, boxes, results.poses, results.found.intrinsics)
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
        self._version: object = None
        self._poses: dict[int, dict[int, tuple[float, Float64Array]]] = {}
        self._recordings: dict[int, SceneRecording] = {}
        self.version()

    def version(self) -> object:
        """Return a value that changes with each commit."""
        recordings = self.map.recordings
        self.running = bool(recordings) and not recordings[-1].complete
        version = self.map.version, tuple(one.number for one in recordings)
        if version != self._version:
            self._version, self._poses = version, {}
            self._recordings = {one.number: one for one in recordings}
        return version

    def furniture(self) -> Sequence[SupportingFurniture]:
        """Return the furniture that runs into the scene have found."""
        names = self.aside.furniture_names
        return [
            SupportingFurniture(label, names.get(label), planes)
            for label, planes in self.aside.furniture_planes.items()
        ]

    def vectors(self, model: TextModel) -> Mapping[int, Float32Array]:
        """Return the vectors of the objects by an image-text model, by label.

        New vectors are stored in the scene. It is opened for this call only: while it is open for writing, no run can
        add to it.
        """
        with Scene.open(self._path) as scene:
            return scene.vectors(model)

    def objects(self) -> list[tuple[TrackedObject, ObjectStatus]]:
        """Return all objects that ever had a label, sorted by label."""
        return [(item, item.state) for item in self.map.all_objects]

    def first_seen(self, item: TrackedObject) -> Seen:
        """Return the first frame that saw an object, and its recording."""
        return self._seen_in(*item.first_seen, item) if isinstance(item, SceneObject) else super().first_seen(item)

    def last_seen(self, item: TrackedObject) -> Seen:
        """Return the same of the last sighting."""
        return self._seen_in(*item.last_seen, item) if isinstance(item, SceneObject) else super().last_seen(item)

    def _seen_in(self, recording: int, frame: int, item: TrackedObject) -> Seen:
        time_s, T = self._poses_of(recording).get(frame, (None, None))
        one = self._recordings.get(recording)
        name = None if one is None else name_of(one.path)
        return seen_from(frame, item.box, recording=recording, time_s=time_s, camera=name, T_world_camera=T)

    def _poses_of(self, recording: int) -> dict[int, tuple[float, Float64Array]]:
        if recording not in self._poses:
            self._poses[recording] = self.map.poses(recording)
        return self._poses[recording]

    def later(self, item: TrackedObject, state: ObjectStatus) -> Later | None:
        """Return what the frames after the last sighting of an object show, over all later recordings."""
        if not isinstance(item, SceneObject):
            return None
        first, frame = item.last_seen
        if state == "gone":
            return Later("gone", self._gone(item))
        last = max(self._recordings, default=first)
        if first == last and frame >= max(self._poses_of(last), default=frame):
            return Later("there")
        for number in range(first, last + 1):
            shown = self._frames_that_show(item, number, frame if number == first else -1)
            if shown:
                return Later("not seen", self._seen_in(number, shown[0], item))
        return Later("not looked at")

    def _gone(self, item: SceneObject) -> Seen | None:
        """Return the frame in which the place of an object was seen empty, as far as it is known."""
        events = [one for one in self.map.events(item.label) if one.event == "gone"]
        if events and (events[-1].recording, events[-1].frame) >= item.last_seen:
            return self._seen_in(events[-1].recording, events[-1].frame, item)
        for one in self.map.changes(item.last_seen[0]):
            if one.label == item.label and one.change == "gone":
                after = item.last_seen[1] if one.recording == item.last_seen[0] else -1
                shown = self._frames_that_show(item, one.recording, after)
                return self._seen_in(one.recording, shown[0] if shown else max(after, 0), item)
        return None

    def _frames_that_show(self, item: SceneObject, recording: int, after: int) -> list[int]:
        poses = {frame: T for frame, (_, T) in self._poses_of(recording).items()}
        far_m = TrackerConfig().max_depth_m
        return frames_that_show(item.box, poses, after, self.map.intrinsics(recording), far_m) if poses else []

    def last_picture(self, item: TrackedObject) -> bytes | None:
        """Return the picture of the last sighting, cut from its recording if that still exists."""
        seen = self.aside.history(item.label)
        if not seen:
            return None
        one = next(one for one in self.aside.recordings if one.number == seen[-1].recording)
        camera = self.aside.intrinsics(one.number)
        try:
            recording = reopen_recording(Path(one.path), one.format, camera, (), None, seen[-1].frame)
        except InputError:
            return None
        return cut_picture(recording, seen[-1].frame, seen[-1].rect_xyxy)

    def page(self) -> str | None:
        """Return the 3D page of the scene after its last recording; None before the first one."""
        from cuboid.results.views.report import page_of
        from cuboid.runs.scene.viewing import scene_summary

        if not self._recordings:
            return None
        with tempfile.TemporaryDirectory(prefix="cuboid-page-") as work:
            return page_of(scene_summary(self._path, Path(work) / "results"))

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
