"""A tracker of posed frames with its source of camera poses, and the record of the frames that it was given."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import CuboidError, FrameError, InputError, shown
from cuboid.ground.core.frame import Frame, Intrinsics, SkippedFrame
from cuboid.ground.core.results import FrameResult, TrackedObject
from cuboid.method.poses.named import source_of_poses
from cuboid.method.poses.sources import ESTIMATED, GIVEN, CorrectedPoses, Posed, Poses
from cuboid.results.files import PoseRow
from cuboid.results.files.object_table import ObjectTable
from cuboid.runs.tracking.diagnosis import Counts
from cuboid.runs.tracking.measuring import FrameClock, FrameLog
from cuboid.runs.tracking.types import KeptMap, PreparedFrame, Preparing, TrackerLike

if TYPE_CHECKING:
    from cuboid.method.shapes import ObjectView
    from cuboid.method.shapes.keeping import ViewKeeper
    from cuboid.runs.tracking.preparing import PreparedImages

# The median depth of a frame exceeds this only if depth is not in metres: no RGB-D camera sees so far.
MAX_MEDIAN_DEPTH_M = 100.0
NO_DEPTH = "depth has no reading at all: every pixel is 0 or not a number"


class RunningTracker(KeptMap):
    """Finds the pose of each frame and gives the posed frame to a tracker; the loop over a recording uses it directly.

    Parameters
    ----------
    intrinsics : Intrinsics
        Intrinsics of every frame that does not come with a camera of a rig.
    config : TrackerConfig
    mapper : TrackerLike
        Processes the posed frames.
    source : Poses, str or None
        The source of poses, or its name; None: the first frame decides.
    write : callable, optional
        Called with the result of each used frame, in order, to write its rows.
    shapes : bool
        Keep views of the objects.
    """

    _mapper: TrackerLike

    def __init__(
        self,
        intrinsics: Intrinsics,
        config: TrackerConfig,
        mapper: TrackerLike,
        source: Poses | str | None,
        write: Callable[[FrameResult], None] | None,
        *,
        shapes: bool = False,
    ) -> None:
        self.intrinsics, self._config = intrinsics, config
        self.kept_views: ViewKeeper | None = None
        if shapes:
            from cuboid.method.shapes.keeping import ViewKeeper

            self.kept_views = ViewKeeper(intrinsics)
        self._origin = source if isinstance(source, str) else None
        self._source = None if isinstance(source, str) else source
        self._mapper, self._write = mapper, write
        self._preparing = mapper if isinstance(mapper, Preparing) else None
        self._busy = threading.Lock()
        # Poses of the frames that were prepared and not yet processed.
        self._ahead: deque[Posed] = deque()
        self.log, self.counts = FrameLog(), Counts()
        self.times_s: dict[int, float] = {}
        self.T_world_camera: dict[int, Float64Array] = {}
        # The last used frame of each camera with its pose; for each repetition of a frame, the index of that frame.
        self._last: dict[str, tuple[Frame, Posed]] = {}
        # Name of the camera of each frame of a rig, by index.
        self.camera_of: dict[int, str] = {}
        self._repeated: dict[int, int] = {}

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
            lost, the frame has no pose, its depth has no reading, or the reader skipped it.

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

    def prepare(self, frame: Frame) -> PreparedFrame:
        """Do the part of a frame's work that needs no map: `step` takes the result.

        A thread may do this for the next frames while `step` processes an earlier one; in order, and for each frame.
        What makes a frame unusable is kept until its turn.
        """
        clock = FrameClock()
        prepared = self._posed(frame)
        clock.lap("poses")
        if prepared.posed is not None:
            self._ahead.append(prepared.posed)
        images = None
        if prepared.posed is not None and self._preparing is not None:
            images = self._preparing.prepare(prepared.frame)
            clock.lap("proposals")
        return replace(prepared, images=images, milliseconds=clock.milliseconds)

    def step(self, frame: Frame | SkippedFrame | PreparedFrame, clock: FrameClock) -> FrameResult | SkippedFrame:
        """Process the next frame as `update` does, with a clock whose times the caller logs."""
        if not self._busy.acquire(blocking=False):
            raise CuboidError("Tracker.update: another thread is taking in a frame; frames come one after the other")
        try:
            self._check_order(frame.frame if isinstance(frame, PreparedFrame) else frame)
            if isinstance(frame, SkippedFrame):
                return self.skip(frame.index, frame.reason)
            prepared = frame if isinstance(frame, PreparedFrame) else self._posed(frame)
            if prepared is frame and prepared.posed is not None:
                self._ahead.popleft()
            if prepared.refused is not None:
                raise prepared.refused
            return self._step(prepared, clock)
        finally:
            self._busy.release()

    def leave_out_prepared(self) -> None:
        """Give up the frames that were prepared and not processed; the map follows the poses that they corrected."""
        while self._ahead:
            if moved := self._ahead.popleft().moved:
                self._mapper.apply_correction(moved)

    def _posed(self, frame: Frame) -> PreparedFrame:
        """Return a frame with its pose, or with the reason why it cannot be used."""
        try:
            check_images(frame, self.intrinsics)
        except FrameError as error:
            return PreparedFrame(frame, refused=error)
        if not frame.has_depth:
            return PreparedFrame(frame, reason=NO_DEPTH)
        # A copy: a camera may write the next frame into the same memory.
        frame = replace(frame, color=frame.color.copy(), depth_m=frame.depth_m.copy())
        try:
            return PreparedFrame(frame, self._located(frame))
        except FrameError as error:
            return PreparedFrame(frame, reason=str(error))

    def _step(self, prepared: PreparedFrame, clock: FrameClock) -> FrameResult | SkippedFrame:
        frame, posed = prepared.frame, prepared.posed
        self.times_s[frame.index] = frame.timestamp_s
        if frame.camera is not None:
            self.camera_of[frame.index] = frame.camera.name
        if posed is None:
            return self.skip(frame.index, prepared.reason)
        clock.lap("poses")
        try:
            if posed.moved:
                self._mapper.apply_correction(posed.moved)
                clock.lap("correction")
            result = self._mapped(frame.at(posed.T_world_camera), posed.anchor, prepared.images)
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

    def _mapped(self, frame: Frame, anchor: int, images: PreparedImages | None) -> FrameResult:
        """Give a posed frame to the tracker of posed frames."""
        if images is None or self._preparing is None:
            return self._mapper.update(frame, anchor)
        return self._preparing.update(frame, anchor, images)

    def _located(self, frame: Frame) -> Posed:
        """Return the pose of a frame; an exact repetition of the last one of its camera has the same."""
        last, posed = self._last.get(frame.camera_name, (None, None))
        if last is not None and posed is not None and frame.repeats(last):
            self._repeated[frame.index] = self._repeated.get(last.index, last.index)
            posed = replace(posed, moved={})
        else:
            posed = self._poses_for(frame).locate(frame)
        self._last[frame.camera_name] = frame, posed
        return posed

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
        """Restore the frames of an interrupted run: poses (4, 4) and times by index, skipped frames with reasons."""
        self.T_world_camera.update(T_world_camera)
        self.times_s.update(times_s)
        for index, reason in skipped:
            self.log.skip(index, reason)

    def _check_order(self, frame: Frame | SkippedFrame) -> None:
        """Raise FrameError if a caller's argument is no frame, or does not come after the last one."""
        if not isinstance(frame, Frame | SkippedFrame):
            raise FrameError(f"expected a cuboid.Frame, got {type(frame).__name__}")
        if self._last_index is not None and frame.index <= self._last_index:
            raise FrameError(f"frame {frame.index} comes after frame {self._last_index}; indices must increase")

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
    def gone_names(self) -> dict[int, str]:
        """Names from the detector of objects that left, by label."""
        found: dict[int, str] = getattr(self._mapper, "gone_names", {})
        return found

    @property
    def objects(self) -> ObjectTable:
        """The confirmed objects of the map, by label: a list, and a table for notebooks and pandas."""
        return ObjectTable(self._mapper.objects)

    @property
    def pose_warnings(self) -> tuple[str, ...]:
        """Corrections of the camera poses, and pixels that were left out for them, one line each."""
        return () if self._source is None else self._source.warnings()

    @property
    def pose_misfit(self) -> str | None:
        """Why given poses do not fit the frames; None if they fit, or are corrected, or are not checked."""
        return self._source.misfit if isinstance(self._source, CorrectedPoses) else None

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
        used = [(k, poses.get(self._repeated.get(k, k))) for k in sorted(self.T_world_camera)]
        return [PoseRow(self.times_s[k], T) for k, T in used if T is not None]

    @property
    def trajectory(self) -> dict[int, Float64Array]:
        """Corrected T_world_camera (4, 4) of each used frame, by its index."""
        poses = None if self._source is None else self._source.trajectory()
        if poses is None:
            return dict(self.T_world_camera)
        return {k: poses.get(self._repeated.get(k, k), T) for k, T in self.T_world_camera.items()}

    def _views(self, item: TrackedObject, max_views: int | None = None) -> list[ObjectView]:
        """Return the stored views of an object."""
        if self.kept_views is None:
            raise InputError("this tracker keeps no views of its objects: make it with shapes=True")
        return self.kept_views.views(item, self.trajectory, max_views)


def check_images(frame: Frame, intrinsics: Intrinsics) -> None:
    """Raise FrameError if the images of a frame have another size than its camera's, or its depth is not in metres."""
    (height, width), expected = frame.depth_m.shape, frame.intrinsics_or(intrinsics)
    if (width, height) != (expected.width, expected.height):
        raise FrameError(
            f"frame {frame.index} is {width} x {height} pixels, expected {expected.width} x {expected.height}"
        )
    refuse_other_units(frame)


def refuse_other_units(frame: Frame) -> None:
    """Raise FrameError if the depth of a frame is not in metres."""
    readings_m = frame.depth_m[::8, ::8]
    readings_m = readings_m[readings_m > 0]
    if len(readings_m) and float(np.median(readings_m)) > MAX_MEDIAN_DEPTH_M:
        raise FrameError(
            f"frame {frame.index}: the median depth is {shown(round(float(np.median(readings_m)), 1))} m; "
            "depth_m must be in metres, not in millimetres"
        )
