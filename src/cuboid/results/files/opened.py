"""The results of a finished run, opened: each file is read when it is first needed, and checked against the others."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError, shown
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.core.results import MapPoints, SupportPlane, TrackedObject, Wall
from cuboid.ground.formats.folder import (
    AGENTS,
    EMBEDDINGS,
    EVENTS,
    MAP,
    OBJECTS,
    PROPOSALS,
    RUN,
    TRACKS,
    TRAJECTORY,
    VIEWS,
    finish_replacing,
)
from cuboid.inputs.readers.recording import Recording
from cuboid.inputs.readers.reopen import reopen_recording
from cuboid.inputs.recordings.rig import FORMAT as RIG
from cuboid.inputs.recordings.rig import RigRecording
from cuboid.method.poses.sources import LOST
from cuboid.results.files.gone import gone_objects
from cuboid.results.files.naming import name_object
from cuboid.results.files.object_table import ObjectTable
from cuboid.results.files.objects import ObjectsFile, read_objects
from cuboid.results.files.ply import read_map
from cuboid.results.files.queries import MapQueries
from cuboid.results.files.report import RunReport, read_run
from cuboid.results.files.rows import (
    AgentRow,
    EventRow,
    PoseRow,
    ProposalRow,
    TrackRow,
    read_agents,
    read_events,
    read_proposal_labels,
    read_proposals,
    read_tracks,
    read_trajectory,
)

if TYPE_CHECKING:
    from cuboid.ground.arrays import Float32Array
    from cuboid.method.shapes import ObjectView
    from cuboid.method.text_search import Embeddings, TextModel

R = TypeVar("R", TrackRow, ProposalRow, EventRow, AgentRow)
Q = TypeVar("Q", TrackRow, ProposalRow, AgentRow)


@dataclass(frozen=True, slots=True, eq=False)
class FrameRecord:
    """The use of one frame of a recording.

    Attributes
    ----------
    index : int
        Number of the frame in the recording.
    state : {"used", "lost", "skipped"}
        "lost": the camera pose could not be found. "skipped": the frame could not be used.
    timestamp_s : float or None
        Seconds; None if the frame was not used.
    T_world_camera : (4, 4) float64 or None
        Camera pose, metres; None if the frame was not used.
    reason : str or None
        Reason why the frame was not used; None if it was used.
    """

    index: int
    state: Literal["used", "lost", "skipped"]
    timestamp_s: float | None = None
    T_world_camera: Float64Array | None = None
    reason: str | None = None

    def __repr__(self) -> str:
        rest = f"at {self.timestamp_s:.3f} s" if self.reason is None else self.reason
        return f"FrameRecord({self.index} {self.state}: {rest})"


class Results(MapQueries):
    """The results that `cuboid track` or `Tracker.save` left in a folder; `cuboid.open_results` opens them.

    A file is read when it is first needed.

    Parameters
    ----------
    folder : str or os.PathLike
        The result folder.
    recording_path : str or os.PathLike, optional
        Present path of the recording; default: its path during the run.

    Attributes
    ----------
    folder : Path
    recording_path : Path or None

    Raises
    ------
    InputError
        There is no such folder; or, when a file is first needed, it is missing, malformed, or does not fit the others.
    """

    def __init__(self, folder: PathLike, recording_path: PathLike | None = None) -> None:
        self.folder = as_path(folder)
        self.recording_path = None if recording_path is None else as_path(recording_path)
        if not self.folder.is_dir():
            raise InputError(f"{self.folder}: expected a folder with the results of 'cuboid track'")
        with suppress(OSError):  # a folder that cannot be written is read as it is
            finish_replacing(self.folder)

    def __repr__(self) -> str:
        return f"Results({self.folder})"

    def _repr_html_(self) -> str:
        """Show the objects in a notebook."""
        return self.objects._repr_html_()

    @cached_property
    def report(self) -> RunReport:
        """The report of the run: settings, frames, times."""
        return read_run(self.folder / RUN)

    @cached_property
    def found(self) -> ObjectsFile:
        """Objects, planes, up and intrinsics: the content of `objects.json`."""
        return read_objects(self.folder / OBJECTS)

    @property
    def objects(self) -> ObjectTable:
        """The objects, by label, without `furniture`: a list, and a table for notebooks and pandas."""
        return ObjectTable(self.found.objects)

    @property
    def furniture(self) -> ObjectTable:
        """The furniture under the supporting planes, by label; empty unless the run searched for it."""
        return ObjectTable(self.found.furniture)

    @property
    def gone(self) -> ObjectTable:
        """The objects that left during the run and did not come back, by label, as they were last seen."""
        return ObjectTable(gone_objects(self.events, self.tracks, self.survivor, self.found.gone_names))

    @property
    def planes(self) -> tuple[SupportPlane, ...]:
        """The supporting planes; `TrackedObject.plane` is an index into them."""
        return self.found.planes

    @property
    def up(self) -> Float64Array | None:
        """Up in the world, (3,), a unit vector; None while unknown."""
        return self.found.up

    def name(self, label: int, name: str) -> TrackedObject:
        """Set the name of an object, a gone one too, or of furniture in `objects.json`; an empty name removes it.

        Returns
        -------
        TrackedObject
            The named object.

        Raises
        ------
        InputError
            No object or furniture has the label, or the name is not a single line of at most 100 characters.
        OutputError
            The file cannot be written; it is unchanged.
        """
        name_object(self.folder, label, name)
        for old in ("found", "survivor"):
            self.__dict__.pop(old, None)  # it is read again
        every: list[TrackedObject] = [*self.objects, *self.furniture, *self.gone]
        return next(item for item in every if item.label == label)

    @cached_property
    def walls(self) -> Sequence[Wall]:
        """The walls that objects may be against: those that the relations were saved with, else found now."""
        return self.found.walls or super().walls

    @cached_property
    def _points(self) -> MapPoints:
        return read_map(self.folder / MAP)

    def map_points(self) -> MapPoints:
        """Return the global point map."""
        return self._points

    @cached_property
    def frames(self) -> Sequence[FrameRecord]:
        """The frames that the run read, in order, each used or skipped."""
        used = [FrameRecord(k, "used", pose.timestamp_s, pose.T_world_camera) for k, pose in self.poses.items()]
        others = [
            FrameRecord(k, "lost" if reason == LOST else "skipped", reason=reason) for k, reason in self.report.skipped
        ]
        return tuple(sorted([*used, *others], key=lambda record: record.index))

    def sightings(self, label: int | None = None, frame: int | None = None) -> list[TrackRow]:
        """Return the sightings of objects, by frame and label.

        Parameters
        ----------
        label : int, optional
            Only those of this object, labels that were merged into it included.
        frame : int, optional
            Only those in this frame, by its number in the recording.

        Raises
        ------
        InputError
            No object ever had the label, or the frame is not among those that the run read.
        """
        rows = self.tracks
        if label is not None:
            labels = {label, *(item.label for item in self.found.objects if label in item.merged_labels)}
            labels |= {old for item in self.found.objects if item.label == label for old in item.merged_labels}
            rows = [row for row in rows if row.label in labels]
            if not rows and label not in self.survivor:
                raise InputError(f"{self.folder / TRACKS}: no object ever had the label {shown(label)}")
        if frame is not None:
            if frame not in self.poses and frame not in dict(self.report.skipped):
                raise InputError(f"{self.folder / RUN}: frame {shown(frame)} is not among the frames that were read")
            rows = [row for row in rows if row.frame == frame]
        return list(rows)

    def probability_of(self, row: TrackRow) -> float:
        """Return the probability of an object in a frame; of results of an older version, that at the end."""
        if row.probability is not None:
            return row.probability
        item = self.survivor.get(row.label)
        return 0.0 if item is None else item.probability

    @property
    def warnings(self) -> tuple[str, ...]:
        """Likely faults of the input, one line each."""
        return self.report.warnings

    @cached_property
    def recording(self) -> Recording:
        """The recording of the results, for its images.

        Raises
        ------
        InputError
            It does not exist, or is another one.
        """
        report = self.report
        path = self.recording_path or Path(report.recording)
        if report.format == RIG:
            return self._rig(path)
        return reopen_recording(
            path,
            report.format,
            self.found.intrinsics,
            report.distortion,
            report.depth_camera,
            self.last_frame,
            report.depth_units_per_metre,
        )

    def _rig(self, path: Path) -> Recording:
        """Return the recordings of a rig as one, from this path or from the paths of its cameras during the run."""
        from cuboid.inputs.recordings.opening import open_rig

        paths = [] if self.recording_path is not None else [Path(one) for one in self.report.rig_recordings]
        rig = open_rig(path, paths)
        if len(rig) <= self.last_frame:
            raise InputError(
                f"{path}: is not the rig of the results: expected frame {self.last_frame}, got {len(rig)} frames"
            )
        return rig

    def of_camera(self, name: str) -> Results:
        """Return the results of one camera of a rig, with the frame numbers of its own recording.

        Objects, planes and the map are those of the rig, with its frame numbers; rows, skipped frames, poses,
        intrinsics and the recording are those of the camera. An event is at the camera's next used frame, or at its
        last one. The recording is opened when it is first needed.

        Raises
        ------
        InputError
            The results have no such camera.
        """
        return CameraResults(self, name)

    def embed(self, model: PathLike | TextModel | None = None) -> Embeddings:
        """Embed pictures of the objects with an image-text model, store the vectors beside the results, return them.

        Parameters
        ----------
        model : path or TextModel, optional
            As in `find`.

        Raises
        ------
        InputError
            There is no such model, or there are no pictures of the objects, since the recording does not exist.
        OutputError
            The folder cannot be written.
        """
        from cuboid.method.text_search import Embeddings, open_text_model
        from cuboid.results.files.pending import write_whole

        opened = open_text_model(model, "embed")
        found = Embeddings(opened.identity, super().vectors(opened))
        write_whole(self.folder / EMBEDDINGS, found.content())
        self._embedded[opened.identity] = found.vectors
        return found

    @cached_property
    def _embedded(self) -> dict[str, Mapping[int, Float32Array]]:
        """The vectors of the objects, by identity of the model and by label: stored ones and new ones."""
        from cuboid.method.text_search import Embeddings

        path = self.folder / EMBEDDINGS
        kept = [Embeddings.read(path)] if path.is_file() else []
        return {embeddings.model: embeddings.vectors for embeddings in kept}

    def vectors(self, model: TextModel) -> Mapping[int, Float32Array]:
        """Return the vectors of the objects: stored ones, else those of pictures from the recording."""
        if model.identity not in self._embedded:
            self._embedded[model.identity] = super().vectors(model)
        return self._embedded[model.identity]

    def _views(self, item: TrackedObject, max_views: int | None = None) -> list[ObjectView]:
        """Return the views of an object: those that the run stored, else read from the recording."""
        from cuboid.method.shapes.keeping import read_views
        from cuboid.method.shapes.views import Candidate, chosen, view_of

        kept = self.folder / VIEWS
        if kept.is_file():
            poses = {frame: pose.T_world_camera for frame, pose in self.poses.items()}
            return read_views(kept, item, self._camera, poses, max_views)
        candidates = [
            Candidate(row.frame, row.box, row.visible, self.poses[row.frame].T_world_camera)
            for row in self.sightings(item.label)
        ]
        views = []
        for sighting in chosen(candidates, item.box, max_views):
            try:
                frame = self.recording.read(sighting.frame)
            except FrameError:
                continue
            view = view_of(frame, frame.intrinsics_or(self.found.intrinsics), sighting.T_world_camera, item.box)
            if view is not None:
                views.append(view)
        return views

    @property
    def _camera(self) -> Intrinsics:
        """The camera of the frames as they were tracked."""
        return self.found.intrinsics.downscaled(int(self.report.config.get("scale", 1)))

    @cached_property
    def poses(self) -> dict[int, PoseRow]:
        """Camera pose and time of each used frame, by its number in the recording, in order."""
        rows = read_trajectory(self.folder / TRAJECTORY)
        if len(rows) != self.report.frames_used:
            raise InputError(
                f"{self.folder / TRAJECTORY}: expected {self.report.frames_used} lines, one a used frame of {RUN}, "
                f"got {len(rows)}"
            )
        return dict(zip(self.report.used().tolist(), rows, strict=True))

    @cached_property
    def tracks(self) -> list[TrackRow]:
        """All sightings, by frame and label."""
        return sorted(self._rows(TRACKS, read_tracks), key=lambda row: (row.frame, row.label))

    @cached_property
    def events(self) -> list[EventRow]:
        """Events of objects during the run, by frame; empty if nothing moved."""
        return self._rows(EVENTS, read_events, optional=True)

    @cached_property
    def agents(self) -> list[AgentRow]:
        """Boxes of moving things that are no objects (a person, a hand), by frame; empty if there are none."""
        return self._rows(AGENTS, read_agents, optional=True)

    @cached_property
    def proposals(self) -> list[ProposalRow]:
        """The 3D proposals of the frames, in the order of the file."""
        return self._rows(PROPOSALS, read_proposals)

    @cached_property
    def proposal_labels(self) -> list[int]:
        """The label of each of the `proposals`, 0 for none."""
        return read_proposal_labels(self.folder / PROPOSALS)

    @cached_property
    def survivor(self) -> dict[int, TrackedObject]:
        """The object of each label: the one with this label, or the one that it was merged into."""
        ended = {label: item for item in self.found.objects for label in item.merged_labels}
        return ended | {item.label: item for item in self.found.objects}

    @property
    def last_frame(self) -> int:
        """The last used frame of the recording; -1 if no frame was used."""
        return next(reversed(self.poses), -1)

    def _rows(self, name: str, read: Callable[[Path], list[R]], *, optional: bool = False) -> list[R]:
        """Return the rows of a file; raise InputError if one is of a frame that was not used."""
        path = self.folder / name
        rows = read(path) if not optional or path.exists() else []
        strange = {row.frame for row in rows} - self.poses.keys()
        if strange:
            raise InputError(f"{path}: frame {min(strange)} is not among the used frames of {RUN}")
        return rows


class CameraResults(Results):
    """The results of one camera of a rig; `Results.of_camera` makes it."""

    def __init__(self, rig: Results, name: str) -> None:
        super().__init__(rig.folder, rig.recording_path)
        names = [camera.name for camera in rig.report.rig_cameras]
        if name not in names:
            raise InputError(f"{self.folder}: there is no camera '{name}'; there are: {', '.join(names) or 'none'}")
        cameras, numbers = rig.report.rig_frames
        if not len(cameras):
            raise InputError(f"{self.folder / RUN}: does not say which camera took each frame")
        self._whole, self._camera_name, self._number = rig, name, names.index(name)
        # The number of each frame of the camera in its own recording, by its number in the rig, ascending.
        self._own = {frame: int(numbers[frame]) for frame in np.flatnonzero(cameras == self._number).tolist()}

    def _of(self, rows: Iterable[Q]) -> list[Q]:
        """Return the rows in the frames of the camera."""
        return [replace(row, frame=self._own[row.frame]) for row in rows if row.frame in self._own]

    def name(self, label: int, name: str) -> TrackedObject:
        """Set the name of an object of the rig; see `Results.name`."""
        named = self._whole.name(label, name)
        for old in ("found", "survivor"):
            self.__dict__.pop(old, None)
        return named

    @cached_property
    def report(self) -> RunReport:
        """The report of the run, with the recording and the frames of the camera."""
        whole, used = self._whole.report, len(self.poses)
        skipped = tuple((self._own[frame], reason) for frame, reason in whole.skipped if frame in self._own)
        return replace(
            whole,
            recording=whole.rig_recordings[self._number] if whole.rig_recordings else whole.recording,
            config={key: value for key, value in whole.config.items() if key != "rig"},
            frames_read=used + len(skipped),
            frames_used=used,
            skipped=skipped,
        )

    @cached_property
    def found(self) -> ObjectsFile:
        """The content of `objects.json`, with the intrinsics of the camera."""
        return replace(self._whole.found, intrinsics=self._whole.report.rig_cameras[self._number].intrinsics)

    @cached_property
    def _points(self) -> MapPoints:
        return self._whole.map_points()

    def _views(self, item: TrackedObject, max_views: int | None = None) -> list[ObjectView]:
        """Return the views of an object, those of all cameras: stored views have the frame numbers of the rig."""
        return self._whole._views(item, max_views)

    @cached_property
    def recording(self) -> Recording:
        """The recording of the camera; see `Results.recording`."""
        rig = self._whole.recording
        assert isinstance(rig, RigRecording)
        return rig.of(self._camera_name)

    @cached_property
    def poses(self) -> dict[int, PoseRow]:
        """Pose and time of each used frame of the camera."""
        return {self._own[frame]: row for frame, row in self._whole.poses.items() if frame in self._own}

    @cached_property
    def tracks(self) -> list[TrackRow]:
        """The sightings in the frames of the camera, by frame and label."""
        return [replace(row, camera="") for row in self._of(self._whole.tracks)]

    @cached_property
    def events(self) -> list[EventRow]:
        """The events of the rig, each at the camera's next used frame, else at its last one."""
        frames = [frame for frame in self._whole.poses if frame in self._own]
        if not frames:
            return []
        at = [min(bisect_left(frames, row.frame), len(frames) - 1) for row in self._whole.events]
        return [replace(row, frame=self._own[frames[k]]) for row, k in zip(self._whole.events, at, strict=True)]

    @cached_property
    def agents(self) -> list[AgentRow]:
        """The boxes of moving things in the frames of the camera, by frame."""
        return self._of(self._whole.agents)

    @cached_property
    def proposals(self) -> list[ProposalRow]:
        """The 3D proposals of the frames of the camera."""
        return self._of(self._whole.proposals)

    @cached_property
    def proposal_labels(self) -> list[int]:
        """The label of each of the `proposals`, 0 for none."""
        pairs = zip(self._whole.proposals, self._whole.proposal_labels, strict=True)
        return [label for row, label in pairs if row.frame in self._own]


def open_results(folder: PathLike, recording: PathLike | None = None) -> Results:
    """Open the results that `cuboid track` or `Tracker.save` left in a folder.

    Parameters
    ----------
    folder : str or os.PathLike
        The result folder.
    recording : str or os.PathLike, optional
        Present path of the recording; default: its path during the run.

    Raises
    ------
    InputError
        The folder does not exist or holds no results, or its `objects.json` or `run.json` is malformed.
    """
    results = Results(folder, recording)
    if not (results.folder / RUN).exists() and not (results.folder / OBJECTS).exists():
        raise InputError(
            f"{results.folder}: holds no results: expected {OBJECTS} and {RUN}, which 'cuboid track' writes"
        )
    _ = results.report, results.found  # a wrong folder is refused here, not at the first query
    return results
