"""The tracker: from frames with or without camera poses to their sightings, and to a result folder at the end."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cuboid.ground.core.compiletime import working_s
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import CuboidError, FrameError, InputError, shown
from cuboid.ground.core.frame import Float64Array, Frame, Intrinsics, SkippedFrame
from cuboid.ground.core.limits import MEMORY_MB
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.core.results import FrameResult, TrackedObject
from cuboid.ground.core.tolerances import DETECT_EVERY
from cuboid.method.poses.sources import ESTIMATED, GIVEN, Poses, checked_origin, source_of_poses
from cuboid.results.files import PoseRow
from cuboid.results.files.object_table import ObjectTable
from cuboid.results.files.writer import RowLog
from cuboid.runs.tracking.checks import run_facts
from cuboid.runs.tracking.diagnosis import Counts, diagnose
from cuboid.runs.tracking.measuring import FrameClock, FrameLog
from cuboid.runs.tracking.types import KeptMap, RecordingLike, TrackerLike

if TYPE_CHECKING:
    from cuboid.method.detection.types import Detector
    from cuboid.method.proposals.types import ProposalSource
    from cuboid.method.shapes import ObjectView
    from cuboid.method.shapes.keeping import ViewKeeper

# The median depth of a frame exceeds this only if depth is not in metres: no RGB-D camera sees so far.
MAX_MEDIAN_DEPTH_M = 100.0


class Tracker(KeptMap):
    """Finds the objects of a static scene in RGB-D frames and keeps their labels; `cuboid track` is built on it.

    Parameters
    ----------
    intrinsics : Intrinsics
        Intrinsics of every frame.
    config : TrackerConfig, optional
    proposals : str or ProposalSource, optional
        Name of a source of 2D proposals, with its options, or any callable from (frame, intrinsics) to `Proposals`.
    poses : {"given", "auto", "corrected", "estimated"}, optional
        Source of the camera poses. "given": the pose of each frame, unchanged. "auto": the same, with a warning if
        the poses drift. "corrected": given poses, corrected if they drift. "estimated": from the video. By default the
        first frame decides: "given" if it has a pose, otherwise "estimated".
    memory_mb : float
        Memory limit of the process, in units of 2**20 bytes, above which parts of the map out of view are evicted; they
        are loaded again when accessed.
    detector : str or Detector, optional
        File of an ONNX model, or name of a detector, with its options; or any callable from (frame, intrinsics) to
        `Detections`. Objects get names from it.
    detector_every : int
        The detector processes each n-th frame.
    shapes : bool
        Keep views of the objects, in memory and in the results, so that `mesh` does not need the recording.

    Raises
    ------
    InputError
        If the intrinsics are of another type, or no proposal source or detector has that name.
    ValueError
        If `poses` is none of these words, or `detector_every` is less than 1.

    Examples
    --------
    >>> recording = cuboid.open_recording("my-recording")  # doctest: +SKIP
    >>> tracker = cuboid.Tracker(recording.intrinsics)  # doctest: +SKIP
    >>> for frame in recording:  # doctest: +SKIP
    ...     print([seen.label for seen in tracker.update(frame).sightings])
    >>> tracker.save("results", recording=recording)  # doctest: +SKIP
    """

    _mapper: TrackerLike

    def __init__(
        self,
        intrinsics: Intrinsics,
        config: TrackerConfig | None = None,
        proposals: str | ProposalSource | None = None,
        *,
        poses: str | None = None,
        memory_mb: float = MEMORY_MB,
        detector: str | Detector | None = None,
        detector_every: int = DETECT_EVERY,
        shapes: bool = False,
    ) -> None:
        from cuboid.runs.tracking.posed_tracker import PosedTracker

        if not isinstance(intrinsics, Intrinsics):
            raise InputError(
                "expected intrinsics as cuboid.Intrinsics(fx, fy, cx, cy, width, height), "
                f"got {type(intrinsics).__name__}"
            )
        config, rows = config or TrackerConfig(), RowLog()
        origin = None if poses is None else checked_origin(poses)
        mapper = PosedTracker(intrinsics, config, proposals, memory_mb=memory_mb)
        mapper.use_detector(detector, detector_every)
        self._start(intrinsics, config, mapper, None, rows.add, shapes=shapes)
        self._origin, self._proposals, self._rows = origin, proposals, rows
        self._detector, self._detector_every = detector, detector_every

    _origin: str | None = None
    _proposals: str | ProposalSource | None = None
    _rows: RowLog | None = None
    _detector: str | Detector | None = None
    _detector_every = DETECT_EVERY

    @classmethod
    def of_parts(
        cls,
        intrinsics: Intrinsics,
        config: TrackerConfig,
        mapper: TrackerLike,
        source: Poses,
        write: Callable[[FrameResult], None] | None,
        *,
        shapes: bool = False,
    ) -> Tracker:
        """Return a tracker made of a tracker of posed frames and a source of poses, for the loop over a recording.

        Parameters
        ----------
        intrinsics : Intrinsics
        config : TrackerConfig
        mapper : TrackerLike
            Processes the posed frames.
        source : Poses
        write : callable, optional
            Called with the result of each used frame, in order, to write its rows.
        shapes : bool
            As for the class.
        """
        tracker = cls.__new__(cls)
        tracker._start(intrinsics, config, mapper, source, write, shapes=shapes)
        return tracker

    def _start(
        self,
        intrinsics: Intrinsics,
        config: TrackerConfig,
        mapper: TrackerLike,
        source: Poses | None,
        write: Callable[[FrameResult], None] | None,
        *,
        shapes: bool,
    ) -> None:
        self.intrinsics, self._config = intrinsics, config
        self.kept_views: ViewKeeper | None = None
        if shapes:
            from cuboid.method.shapes.keeping import ViewKeeper

            self.kept_views = ViewKeeper(intrinsics)
        self._mapper, self._source, self._write = mapper, source, write
        self._busy = threading.Lock()
        self._begun_s = working_s()
        self.log, self.counts = FrameLog(), Counts()
        self.times_s: dict[int, float] = {}
        self.T_world_camera: dict[int, Float64Array] = {}

    def update(self, frame: Frame | SkippedFrame) -> FrameResult | SkippedFrame:
        """Process the next frame.

        Parameters
        ----------
        frame : Frame or SkippedFrame
            Indices increase from frame to frame. Depth is in metres.

        Returns
        -------
        FrameResult or SkippedFrame
            A `SkippedFrame`, which has no sightings, gives the reason why the frame could not be used: the camera is
            lost, the frame has no pose, or the reader skipped it.

        Raises
        ------
        FrameError
            If the argument is not a frame, has another size than the intrinsics, does not come after the last frame,
            or its depth is not in metres.
        CuboidError
            If another thread is processing a frame.
        """
        clock = FrameClock()
        result = self.step(frame, clock)
        if isinstance(result, FrameResult):
            self.log.use(clock.done(), result.left_out)
        return result

    def step(self, frame: Frame | SkippedFrame, clock: FrameClock) -> FrameResult | SkippedFrame:
        """Process the next frame as `update` does, with a clock whose times the caller logs."""
        if not self._busy.acquire(blocking=False):
            raise CuboidError("Tracker.update: another thread is taking in a frame; frames come one after the other")
        try:
            self._check(frame)
            if isinstance(frame, SkippedFrame):
                return self.skip(frame.index, frame.reason)
            return self._step(frame, clock)
        finally:
            self._busy.release()

    def _step(self, frame: Frame, clock: FrameClock) -> FrameResult | SkippedFrame:
        self.times_s[frame.index] = frame.timestamp_s
        try:
            posed = self._poses_for(frame).locate(frame)
            clock.lap("poses")
            if posed.moved:
                self._mapper.apply_correction(posed.moved)
                clock.lap("correction")
            result = self._mapper.update(frame.at(posed.T_world_camera), posed.anchor)
        except FrameError as error:
            return self.skip(frame.index, str(error))
        self.T_world_camera[frame.index] = posed.T_world_camera
        clock.laps(result.milliseconds)
        self.counts.add(frame, result)
        if self.kept_views is not None:
            self.kept_views.add(frame, posed.T_world_camera, result.sightings)
            clock.lap("views")
        if self._write is not None:
            self._write(result)
            clock.lap("write")
        return result

    def skip(self, index: int, reason: str) -> SkippedFrame:
        """Record a frame that cannot be used; the report lists it."""
        self.log.skip(index, reason)
        return SkippedFrame(index, reason)

    def resume(
        self,
        T_world_camera: Mapping[int, Float64Array],
        times_s: Mapping[int, float],
        skipped: Sequence[tuple[int, str]],
    ) -> None:
        """Restore the frames of an interrupted run: poses and times by index, skipped frames with reasons."""
        self.T_world_camera.update(T_world_camera)
        self.times_s.update(times_s)
        for index, reason in skipped:
            self.log.skip(index, reason)

    def _check(self, frame: Frame | SkippedFrame) -> None:
        """Raise FrameError for a wrong argument of a caller."""
        if not isinstance(frame, Frame | SkippedFrame):
            raise FrameError(f"expected a cuboid.Frame, got {type(frame).__name__}")
        if isinstance(frame.index, bool) or not isinstance(frame.index, int | np.integer) or frame.index < 0:
            raise FrameError(f"a frame's index must be a whole number from 0, got {shown(frame.index)}")
        if self._last_index is not None and frame.index <= self._last_index:
            raise FrameError(f"frame {frame.index} comes after frame {self._last_index}; indices must increase")
        if isinstance(frame, Frame):
            height, width = frame.depth_m.shape
            if (width, height) != (self.intrinsics.width, self.intrinsics.height):
                raise FrameError(
                    f"frame {frame.index} is {width} x {height} pixels, "
                    f"expected {self.intrinsics.width} x {self.intrinsics.height}"
                )
            refuse_other_units(frame)

    @property
    def _last_index(self) -> int | None:
        """Index of the last frame, used or not; None before the first."""
        used, skipped = next(reversed(self.T_world_camera), -1), self.log.skipped[-1][0] if self.log.skipped else -1
        return None if max(used, skipped) < 0 else max(used, skipped)

    def _poses_for(self, frame: Frame) -> Poses:
        if self._source is None:
            self._origin = self._origin or (ESTIMATED if frame.T_world_camera is None else GIVEN)
            self._source = source_of_poses(self._origin, self.intrinsics, self._config.voxel_m)
        return self._source

    @property
    def poses(self) -> str | None:
        """Source of the camera poses: "given", "corrected" or "estimated"; None before the first frame."""
        return None if self._source is None else self._source.origin

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """Classes of the detector, after it has processed a frame; empty without a detector."""
        found: tuple[str, ...] = getattr(self._mapper, "vocabulary", ())
        return found

    @property
    def objects(self) -> ObjectTable:
        """The confirmed objects of the map, by label: a list, and a table for notebooks and pandas."""
        return ObjectTable(self._mapper.objects)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Likely faults of the frames, one line each."""
        return (*diagnose(run_facts(self)), *self.pose_warnings, *self.view_warnings)

    @property
    def pose_warnings(self) -> tuple[str, ...]:
        """Likely faults of the camera poses, one line each."""
        return () if self._source is None else self._source.warnings()

    @property
    def view_warnings(self) -> tuple[str, ...]:
        """One line if views of objects were left out."""
        return () if self.kept_views is None else self.kept_views.warnings

    def corrected_trajectory(self) -> list[PoseRow] | None:
        """Return the corrected poses of the used frames; None if the source never corrects poses.

        Frames in which the camera was lost may get a pose later, but the map does not use them.
        """
        poses = None if self._source is None else self._source.trajectory()
        if poses is None:
            return None
        return [PoseRow(self.times_s[k], T) for k, T in sorted(poses.items()) if k in self.T_world_camera]

    @property
    def trajectory(self) -> dict[int, Float64Array]:
        """Corrected T_world_camera (4, 4) of each used frame, by its index."""
        poses = None if self._source is None else self._source.trajectory()
        return {k: T if poses is None else poses.get(k, T) for k, T in self.T_world_camera.items()}

    def _views(self, item: TrackedObject, max_views: int | None = None) -> list[ObjectView]:
        """Return the stored views of an object."""
        if self.kept_views is None:
            raise InputError("this tracker keeps no views of its objects: make it with shapes=True")
        return self.kept_views.views(item, self.trajectory, max_views)

    def save(
        self,
        output: PathLike,
        *,
        recording: RecordingLike | None = None,
        force: bool = False,
        relations: bool = False,
        furniture: bool = True,
    ) -> None:
        """Write the result folder that `cuboid track` writes: objects, sightings, poses, map, report, 3D page.

        Parameters
        ----------
        output : path
            The folder; it is created if necessary.
        recording : RecordingLike, optional
            The recording of the frames: `run.json` names it, and the 3D page gets images of the objects.
        force : bool
            Replace existing results in `output`.
        relations : bool
            Find the relations of the objects and include them in the results; this takes 0.1 to 2 s.
        furniture : bool
            Include the furniture that bears the supporting planes, see `find_furniture`.

        Raises
        ------
        OutputError
            If the folder exists and `force` is not given, or if it cannot be written.
        """
        from cuboid.method.detection import detector_name
        from cuboid.method.proposals import source_name
        from cuboid.runs.tracking.saving import save_results

        if self._rows is None:
            raise CuboidError("Tracker.save: the rows of this tracker are written by the loop that made it")
        settings: dict[str, Any] = {"proposals": source_name(self._proposals)}
        if self._detector is not None:
            settings |= {"detector": detector_name(self._detector), "detector_every": self._detector_every}
            settings["vocabulary"] = list(self.vocabulary)
        settings["tracker"] = self.config.to_dict()
        seconds = working_s() - self._begun_s
        output = as_path(output)
        save_results(
            self,
            self._rows,
            output,
            recording,
            settings,
            seconds,
            force=force,
            relations=relations,
            furniture=furniture,
        )


def refuse_other_units(frame: Frame) -> None:
    """Raise FrameError if the depth of a frame is not in metres."""
    readings_m = frame.depth_m[::8, ::8]
    readings_m = readings_m[readings_m > 0]
    if len(readings_m) and float(np.median(readings_m)) > MAX_MEDIAN_DEPTH_M:
        raise FrameError(
            f"frame {frame.index}: the median depth is {shown(round(float(np.median(readings_m)), 1))} m; "
            "depth_m must be in metres, not in millimetres"
        )
