"""The loop over the frames of a recording: scale, track, draw, and give up where too many frames are bad."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cuboid.core.downscaling import downscale
from cuboid.core.errors import FrameError, InputError
from cuboid.core.frame import SkippedFrame
from cuboid.pipeline.decoding import Decoded
from cuboid.poses.sources import LOST
from cuboid.tracking.measuring import FrameClock
from cuboid.tracking.tracker import Tracker
from cuboid.tracking.types import Progress, Watch

if TYPE_CHECKING:
    from cuboid.scene.running import SceneRun
    from cuboid.views.video import FrameSink


@dataclass(frozen=True, slots=True)
class Pipeline:
    """The stages of a frame: scaling, tracking, drawing."""

    path: Path
    planned: int | None
    tracker: Tracker
    scale: int
    view: FrameSink | None
    watch: Watch | None
    progress: Progress
    session: SceneRun | None = None

    def follow(self, frames: Iterable[Decoded], stop: Callable[[], bool]) -> bool:
        """Take in all frames; return False where `stop` ended it before."""
        for decoded in frames:
            if stop():
                return False
            if self.session is not None:
                self.session.next_frame()
            skipped = self._step(decoded)
            if skipped is not None:
                self._skip(skipped)
        return True

    def _step(self, decoded: Decoded) -> SkippedFrame | None:
        """Take in one frame; return it where it cannot be used."""
        frame, tracker = decoded.frame, self.tracker
        if frame is None:
            return tracker.skip(decoded.index, decoded.reason)
        clock = FrameClock({"decode": decoded.milliseconds})
        small = downscale(frame, self.scale)
        if self.scale > 1:
            clock.lap("scale")
        try:
            result = tracker.step(small, clock)
        except FrameError as error:
            return tracker.skip(decoded.index, str(error))
        if isinstance(result, SkippedFrame):
            return result
        if self.view is not None:
            self.view.show(frame, result, tracker.objects)
            clock.lap("draw")
        if self.watch is not None:
            self.watch(frame, result, tracker)
            clock.lap("live")
        tracker.log.use(clock.done(), result.left_out)
        self.progress.frame(result)
        return None

    def _skip(self, skipped: SkippedFrame) -> None:
        if self.session is not None:
            self.session.skip(skipped.index, skipped.reason)
        self.progress.skipped(skipped.index, skipped.reason)
        if self.planned is None:
            return
        # a lost camera is no fault of the input
        bad = [(frame, why) for frame, why in self.tracker.log.skipped if why != LOST]
        if 2 * len(bad) > self.planned:
            first, why = bad[0]
            raise InputError(
                f"{self.path}: more than half of the {self.planned} frames cannot be used; "
                f"the first is frame {first}: {why}"
            )
