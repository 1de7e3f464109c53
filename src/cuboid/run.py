"""The loop over a recording: read, track, write, and a report of how it went."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from cuboid import __version__
from cuboid.config import TrackerConfig
from cuboid.decoding import Decoded, decode
from cuboid.downscaling import downscale
from cuboid.errors import FrameError, InputError, OutputError
from cuboid.frame import Float64Array, Frame, Intrinsics
from cuboid.limits import MEMORY_MB
from cuboid.measuring import FrameClock, FrameLog, peak_memory_mb
from cuboid.object_table import ObjectTable
from cuboid.outputs import ObjectsFile, PoseRow, ResultWriter, RunReport
from cuboid.outputs.folder import REPORT, VIDEO
from cuboid.posing import LOST, POSES_MOVE, BridgedPoses, EstimatedPoses, GivenPoses, Poses
from cuboid.results import FrameResult, MapPoints, SupportPlane, TrackedObject
from cuboid.streaming import FrameSource, Stream

if TYPE_CHECKING:
    from cuboid.proposals.types import ProposalSource
    from cuboid.readers.depth_camera import DepthCamera
    from cuboid.scene.running import IntoScene, SceneRun
    from cuboid.views.report.pictures import Picture
    from cuboid.views.video import View

# The work inside shrinks with --scale to no less than this width, pixels: fewer show no objects.
MIN_WORKING_PX = 120
SCALES = (1, 2, 4)


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
    def distortion(self) -> tuple[float, ...]:
        """What the lens did to them, and was taken out; empty where nothing was."""

    @property
    def depth_units_per_metre(self) -> float:
        """Of its depth images."""

    @property
    def depth_camera(self) -> DepthCamera | None:
        """The camera that depth was carried from into color; None where it was aligned already."""

    @property
    def has_poses(self) -> bool:
        """Whether camera poses come with it."""

    def __len__(self) -> int:
        """Return the number of frames, bad ones included."""

    def read(self, index: int) -> Frame:
        """Return a frame; raises FrameError for a bad one."""

    def pose(self, index: int) -> Float64Array | None:
        """Return a frame's pose; raises FrameError where it has none."""

    def without_poses(self) -> RecordingLike:
        """Return the same recording without its poses."""


class TrackerLike(Protocol):
    """What the loop needs of a tracker; `cuboid.Tracker` is one."""

    def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
        """Take in one frame, whose pose hangs on a keyframe."""

    def carry(self, moved: Mapping[int, Float64Array]) -> None:
        """Move what was found with the keyframes."""

    @property
    def objects(self) -> list[TrackedObject]:
        """The confirmed objects."""

    @property
    def planes(self) -> list[SupportPlane]:
        """The supporting planes."""

    @property
    def up(self) -> Float64Array | None:
        """Up in the world."""

    @property
    def points_known(self) -> int:
        """Points of the global point map."""

    @property
    def map_bytes(self) -> int:
        """Memory of the global point map."""

    def map_points(self) -> MapPoints:
        """Return the global point map."""


class Progress:
    """Told how a run goes; this one does nothing."""

    def start(self, frames: int | None) -> None:
        """Tell that a run over so many frames begins; None where nobody knows how many."""

    def frame(self, result: FrameResult) -> None:
        """Tell that a frame is done."""

    def skipped(self, index: int, reason: str) -> None:
        """Tell that a frame was skipped."""


MakeTracker = Callable[[Intrinsics, TrackerConfig, "str | ProposalSource | None"], TrackerLike]
MakeView = Callable[[Path, Intrinsics, int], "View"]
Watch = Callable[[Frame, FrameResult, TrackerLike], None]


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
    points : int
        Points of the global point map at the end.
    map_bytes : int
        Memory of it.
    """

    report: RunReport
    objects: tuple[TrackedObject, ...]
    planes: tuple[SupportPlane, ...]
    up: Float64Array | None
    milliseconds: Mapping[str, Sequence[float]]
    frames_per_second: float
    points: int
    map_bytes: int

    def _repr_html_(self) -> str:
        """Show the objects, and how the run went, in a notebook."""
        report, found = self.report, ObjectTable(self.objects)
        line = f"{report.frames_used} of {report.frames_read} frames in {report.seconds:.1f} s"
        return f"{found._repr_html_()}<p>{line}</p>"


def track_recording(
    recording: RecordingLike | FrameSource,
    output: Path | None,
    *,
    config: TrackerConfig | None = None,
    proposals: str | ProposalSource | None = None,
    poses: str | None = None,
    bridge: bool = False,
    every: int = 1,
    limit: int | None = None,
    scale: int = 1,
    threads: int = 1,
    video: bool = False,
    force: bool = False,
    page: bool = True,
    progress: Progress | None = None,
    stop: Callable[[], bool] = lambda: False,
    make_tracker: MakeTracker | None = None,
    make_view: MakeView | None = None,
    watch: Watch | None = None,
    into: IntoScene | None = None,
    memory_mb: float = MEMORY_MB,
) -> RunOutcome:
    """Track the objects of a recording and write the results.

    Parameters
    ----------
    recording : RecordingLike or FrameSource
        From `cuboid.open_recording` or `cuboid.open_camera`.
    output : Path or None
        Folder of the results; None writes nothing.
    config : TrackerConfig, optional
    proposals : str or ProposalSource, optional
        Name of a source of 2D proposals, with its options, or the source itself.
    poses : {"given", "estimated"}, optional
        Where the camera poses come from; the recording's own where it has them, else from the video.
    bridge : bool
        Let the video tell the poses of frames that the recording has none of.
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
    page : bool
        Also write the 3D page; `write_page` does it later.
    progress : Progress, optional
        Told how it goes.
    stop : callable
        Asked before each frame; True ends the run, whose results then say that they are not complete.
    make_tracker, make_view : callable, optional
        Make the tracker and the video; `cuboid.Tracker` and the labelled video unless given.
    watch : callable, optional
        Shown each used frame, what was found in it, and the tracker, between two frames of its work.
    into : IntoScene, optional
        The scene that the recording goes into.
    memory_mb : float
        Memory of the process, in units of 2**20 bytes, beyond which parts of the map that are out of view are put
        aside.

    Returns
    -------
    RunOutcome

    Raises
    ------
    InputError
        The recording has no poses though they are to be taken from it, or more than half of its frames cannot be
        used; nothing is written then.
    OutputError
        The results cannot be written; nothing half-written is left.
    """
    if scale not in SCALES or every < 1 or (limit is not None and limit < 1):
        raise ValueError(f"scale must be one of {SCALES}, every and limit >= 1, got {scale}, {every}, {limit}")
    begun_s = time.perf_counter()
    config, proposals = _at_scale(config or TrackerConfig(), proposals, scale)
    progress = progress or Progress()
    live = recording if isinstance(recording, FrameSource) else None
    if isinstance(recording, FrameSource):
        recording = Stream(recording)
    poses = _origin_of_poses(recording, poses, bridge)
    frames = range(0) if isinstance(recording, Stream) else range(0, len(recording), every)[:limit]
    planned = None if isinstance(recording, Stream) else len(frames)
    if planned == 0:
        raise InputError(f"{recording.path}: the recording has no frames")
    with ExitStack() as results:
        writer = _writer(results, recording, output, force, poses)
        source, camera = _poses(recording, poses, bridge, scale, config)
        bare = recording if source.given_with_frames else recording.without_poses()
        settings = _effective(config, proposals, every, limit, scale, bridge, recording)
        log, session = FrameLog(), None
        tracker: TrackerLike
        if into is None:
            tracker = (make_tracker or partial(_tracker, memory_mb))(camera, config, proposals)
        else:
            session = results.enter_context(
                _session(into, recording, poses, camera, config, proposals, settings, memory_mb)
            )
            tracker, source = session.tracker, session.poses(source)
            frames = session.go_on(frames, writer)
            planned = None if planned is None else len(frames)
        progress.start(planned)
        view_of = (make_view or _video) if video else None
        with (
            _view(writer, recording, every, view_of) as view,
            closing(_decode(bare, frames, every, limit, ahead=threads > 1)) as decoded,
        ):
            pipeline = _Pipeline(
                recording.path, planned, source, tracker, scale, writer, view, watch, log, progress, session
            )
            complete = pipeline.follow(decoded, stop)
        if complete and not pipeline.T_world_camera and poses == "estimated":
            raise InputError(
                f"{recording.path}: no camera pose can be estimated: no frame has enough depth and texture"
            )
        report = RunReport(
            version=__version__,
            complete=complete,
            recording=str(recording.path),
            format=recording.format,
            poses=poses,
            threads=threads,
            config=settings,
            frames_read=len(pipeline.T_world_camera) + len(pipeline.skipped),
            frames_used=len(pipeline.T_world_camera),
            skipped=tuple(pipeline.skipped),
            milliseconds=log.timings(),
            seconds=time.perf_counter() - begun_s,
            peak_memory_mb=peak_memory_mb(),
            warnings=(*(live.warnings if live else ()), *pipeline.warnings(bare)),
            frames_dropped=live.dropped if live else 0,
            limits=log.limits(),
        )
        objects, planes, up = tuple(tracker.objects), tuple(tracker.planes), tracker.up
        if writer is not None:
            content = ObjectsFile(up, recording.intrinsics, planes, objects)
            writer.finish(content, tracker.map_points(), report, pipeline.trajectory())
        if session is not None:
            session.finish(complete=complete)
    if output is not None and page:
        write_page(output, recording)
    return RunOutcome(
        report, objects, planes, up, log.milliseconds, log.frames_per_second(), tracker.points_known, tracker.map_bytes
    )


@dataclass(frozen=True, slots=True)
class _Pipeline:
    """What a frame passes through: scaling, posing, tracking, writing, drawing."""

    path: Path
    planned: int | None
    poses: Poses
    tracker: TrackerLike
    scale: int
    writer: ResultWriter | None
    view: View | None
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
            if not self.poses.given_with_frames:
                clock.lap("poses")
            if posed.moved:
                self.tracker.carry(posed.moved)
                clock.lap("carry")
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
            return ()
        from cuboid.calibration.check import intrinsics_warning
        from cuboid.calibration.registering import registration_warning

        corrected = self.poses.trajectory()
        poses = self.T_world_camera if corrected is None else corrected
        found = intrinsics_warning(recording.read, recording.intrinsics, poses, estimated=corrected is not None)
        beside = registration_warning(recording.read, recording.intrinsics, sorted(poses))
        return tuple(one for one in (found, beside) if one is not None)

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


def _decode(
    recording: RecordingLike, frames: range, every: int, limit: int | None, *, ahead: bool
) -> Generator[Decoded, None, None]:
    if isinstance(recording, Stream):
        return recording.decode(every, limit, ahead=ahead)
    return decode(recording, frames, ahead=ahead)


def _session(
    into: IntoScene,
    recording: RecordingLike,
    poses: str,
    camera: Intrinsics,
    config: TrackerConfig,
    proposals: str | ProposalSource | None,
    settings: dict[str, Any],
    memory_mb: float,
) -> AbstractContextManager[SceneRun]:
    from cuboid.scene import Source

    if isinstance(recording, Stream):
        path, frames = str(recording.path), 0
    else:
        path, frames = str(Path(recording.path).resolve()), len(recording)
    source = Source(path, recording.format, poses, frames, recording.intrinsics, settings)
    return into.session(source, camera, config, proposals, memory_mb)


def _origin_of_poses(recording: RecordingLike, poses: str | None, bridge: bool) -> str:
    origin = poses or ("given" if recording.has_poses else "estimated")
    if origin == "given" and not recording.has_poses:
        raise InputError(f"{recording.path}: has no camera poses; --poses estimated takes them from the video")
    if bridge and origin != "given":
        raise InputError(f"{recording.path}: --bridge fills gaps between given poses, and there are none in use")
    return origin


def _poses(
    recording: RecordingLike, origin: str, bridge: bool, scale: int, config: TrackerConfig
) -> tuple[Poses, Intrinsics]:
    """Return where poses come from, and the pinhole of the frames it is asked about."""
    camera = recording.intrinsics.downscaled(scale)
    if bridge:
        return BridgedPoses(camera, recording.pose), camera
    return (GivenPoses() if origin == "given" else EstimatedPoses(camera, POSES_MOVE * config.voxel_m)), camera


def _writer(
    results: ExitStack, recording: RecordingLike, output: Path | None, force: bool, poses: str
) -> ResultWriter | None:
    if output is None:
        return None
    if output.resolve() == Path(recording.path).resolve():
        raise OutputError(f"{output}: is the recording itself; name another output folder")
    return results.enter_context(ResultWriter(output, force=force, corrected=poses == "estimated"))


@contextmanager
def _view(
    writer: ResultWriter | None, recording: RecordingLike, every: int, make: MakeView | None
) -> Iterator[View | None]:
    if make is None or writer is None:
        yield None
        return
    with writer.naming(VIDEO) as path:
        view = make(path, recording.intrinsics, every)
        try:
            yield view
        except BaseException:
            view.close(complete=False)
            raise
        view.close(complete=True)


def write_page(output: Path, recording: RecordingLike) -> Mapping[int, Picture]:
    """Write the 3D page of the results that lie in the output folder now; return its pictures of objects, by label."""
    from cuboid.views.report import summarise, write_report

    summary = summarise(output, recording.read)
    write_report(output / REPORT, summary)
    return summary.pictures


def _tracker(
    memory_mb: float, intrinsics: Intrinsics, config: TrackerConfig, proposals: str | ProposalSource | None
) -> TrackerLike:
    from cuboid.tracker import Tracker

    return Tracker(intrinsics, config, proposals, memory_mb=memory_mb)


def _video(path: Path, intrinsics: Intrinsics, every: int) -> View:
    from cuboid.views.video import VideoView, video_rate

    return VideoView(path, intrinsics, video_rate(every))


def _at_scale(
    config: TrackerConfig, proposals: str | ProposalSource | None, scale: int
) -> tuple[TrackerConfig, str | ProposalSource | None]:
    """Let the work inside shrink with the frames: who asks for half the resolution asks for speed."""
    if scale == 1:
        return config, proposals
    from cuboid.proposals.depth import WIDEST

    width = max(MIN_WORKING_PX, config.working_width_px // scale)
    if proposals in (None, "depth"):
        proposals = f"depth:{max(MIN_WORKING_PX, WIDEST // scale)}"
    return dataclasses.replace(config, working_width_px=width), proposals


def _effective(
    config: TrackerConfig,
    proposals: str | ProposalSource | None,
    every: int,
    limit: int | None,
    scale: int,
    bridge: bool,
    recording: RecordingLike,
) -> dict[str, Any]:
    from cuboid.proposals import DEFAULT_SOURCE

    source = DEFAULT_SOURCE if proposals is None else proposals
    return {
        "every": every,
        "limit": limit,
        "scale": scale,
        "bridge": bridge,
        "distortion": list(recording.distortion),
        "depth_units_per_metre": recording.depth_units_per_metre,
        **(recording.depth_camera.document() if recording.depth_camera is not None else {}),
        "proposals": source if isinstance(source, str) else type(source).__qualname__,
        "tracker": config.to_dict(),
    }
