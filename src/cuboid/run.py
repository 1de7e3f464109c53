"""The loop over a recording: read, track, write, and a report of how it went."""

from __future__ import annotations

import sys
import time
from array import array
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from cuboid import __version__
from cuboid.config import TrackerConfig
from cuboid.decoding import Decoded, decode
from cuboid.downscaling import downscale
from cuboid.errors import FrameError, InputError, OutputError
from cuboid.frame import Float64Array, Frame, Intrinsics
from cuboid.outputs import ObjectsFile, ResultWriter, RunReport, Timing
from cuboid.outputs.folder import VIDEO
from cuboid.results import FrameResult, MapPoints, SupportPlane, TrackedObject

if TYPE_CHECKING:
    from cuboid.proposals.types import ProposalSource

SCALES = (1, 2, 4)

# The first used frames pay for compiling or loading the kernels and for filling caches: the stage times leave
# them out, unless the run is so short that hardly anything would be left.
WARM_UP_FRAMES = 10

VIDEO_FRAMES_PER_SECOND = 30.0
SLOWEST_VIDEO_FRAMES_PER_SECOND = 5.0


class RecordingLike(Protocol):
    """What the loop needs of a recording; `cuboid.open_recording` gives one."""

    @property
    def path(self) -> Path:
        """Where it lies."""

    @property
    def format(self) -> str:
        """Name of its layout."""

    @property
    def intrinsics(self) -> Intrinsics:
        """Pinhole of its images."""

    @property
    def has_poses(self) -> bool:
        """Whether camera poses come with it."""

    def __len__(self) -> int:
        """Return the number of frames, bad ones included."""

    def read(self, index: int) -> Frame:
        """Return a frame; raises FrameError for a bad one."""


class TrackerLike(Protocol):
    """What the loop needs of a tracker; `cuboid.Tracker` is one."""

    def update(self, frame: Frame) -> FrameResult:
        """Take in one frame."""

    @property
    def objects(self) -> list[TrackedObject]:
        """The confirmed objects."""

    @property
    def planes(self) -> list[SupportPlane]:
        """The supporting planes."""

    @property
    def up(self) -> Float64Array | None:
        """Up in the world."""

    def map_points(self) -> MapPoints:
        """Return the global point map."""


class Progress:
    """Told how a run goes; this one does nothing."""

    def start(self, frames: int) -> None:
        """Tell that a run over so many frames begins."""

    def frame(self, result: FrameResult) -> None:
        """Tell that a frame is done."""

    def skipped(self, index: int, reason: str) -> None:
        """Tell that a frame was skipped."""


class View(Protocol):
    """Draws frames as they are tracked."""

    def add(self, frame: Frame, result: FrameResult) -> None:
        """Draw one frame, at the recording's size."""


MakeTracker = Callable[[Intrinsics, TrackerConfig, "str | ProposalSource | None"], TrackerLike]
MakeView = Callable[[Path, Intrinsics, float], AbstractContextManager[View]]


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """What a run found and how it went.

    Attributes
    ----------
    report : RunReport
    objects : tuple of TrackedObject
    planes : tuple of SupportPlane
    up : (3,) float64 or None
    milliseconds : mapping of str to sequence of float
        For "frame" and each stage its time in every used frame, warm-up included.
    frames_per_second : float
        Used frames a second of the clock, after warm-up.
    """

    report: RunReport
    objects: tuple[TrackedObject, ...]
    planes: tuple[SupportPlane, ...]
    up: Float64Array | None
    milliseconds: Mapping[str, Sequence[float]]
    frames_per_second: float


def track_recording(
    recording: RecordingLike,
    output: Path | None,
    *,
    config: TrackerConfig | None = None,
    proposals: str | ProposalSource | None = None,
    poses: str | None = None,
    every: int = 1,
    limit: int | None = None,
    scale: int = 1,
    threads: int = 1,
    video: bool = False,
    force: bool = False,
    progress: Progress | None = None,
    stop: Callable[[], bool] = lambda: False,
    make_tracker: MakeTracker | None = None,
    make_view: MakeView | None = None,
) -> RunOutcome:
    """Track the objects of a recording and write the results.

    Parameters
    ----------
    recording : RecordingLike
        From `cuboid.open_recording`.
    output : Path or None
        Folder of the results; None writes nothing.
    config : TrackerConfig, optional
    proposals : str or ProposalSource, optional
        Name of a source of 2D proposals, with its options, or the source itself.
    poses : {"given", "estimated"}, optional
        Where the camera poses come from; the recording's own where it has them.
    every : int
        Use each n-th frame.
    limit : int, optional
        Read at most so many frames.
    scale : {1, 2, 4}
        Side in pixels of the block that becomes one pixel before tracking; results stay in the recording's
        pixels.
    threads : int
        With 2 or more, the next frames are decoded ahead in a thread of their own.
    video : bool
        Also write `labelled.mp4`.
    force : bool
        Replace results that lie in `output`.
    progress : Progress, optional
        Told how it goes.
    stop : callable
        Asked before each frame; True ends the run, whose results then say that they are not complete.
    make_tracker, make_view : callable, optional
        Make the tracker and the video; `cuboid.Tracker` and the labelled video unless given.

    Returns
    -------
    RunOutcome

    Raises
    ------
    InputError
        The recording has no poses, or more than half of its frames cannot be used; nothing is written then.
    OutputError
        The results cannot be written; nothing half-written is left.
    """
    begun_s = time.perf_counter()
    config = config or TrackerConfig()
    progress = progress or Progress()
    poses = _origin_of_poses(recording, poses)
    frames = range(0, len(recording), every)[:limit]
    if not frames:
        raise InputError(f"{recording.path}: the recording has no frames")
    with ExitStack() as results:
        writer = _writer(results, recording, output, force)
        tracker = (make_tracker or _tracker)(recording.intrinsics.downscaled(scale), config, proposals)
        log = _Log(recording.path, len(frames), progress)
        progress.start(len(frames))
        with _view(writer, recording, every, (make_view or _video) if video else None) as view:
            complete = True
            with closing(decode(recording, frames, ahead=threads > 1)) as stream:
                for decoded in stream:
                    if stop():
                        complete = False
                        break
                    _step(decoded, tracker, scale, writer, view, log)
        report = RunReport(
            version=__version__,
            complete=complete,
            recording=str(recording.path),
            format=recording.format,
            poses=poses,
            threads=threads,
            config=_effective(config, proposals, every, limit, scale),
            frames_read=log.read,
            frames_used=log.used,
            skipped=tuple(log.skipped),
            milliseconds=log.timings(),
            seconds=time.perf_counter() - begun_s,
            peak_memory_mb=peak_memory_mb(),
        )
        objects, planes, up = tuple(tracker.objects), tuple(tracker.planes), tracker.up
        if writer is not None:
            content = ObjectsFile(up, recording.intrinsics, planes, objects)
            writer.finish(content, tracker.map_points(), report)
    return RunOutcome(report, objects, planes, up, log.milliseconds, log.frames_per_second())


class _Log:
    """Counts frames, keeps the reasons of skipped ones and the times of used ones."""

    def __init__(self, path: Path, planned: int, progress: Progress) -> None:
        self.path = path
        self.planned = planned
        self.progress = progress
        self.used = 0
        self.skipped: list[tuple[int, str]] = []
        self.milliseconds: dict[str, array[float]] = {"frame": array("d")}
        self._finished_s = array("d")

    @property
    def read(self) -> int:
        return self.used + len(self.skipped)

    def skip(self, index: int, reason: str) -> None:
        """Count a bad frame; more than half of them end the run."""
        self.skipped.append((index, reason))
        self.progress.skipped(index, reason)
        if 2 * len(self.skipped) > self.planned:
            first, why = self.skipped[0]
            raise InputError(
                f"{self.path}: more than half of the {self.planned} frames cannot be used; "
                f"the first is frame {first}: {why}"
            )

    def use(self, result: FrameResult, milliseconds: Mapping[str, float]) -> None:
        """Count a used frame and its times."""
        self.used += 1
        self._finished_s.append(time.perf_counter())
        for stage, time_ms in milliseconds.items():
            # a stage that did no work in a frame took no time there
            values = self.milliseconds.setdefault(stage, array("d", [0.0] * (self.used - 1)))
            values.append(time_ms)
        for values in self.milliseconds.values():
            values.extend([0.0] * (self.used - len(values)))
        self.progress.frame(result)

    @property
    def _warm(self) -> int:
        return WARM_UP_FRAMES if self.used >= 2 * WARM_UP_FRAMES else 0

    def frames_per_second(self) -> float:
        """Return used frames a second of the clock after warm-up; 0 for fewer than two frames."""
        finished_s = self._finished_s[self._warm :]
        return (len(finished_s) - 1) / (finished_s[-1] - finished_s[0]) if len(finished_s) > 1 else 0.0

    def timings(self) -> dict[str, Timing]:
        """Return median and p95 of each stage after warm-up."""
        start = self._warm
        return {
            stage: Timing.of(values[start:]) for stage, values in self.milliseconds.items() if len(values)
        }


def _step(
    decoded: Decoded,
    tracker: TrackerLike,
    scale: int,
    writer: ResultWriter | None,
    view: View | None,
    log: _Log,
) -> None:
    """Take one frame through scaling, tracking, writing and drawing."""
    frame = decoded.frame
    if frame is None:
        return log.skip(decoded.index, decoded.reason)
    if frame.T_world_camera is None:
        return log.skip(decoded.index, "no camera pose")
    clock = _Clock({"decode": decoded.milliseconds})
    small = downscale(frame, scale)
    if scale > 1:
        clock.lap("scale")
    try:
        result = tracker.update(small)
    except FrameError as error:
        return log.skip(decoded.index, str(error))
    clock.laps(result.milliseconds)
    if writer is not None:
        writer.add(result, scale)
        clock.lap("write")
    if view is not None:
        view.add(frame, result)
        clock.lap("draw")
    log.use(result, clock.done())
    return None


class _Clock:
    """Milliseconds of the stages of one frame, "frame" for the whole of it."""

    def __init__(self, before: dict[str, float]) -> None:
        self._stages = before
        self._before_ms = sum(before.values())
        self._begun_s = self._last_s = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Give the time since the last lap to a stage."""
        now_s = time.perf_counter()
        self._stages[stage] = (now_s - self._last_s) * 1e3
        self._last_s = now_s

    def laps(self, milliseconds: Mapping[str, float]) -> None:
        """Take over times that were measured inside."""
        self._stages.update(milliseconds)
        self._last_s = time.perf_counter()

    def done(self) -> dict[str, float]:
        """Return the times of the whole and of the stages."""
        return {"frame": self._before_ms + (time.perf_counter() - self._begun_s) * 1e3, **self._stages}


def _origin_of_poses(recording: RecordingLike, poses: str | None) -> str:
    if poses == "estimated" or not recording.has_poses:
        why = "--poses estimated" if poses == "estimated" else f"{recording.path}: has no camera poses"
        raise InputError(f"{why}: this version tracks recordings with given poses only")
    return "given"


def _writer(
    results: ExitStack, recording: RecordingLike, output: Path | None, force: bool
) -> ResultWriter | None:
    if output is None:
        return None
    if output.resolve() == Path(recording.path).resolve():
        raise OutputError(f"{output}: is the recording itself; name another output folder")
    return results.enter_context(ResultWriter(output, force=force))


def _view(
    writer: ResultWriter | None, recording: RecordingLike, every: int, make: MakeView | None
) -> AbstractContextManager[View | None]:
    if make is None or writer is None:
        return nullcontext()
    rate = max(VIDEO_FRAMES_PER_SECOND / every, SLOWEST_VIDEO_FRAMES_PER_SECOND)
    return make(writer.file(VIDEO), recording.intrinsics, rate)


def _tracker(
    intrinsics: Intrinsics, config: TrackerConfig, proposals: str | ProposalSource | None
) -> TrackerLike:
    from cuboid.tracker import Tracker

    return Tracker(intrinsics, config, proposals)


def _video(path: Path, intrinsics: Intrinsics, frames_per_second: float) -> AbstractContextManager[View]:
    raise NotImplementedError


def _effective(
    config: TrackerConfig, proposals: str | ProposalSource | None, every: int, limit: int | None, scale: int
) -> dict[str, Any]:
    name = proposals if proposals is None or isinstance(proposals, str) else type(proposals).__qualname__
    return {
        "every": every,
        "limit": limit,
        "scale": scale,
        "proposals": name or "default",
        "tracker": config.to_dict(),
    }


def peak_memory_mb() -> float:
    """Return the largest amount of memory that this process has held, in units of 2**20 bytes."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage counts what the parent held before it started this process
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024.0
    import resource

    unit = 2**20 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
