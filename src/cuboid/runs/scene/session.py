"""A recording that is added to a scene: frames are tracked in the scene's world, and committed about every second."""

from __future__ import annotations

import dataclasses
import sqlite3
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult, MapPoints, TrackedObject, Wall
from cuboid.ground.core.tolerances import DETECT_EVERY
from cuboid.ground.geometry.se3 import inverse, transform
from cuboid.method.detection import make_detector
from cuboid.method.detection.types import Detector
from cuboid.method.poses.sources import ESTIMATED, GIVEN, Posed, Poses
from cuboid.results.files.object_table import ObjectTable
from cuboid.runs.scene import changes, editing, layout
from cuboid.runs.scene.before import Before, write_noted
from cuboid.runs.scene.database import Writing, transaction, user_errors
from cuboid.runs.scene.furniture import named_furniture, of_recording
from cuboid.runs.scene.localisation import SAME_WORLD, JoinedPart, ScenePoses
from cuboid.runs.scene.pace import CommitTimer, Pace
from cuboid.runs.scene.records import Records
from cuboid.runs.scene.saving import SceneBlockStore, StateFile
from cuboid.runs.scene.visit import Visit
from cuboid.runs.tracking.posed_tracker import PosedTracker
from cuboid.runs.tracking.running import NO_DEPTH
from cuboid.runs.tracking.types import KeptMap

T = TypeVar("T")
# Interval of commits, seconds.
COMMIT_EVERY_S = 1.0
# A commit is written in small steps while later frames are tracked, with this fraction of the processor time; on an
# idle machine it ends before the next commit is due.
WRITING_FRACTION = 0.06
# Every n-th point of the map is compared with the others.
SPARSE = 7


class SceneTracker(KeptMap):
    """A tracker whose map, objects and labels are those of a scene; made by `Scene.tracker`.

    Frames are numbered within the recording; results are those of a `Tracker`, in the scene's world.

    Parameters
    ----------
    path : Path
        Path of the scene.
    file : Writing
    tracker : PosedTracker
    poses : ScenePoses
        Poses of the scene's frames, saved with the tracker.
    visit : Visit
        The recording in the scene.
    names : mapping of int to str
        Names by label.
    commit_every_s : float
    block_store : SceneBlockStore
        Source of map blocks that are not in memory.
    before : Before
        The scene when the recording began.

    Attributes
    ----------
    commits_itself : bool
        Whether `update` commits when a commit is due; else its caller must call `commit_if_due`.
    """

    def __init__(
        self,
        path: Path,
        file: Writing,
        tracker: PosedTracker,
        poses: ScenePoses,
        visit: Visit,
        names: Mapping[int, str],
        commit_every_s: float,
        block_store: SceneBlockStore,
        before: Before,
    ) -> None:
        self._path, self._file, self._visit = path, file, visit
        self._mapper = self._tracker = tracker
        self._names, self._poses = names, poses
        self._records = Records(file.connection, visit.number, visit.pixels)
        self._state = StateFile(file.connection, tracker, poses, block_store)
        self._before, self._changes = before, changes.Changes(visit.first_frame, before)
        self._joined: list[JoinedPart] = []
        self._pending: list[tuple[str, str]] = []
        self._next_frame = visit.next_frame
        self._thread = ThreadPoolExecutor(1, "cuboid-scene")
        self._writing: Future[None] | None = None
        self._pace = Pace()
        self._commit_timer = CommitTimer(commit_every_s)
        self._open = True
        self.commits_itself = True

    def __enter__(self) -> SceneTracker:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        self.close(complete=kind is None)

    @property
    def visit(self) -> Visit:
        """The recording in the scene."""
        return self._visit

    @property
    def tracker(self) -> PosedTracker:
        """The tracker itself, which counts the frames of all recordings."""
        return self._tracker

    @property
    def gone_names(self) -> dict[int, str]:
        """Names from the detector of objects that left in view of this recording, by label."""
        return self._tracker.gone_names

    def use_detector(self, detector: str | Detector | None, every: int = DETECT_EVERY) -> None:
        """Run a detector on every n-th frame; see `Tracker`. It gets frame numbers of the recording."""
        if detector is None:
            return self._tracker.use_detector(None, every)
        detect = OwnFrames(make_detector(detector))
        detect.first_frame = self._visit.first_frame
        return self._tracker.use_detector(detect, every)

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """Classes of the detector, available after its first frame."""
        return self._tracker.vocabulary

    def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
        """Process a frame; see `Tracker.update`.

        Raises
        ------
        FrameError
            If the frame has no pose, no reading of depth, or another size than the intrinsics.
        """
        if not frame.has_depth:
            raise FrameError(f"frame {frame.index}: {NO_DEPTH}")
        if self.commits_itself:
            self.commit_if_due()
        shifted = dataclasses.replace(frame, index=frame.index + self._visit.first_frame)
        found = dataclasses.replace(self._tracker.update(shifted, anchor), index=frame.index)
        if self._poses.mode == SAME_WORLD:
            self._poses.take(shifted)
        self._records.add(frame, found)
        if shifted.index % changes.EVERY_FRAMES == 0 and self._visit.number > 1:
            self._changes.recognise(self._tracker, shifted.index)
        self._next_frame = frame.index + 1
        return found

    def poses(self, given: Poses) -> Poses:
        """Return the source of the poses of the recording's frames in the scene's world.

        Parameters
        ----------
        given : Poses
            The recording's own poses, if it has any.
        """
        if self._poses.mode == SAME_WORLD:
            return given
        return _PosesOfVisit(self._poses, self._visit.first_frame, self._tracker)

    def warnings(self) -> tuple[str, ...]:
        """Return warnings for the user about the recording in the scene."""
        if self._poses.recognised:
            return ()
        return (
            f"{self._path}: the place was not recognised: the recording is a part of its own in the scene, until a "
            "later one connects them",
        )

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Apply a pose correction; see `Tracker.apply_correction`."""
        self._tracker.apply_correction(moved)
        joined = self._poses.take_joined()
        self._changes.apply_joins([part.in_frame(self._tracker.T_world_map) for part in joined])
        self._joined += joined

    def skip(self, index: int) -> None:
        """Record that a frame cannot be used."""
        self._next_frame = index + 1

    def keep(self, file: str, text: str) -> None:
        """Store a text of a result file in the scene until the results are complete."""
        self._pending.append((file, text))

    @property
    def objects(self) -> ObjectTable:
        """The confirmed objects that this recording has seen, by label; frame numbers are the recording's."""
        first = self._visit.first_frame
        return ObjectTable(self._of_visit(item) for item in self._tracker.objects if item.last_frame >= first)

    def _of_visit(self, item: TrackedObject) -> TrackedObject:
        first, name = self._visit.first_frame, self._names.get(item.label)
        begun, ended, seen = item.first_frame - first, item.last_frame - first, item.frames_seen
        if begun < 0:
            seen_as = [self._records.seen[k] for k in (item.label, *item.merged_labels) if k in self._records.seen]
            begun = min((frame for frame, _ in seen_as), default=ended)
            seen = max((count for _, count in seen_as), default=0)
        found = dataclasses.replace(item, first_frame=begun, last_frame=ended, frames_seen=seen)
        return found if name is None else found.with_given_name(name)

    def find_furniture(self, points: MapPoints | None = None) -> ObjectTable:
        """Find the furniture that this recording has seen; see `Tracker.find_furniture`."""
        found = named_furniture(super().find_furniture(points), self._names)
        return of_recording(found, self._visit.first_frame)

    def commit_if_due(self) -> None:
        """Write new data if the last commit is long enough ago; to be called between two frames."""
        if self._writing is not None and self._writing.done():
            self.finish_commit()
        if self._writing is None and self._commit_timer.due():
            self._commit()

    def close(
        self,
        *,
        complete: bool = True,
        walls: Sequence[Wall] | None = None,
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        """Write all new data and close the scene.

        Parameters
        ----------
        complete : bool
            Whether the recording was processed to its end; else it can be resumed.
        walls : sequence of Wall, optional
            Walls of the place; if given, the relations of all objects of the scene are noted for this recording.
        settings : mapping, optional
            The settings at the end of the run, which replace those at its beginning.

        Raises
        ------
        OutputError
            The disk is full; earlier commits are kept.
        """
        if not self._open:
            return
        self._open = False
        try:
            self.finish_commit()
            if self._visit.number > 1:
                self._changes.recognise(self._tracker, self._visit.first_frame + self._next_frame)
            if complete:
                self._tracker.voxels.levels.thin_all()
            self._commit(complete=complete, ended=True, walls=walls if complete else None, settings=settings)
            self.finish_commit()
        finally:
            self._thread.shutdown()

    def drop(self) -> None:
        """Close the scene as it was last committed."""
        if self._open:
            self._open = False
            self._pace.hurry()
            self._thread.shutdown()

    def _commit(
        self,
        *,
        complete: bool = False,
        ended: bool = False,
        walls: Sequence[Wall] | None = None,
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        begun_s = time.thread_time()
        state, rows = self._state.snapshot(), self._records.take(self._tracker)
        pending, self._pending = self._pending, []
        joined, self._joined = self._joined, []
        T_world_recording = self._poses.T_world_recording.astype("<f8").tobytes()
        visit, next_frame = self._visit, self._next_frame
        found = self._changes.find(self._tracker, self._records.seen) if ended and visit.number > 1 else []
        noted = self._before.take_noted()
        relate = None if walls is None else self._relations(walls)
        pace = self._pace = (
            Pace() if ended else Pace(WRITING_FRACTION, self._commit_timer.wait_s, self._commit_timer.cost_s)
        )

        def write() -> None:
            begun_s, connection = time.thread_time(), self._file.connection
            with transaction(connection):
                self._state.write(connection, state, pace, ended=ended)
                rows.write(connection)
                editing.transform_rows(connection, joined)
                write_noted(connection, noted)
                changes.write(connection, visit.number, found)
                if relate is not None:
                    relate(connection)
                visit.write(connection, next_frame, pending, complete=complete, ended=ended)
                if settings is not None:
                    visit.write_settings(connection, settings)
                values = T_world_recording, visit.number
                connection.execute("UPDATE recordings SET T_world_recording = ? WHERE id = ?", values)
            self._commit_timer.cost_s += time.thread_time() - begun_s

        self._commit_timer.begin(time.thread_time() - begun_s)
        self._writing = self._thread.submit(write)

    def _relations(self, walls: Sequence[Wall]) -> Callable[[sqlite3.Connection], None]:
        """Return a function that writes the current relations."""
        from cuboid.runs.scene.relations import relations_now, write_relations

        return partial(write_relations, recording=self._visit.number, scores=relations_now(self._tracker, walls))

    def finish_commit(self) -> None:
        """Wait until the commit in progress is done; raise OutputError if it failed."""
        if self._writing is not None:
            writing, self._writing = self._writing, None
            self._pace.hurry()
            with user_errors(self._path):
                writing.result()
            self._state.mark_committed()


class OwnFrames(Generic[T]):
    """Wraps a source of proposals, or a detector, that gets frames with their numbers in the recording.

    Attributes
    ----------
    first_frame : int
        The scene's number of the recording's first frame.
    """

    def __init__(self, source: Callable[[Frame, Intrinsics], T]) -> None:
        self._source = source
        self.first_frame = 0

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> T:
        """Return the source's output for a frame with the scene's number."""
        if self.first_frame:
            frame = dataclasses.replace(frame, index=frame.index - self.first_frame)
        return self._source(frame, intrinsics)


class _PosesOfVisit:
    """Poses of a recording's frames; converts the recording's frame numbers to the scene's."""

    def __init__(self, poses: ScenePoses, first_frame: int, tracker: PosedTracker) -> None:
        self._poses, self._first, self._tracker = poses, first_frame, tracker
        self.given_with_frames = poses.mode != ESTIMATED
        self.origin = ESTIMATED if poses.mode == ESTIMATED else GIVEN

    def locate(self, frame: Frame) -> Posed:
        if not self._poses.recognised and frame.index % changes.EVERY_FRAMES == 0:
            self._recognise_layout()
        return self._poses.locate(dataclasses.replace(frame, index=frame.index + self._first), self._tracker.up)

    def _recognise_layout(self) -> None:
        """Recognise the part of the recording by the layout of its objects."""
        part, up, T_world_map = self._poses.part, self._tracker.support.up, self._tracker.T_world_map
        objects = [o for o in self._tracker.ever_labelled() if o.confirmed and len(o.points)]
        center_of = {o.label: transform(T_world_map, o.box.center) for o in objects}
        scene_objects, seen = ([o for o in objects if self._poses.stands_in(k, center_of[o.label])] for k in (0, part))
        if part == 0 or up is None:
            return
        T = layout.find_layout(scene_objects, seen, up)
        if T is None:
            return
        points, _ = self._tracker.voxels.stored.spread(self._tracker.voxels.stored.living())
        middle = np.mean([o.box.center for o in seen], axis=0)
        if layout.same_place(points, points[::SPARSE], T, middle):
            self._poses.connect(part, T_world_map @ T @ inverse(T_world_map))

    def trajectory(self) -> Mapping[int, Float64Array] | None:
        found = self._poses.trajectory(self._first)
        return None if found is None else {k - self._first: T for k, T in found.items()}

    def warnings(self) -> tuple[str, ...]:
        return ()
