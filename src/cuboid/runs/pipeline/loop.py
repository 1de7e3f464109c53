"""The loop over the frames of a recording: scale, track, draw, and stop if too many frames are unusable."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from cuboid.ground.compiling.compiletime import compiling_s, waited_for_compiling, working_s
from cuboid.ground.core.downscaling import downscale
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Frame, SkippedFrame
from cuboid.inputs.readers.prefetch import run_ahead
from cuboid.method.poses.sources import LOST
from cuboid.runs.tracking.measuring import FrameClock
from cuboid.runs.tracking.running import RunningTracker
from cuboid.runs.tracking.types import PreparedFrame, Progress, Watch

if TYPE_CHECKING:
    from cuboid.inputs.calibration.rig_check import RigWatch
    from cuboid.results.views.video import FrameSink
    from cuboid.runs.scene.running import SceneRun


# Number of frames that are in work or ready ahead of the present one: enough to use two cores, few enough to limit
# memory. Of a live camera it is one, which bounds the delay.
FRAMES_AHEAD, LIVE_FRAMES_AHEAD = 2, 1


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
    prepared : PreparedFrame, optional
        The scaled frame, after the part of its work that needs no map.
    compiling_s : float
        Time for which kernels were compiled for that, seconds.
    """

    index: int
    frame: Frame | None
    reason: str
    milliseconds: float
    prepared: PreparedFrame | None = None
    compiling_s: float = 0.0


def decode(recording: Readable, indices: Sequence[int], *, ahead: bool) -> Generator[Decoded, None, None]:
    """Iterate over frames in order; closing the iterator ends its thread.

    Parameters
    ----------
    recording : Readable
    indices : sequence of int
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


def prepare_ahead(
    decoded: Iterable[Decoded], prepare: Callable[[Decoded], Decoded], frames: int
) -> Generator[Decoded, None, None]:
    """Prepare the next frames in a thread while the caller processes the present one; closing ends the thread.

    Parameters
    ----------
    decoded : iterable of Decoded
    prepare : callable
    frames : int
        Number of frames ahead of the present one.
    """

    def prepared(one: Decoded) -> Decoded:
        begun_s = compiling_s()
        made = prepare(one)
        return replace(made, compiling_s=compiling_s() - begun_s)

    with closing(run_ahead(map(prepared, decoded), frames)) as ready:
        while True:
            begun_s = time.perf_counter()
            one = next(ready, None)
            if one is None:
                return
            waited_for_compiling(min(one.compiling_s, time.perf_counter() - begun_s))
            yield one


@dataclass(frozen=True, slots=True)
class Pipeline:
    """The stages of a frame: scaling, tracking, drawing.

    Attributes
    ----------
    rig_watch : RigWatch or None
        Takes each frame of a fixed rig.
    problems : sequence of sequences of str
        Growing lists of warnings, which `progress` gets as soon as they are there.
    reported : set of str
        The warnings that it got.
    """

    path: Path
    planned: int | None
    tracker: RunningTracker
    scale: int
    view: FrameSink | None
    watch: Watch | None
    progress: Progress
    session: SceneRun | None = None
    rig_watch: RigWatch | None = None
    problems: Sequence[Sequence[str]] = ()
    reported: set[str] = field(default_factory=set)

    def follow(self, frames: Iterable[Decoded], stop: Callable[[], bool]) -> bool:
        """Process all frames; return False if `stop` ended the loop early."""
        for decoded in frames:
            if stop():
                return False
            if self.session is not None:
                self.session.tracker.commit_if_due()
            skipped = self._step(decoded)
            if skipped is not None:
                self._skip(skipped)
            self._warn()
        return True

    def _warn(self) -> None:
        """Report the new problems."""
        for line in chain.from_iterable(self.problems):
            if line not in self.reported:
                self.reported.add(line)
                self.progress.warning(line)

    def prepare(self, decoded: Decoded) -> Decoded:
        """Do the part of a frame's work that needs no map; a thread may do this for the next frames."""
        if decoded.frame is None:
            return decoded
        clock = FrameClock()
        small = self._scaled(decoded.frame, clock)
        prepared = self.tracker.prepare(small)
        return replace(
            decoded, prepared=replace(prepared, milliseconds={**clock.milliseconds, **prepared.milliseconds})
        )

    def _scaled(self, frame: Frame, clock: FrameClock) -> Frame:
        small = downscale(frame, self.scale)
        if self.scale > 1:
            clock.lap("scale")
        return small

    def _step(self, decoded: Decoded) -> SkippedFrame | None:
        """Process one frame; return it as a `SkippedFrame` if it cannot be used."""
        frame, tracker, prepared = decoded.frame, self.tracker, decoded.prepared
        if frame is None:
            return tracker.skip(decoded.index, decoded.reason)
        if self.rig_watch is not None:
            self.rig_watch.add(frame)
        clock = FrameClock({"decode": decoded.milliseconds, **(prepared.milliseconds if prepared else {})})
        try:
            result = tracker.step(self._scaled(frame, clock) if prepared is None else prepared, clock)
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
