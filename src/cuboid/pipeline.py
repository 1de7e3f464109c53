"""What each frame of a recording passes through, and what is kept of it for the report."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from cuboid.decoding import Decoded
from cuboid.downscaling import downscale
from cuboid.errors import FrameError, InputError
from cuboid.frame import Float64Array
from cuboid.measuring import FrameClock, FrameLog
from cuboid.outputs import PoseRow, ResultWriter
from cuboid.posing import LOST, GivenPoses, Poses
from cuboid.run_types import Progress, RecordingLike, TrackerLike, Watch

if TYPE_CHECKING:
    from cuboid.scene.running import SceneRun
    from cuboid.views.video import FrameSink


@dataclass(frozen=True, slots=True)
class Pipeline:
    """What a frame passes through: scaling, posing, tracking, writing, drawing."""

    path: Path
    planned: int | None
    poses: Poses
    tracker: TrackerLike
    scale: int
    writer: ResultWriter | None
    view: FrameSink | None
    watch: Watch | None
    log: FrameLog
    progress: Progress
    session: SceneRun | None = None
    times_s: dict[int, float] = field(default_factory=dict)
    T_world_camera: dict[int, Float64Array] = field(default_factory=dict)
    skipped: list[tuple[int, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.session is not None:
            begun = self.session.begun
            self.times_s.update(begun.times_s)
            self.T_world_camera.update(begun.T_world_camera)
            self.skipped.extend(begun.skipped)

    def follow(self, frames: Iterable[Decoded], stop: Callable[[], bool]) -> bool:
        """Take in all frames; return False where `stop` ended it before."""
        for decoded in frames:
            if stop():
                return False
            if self.session is not None:
                self.session.next_frame()
            reason = self._step(decoded)
            if reason:
                self._skip(decoded.index, reason)
        return True

    def _step(self, decoded: Decoded) -> str:
        """Take in one frame; return why it cannot be used, or nothing."""
        frame = decoded.frame
        if frame is None:
            return decoded.reason
        self.times_s[frame.index] = frame.timestamp_s
        clock = FrameClock({"decode": decoded.milliseconds})
        small = downscale(frame, self.scale)
        if self.scale > 1:
            clock.lap("scale")
        try:
            posed = self.poses.locate(small)
            if type(self.poses) is not GivenPoses:
                clock.lap("poses")
            if posed.moved:
                self.tracker.apply_correction(posed.moved)
                clock.lap("correction")
            result = self.tracker.update(dataclasses.replace(small, T_world_camera=posed.T_world_camera), posed.anchor)
        except FrameError as error:
            return str(error)
        self.T_world_camera[frame.index] = posed.T_world_camera
        clock.laps(result.milliseconds)
        if self.writer is not None:
            self.writer.add(result, self.scale)
            clock.lap("write")
        if self.view is not None:
            self.view.show(frame, result, self.tracker.objects)
            clock.lap("draw")
        if self.watch is not None:
            self.watch(frame, result, self.tracker)
            clock.lap("live")
        self.log.use(clock.done(), result.left_out)
        self.progress.frame(result)
        return ""

    def warnings(self, recording: RecordingLike) -> tuple[str, ...]:
        """Return what is likely to be wrong with the recording; costs a second where results are written."""
        if self.writer is None:
            return self.poses.warnings()
        from cuboid.calibration.check import intrinsics_warning
        from cuboid.calibration.registering import registration_warning

        corrected = self.poses.trajectory()
        poses = self.T_world_camera if corrected is None else corrected
        estimated = corrected is not None and not self.poses.given_with_frames
        found = intrinsics_warning(recording.read, recording.intrinsics, poses, estimated=estimated)
        beside = registration_warning(recording.read, recording.intrinsics, sorted(poses))
        return (*self.poses.warnings(), *(one for one in (found, beside) if one is not None))

    def trajectory(self) -> list[PoseRow] | None:
        """Return the corrected poses of the frames that were used; None where none was corrected.

        Frames that were lost when they came get a pose when their place is found later; the tracker never used them.
        """
        poses = self.poses.trajectory()
        if poses is None:
            return None
        return [PoseRow(self.times_s[k], T) for k, T in sorted(poses.items()) if k in self.T_world_camera]

    def _skip(self, index: int, reason: str) -> None:
        self.log.skip(index, reason)
        self.skipped.append((index, reason))
        if self.session is not None:
            self.session.skip(index, reason)
        self.progress.skipped(index, reason)
        if self.planned is None:
            return
        bad = [(frame, why) for frame, why in self.log.skipped if why != LOST]  # a lost camera is no fault of the input
        if 2 * len(bad) > self.planned:
            first, why = bad[0]
            raise InputError(
                f"{self.path}: more than half of the {self.planned} frames cannot be used; "
                f"the first is frame {first}: {why}"
            )
