"""The loop over the frames of a recording: scale, track, draw, and stop if too many frames are unusable."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from cuboid.ground.compiling.compiletime import working_s
from cuboid.ground.core.downscaling import downscale
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Frame, SkippedFrame
from cuboid.inputs.readers.prefetch import run_ahead
from cuboid.method.poses.sources import LOST
from cuboid.runs.tracking.measuring import FrameClock
from cuboid.runs.tracking.running import RunningTracker
from cuboid.runs.tracking.types import Progress, Watch

if TYPE_CHECKING:
    from cuboid.results.views.video import FrameSink
    from cuboid.runs.scene.running import SceneRun


# Number of frames that are decoded ahead: enough to use two cores, few enough to limit memory.
FRAMES_AHEAD = 2


class Readable(Protocol):
    """An interface that returns frames by number."""

    def read(self, index: int) -> Frame:
        """Return a frame; raises FrameError if it is unusable."""


@dataclass(frozen=True, slots=True)
class Decoded:
    """A frame, or the reason why there is none.

    Attributes
    ----------
    index : int
        Index of the frame in the recording.
    frame : Frame or None
    reason : str
        Reason why there is no frame; empty if there is one.
    milliseconds : float
        Time of decoding, in any thread.
    """

    index: int
    frame: Frame | None
    reason: str
    milliseconds: float


def decode(recording: Readable, indices: range, *, ahead: bool) -> Generator[Decoded, None, None]:
    """Iterate over frames in order; closing the iterator ends its thread.

    Parameters
    ----------
    recording : Readable
    indices : range
        Frame indices of the recording.
    ahead : bool
        Decode the next frames in a thread while the caller processes the current one.
    """

    def read(index: int) -> Decoded:
        start_s = working_s()
        try:
            frame, reason = recording.read(index), ""
        except FrameError as error:
            frame, reason = None, str(error)
        return Decoded(index, frame, reason, (working_s() - start_s) * 1e3)

    decoded = (read(index) for index in indices)
    return run_ahead(decoded, FRAMES_AHEAD) if ahead else decoded


@dataclass(frozen=True, slots=True)
class Pipeline:
    """The stages of a frame: scaling, tracking, drawing."""

    path: Path
    planned: int | None
    tracker: RunningTracker
    scale: int
    view: FrameSink | None
    watch: Watch | None
    progress: Progress
    session: SceneRun | None = None

    def follow(self, frames: Iterable[Decoded], stop: Callable[[], bool]) -> bool:
        """Process all frames; return False if `stop` ended the loop early."""
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
        """Process one frame; return it as a `SkippedFrame` if it cannot be used."""
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
        # a lost camera is not a fault of the input
        bad = [(frame, why) for frame, why in self.tracker.log.skipped if why != LOST]
        if 2 * len(bad) > self.planned:
            first, why = bad[0]
            raise InputError(
                f"{self.path}: more than half of the {self.planned} frames cannot be used; "
                f"the first is frame {first}: {why}"
            )
