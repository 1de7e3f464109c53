"""Track a recording: read, track, write results and a report."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid import __version__
from cuboid.core.compiletime import working_s
from cuboid.core.config import TrackerConfig
from cuboid.core.errors import InputError, OutputError
from cuboid.core.frame import Intrinsics
from cuboid.core.limits import MEMORY_MB
from cuboid.core.paths import PathLike, as_path
from cuboid.formats.reading import real_path
from cuboid.outputs import Results, ResultWriter, RunReport
from cuboid.outputs.folder import VIDEO
from cuboid.pipeline.loop import Decoded, Pipeline, decode
from cuboid.pipeline.plan import Plan, plan_for
from cuboid.pipeline.streaming import FrameSource, Stream
from cuboid.poses.sources import AUTO, CORRECTED, ESTIMATED, GIVEN, Poses
from cuboid.tracking.checks import checked_warnings
from cuboid.tracking.measuring import peak_memory_mb
from cuboid.tracking.saving import objects_file, write_page
from cuboid.tracking.tracker import Tracker
from cuboid.tracking.types import MakeFrameSink, MakeTracker, Progress, RecordingLike, RunOutcome, TrackerLike, Watch

if TYPE_CHECKING:
    from cuboid.detection.types import Detector
    from cuboid.proposals.types import ProposalSource
    from cuboid.scene.running import IntoScene, SceneRun
    from cuboid.views.video import FrameSink


def track_recording(
    recording: RecordingLike | FrameSource,
    output: PathLike | None,
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
    make_view: MakeFrameSink | None = None,
    watch: Watch | None = None,
    into: IntoScene | None = None,
    memory_mb: float = MEMORY_MB,
    detector: str | Detector | None = None,
    detector_every: int | None = None,
    shapes: bool = False,
    relations: bool = False,
    furniture: bool = False,
) -> RunOutcome:
    """Track the objects of a recording and write the results.

    Parameters
    ----------
    recording : RecordingLike or FrameSource
        From `cuboid.open_recording` or `cuboid.open_camera`.
    output : path or None
        Folder of the results; None writes nothing.
    config : TrackerConfig, optional
    proposals : str or ProposalSource, optional
        Name of a source of 2D proposals, with its options, or the source itself.
    poses : {"given", "auto", "corrected", "estimated"}, optional
        Source of the camera poses, as for `Tracker`; by default given if the recording has poses, else estimated.
    bridge : bool
        Estimate poses from the video for frames without one.
    every : int
        Use each n-th frame.
    limit : int, optional
        Read at most this many frames.
    scale : {1, 2, 4}
        Side in pixels of the block that becomes one pixel before tracking; results stay in the recording's
        pixels.
    threads : int
        With 2 or more, the next frames are decoded ahead in a separate thread.
    video : bool
        Also write `labelled.mp4`.
    force : bool
        Replace existing results in `output`.
    page : bool
        Also write the 3D page; `write_page` can write it later.
    progress : Progress, optional
        Receives the progress of the run.
    stop : callable
        Called before each frame; True ends the run, and its results are marked as incomplete.
    make_tracker, make_view : callable, optional
        Factories of the tracker and of the video; by default `cuboid.Tracker` and the labelled video.
    watch : callable, optional
        Called between frames with each used frame, its result, and the tracker.
    into : IntoScene, optional
        The scene to which the recording is added.
    memory_mb : float
        Memory limit of the process, in units of 2**20 bytes, above which parts of the map out of view are evicted.
    detector : str or Detector, optional
        File of an ONNX model, or name of a detector, with its options; or any callable from (frame, intrinsics) to
        `Detections`. Objects get names from it.
    detector_every : int, optional
        The detector processes each n-th used frame; 3 by default.
    shapes : bool
        Also keep views of the objects, as for `Tracker`.
    relations : bool
        Also find the relations of the objects at the end, and include them in the results and in the scene.
    furniture : bool
        Also find the furniture that bears the supporting planes at the end, and keep it in the results; in a scene it
        keeps its labels.

    Returns
    -------
    RunOutcome

    Raises
    ------
    InputError
        If the poses of the recording are required and it has none, or if more than half of its frames cannot be
        used; then nothing is written.
    OutputError
        If the results cannot be written; no partial results are left.
    """
    begun_s = working_s()
    output = None if output is None else as_path(output)
    taken: RecordingLike = Stream(recording) if isinstance(recording, FrameSource) else recording
    config = config or TrackerConfig()
    plan = plan_for(
        taken, config, proposals, poses=poses, bridge=bridge, every=every, limit=limit, scale=scale,
        detector=detector, detector_every=detector_every,
    )  # fmt: skip
    if into is not None and plan.poses in (AUTO, CORRECTED):
        raise InputError(f"{taken.path}: --poses {plan.poses} cannot go into a scene; use given or estimated")
    settings, frames, progress = plan.settings(taken), _frames(taken, plan), progress or Progress()
    with ExitStack() as results:
        corrected = plan.poses == ESTIMATED if into is None else into.corrects(plan.poses)
        writer = _writer(results, taken, output, force, corrected)
        tracker, source, session = _tracking(
            results, taken, plan, settings, writer, make_tracker, into, memory_mb, shapes
        )
        if session is not None:
            frames = session.go_on(frames, writer)
        planned = None if isinstance(taken, Stream) else len(frames)
        progress.start(planned)
        bare = taken if source.given_with_frames else taken.without_poses()
        with (
            _view(writer, taken, every, (make_view or _video) if video else None) as view,
            closing(_decode(bare, frames, plan, ahead=threads > 1)) as decoded,
        ):
            pipeline = Pipeline(taken.path, planned, tracker, scale, view, watch, progress, session)
            complete = pipeline.follow(decoded, stop)
        if complete and not tracker.T_world_camera and plan.poses == ESTIMATED:
            raise InputError(f"{taken.path}: no camera pose can be estimated: no frame has enough depth and texture")
        warnings = tracker.warnings if writer is None else checked_warnings(tracker, bare, every)
        report = _report(taken, tracker, session, settings, complete, threads, begun_s, warnings)
        points = tracker.map_points()
        found = objects_file(tracker, taken.intrinsics, points, relations=relations, furniture=furniture)
        if writer is not None:
            writer.finish(found, points, report, tracker.corrected_trajectory(), tracker.kept_views)
        if session is not None:
            session.finish(complete=complete, walls=found.walls if relations else None)
    if output is not None and page:
        write_page(Results(output), taken.read, () if into is None else into.shown_changes())
    log, known, size = tracker.log, tracker.points_known, tracker.map_bytes
    return RunOutcome(
        report, found.objects, found.planes, found.up, log.milliseconds, log.frames_per_second(), known, size,
        found.furniture,
    )  # fmt: skip


def _frames(recording: RecordingLike, plan: Plan) -> range:
    """Return the frames to read; an empty range for a camera, whose frames are not known in advance."""
    if isinstance(recording, Stream):
        return range(0)
    frames = range(0, len(recording), plan.every)[: plan.limit]
    if not frames:
        raise InputError(f"{recording.path}: the recording has no frames")
    return frames


def _tracking(
    results: ExitStack,
    recording: RecordingLike,
    plan: Plan,
    settings: dict[str, Any],
    writer: ResultWriter | None,
    make_tracker: MakeTracker | None,
    into: IntoScene | None,
    memory_mb: float,
    shapes: bool,
) -> tuple[Tracker, Poses, SceneRun | None]:
    """Return the tracker, the source of its poses, and the run within a scene, if the recording is added to one."""
    camera = recording.intrinsics.downscaled(plan.scale)
    source = plan.source_of_poses(recording, camera)
    write = None if writer is None else partial(writer.add, pixels=plan.scale)
    if into is None:
        make = make_tracker or partial(_tracker, memory_mb=memory_mb)
        mapper = make(camera, plan.config, plan.proposals)
        if plan.detector is not None:
            _use_detector(mapper, plan)
        return Tracker.of_parts(camera, plan.config, mapper, source, write, shapes=shapes), source, None
    from cuboid.scene import Source

    live = isinstance(recording, Stream)
    path, frames = (recording.path, 0) if live else (Path(recording.path).resolve(), len(recording))
    visit = Source(str(path), recording.format, plan.poses, frames, recording.intrinsics, settings)
    session = results.enter_context(into.session(visit, camera, plan.config, plan.proposals, memory_mb))
    session.tracker.use_detector(plan.detector, plan.detector_every)
    source = session.poses(source)
    tracker = Tracker.of_parts(camera, plan.config, session.tracker, source, write, shapes=shapes)
    tracker.resume(session.begun.T_world_camera, session.begun.times_s, session.begun.skipped)
    return tracker, source, session


def _decode(recording: RecordingLike, frames: range, plan: Plan, *, ahead: bool) -> Generator[Decoded, None, None]:
    if isinstance(recording, Stream):
        return recording.decode(plan.every, plan.limit, ahead=ahead)
    return decode(recording, frames, ahead=ahead)


def _report(
    recording: RecordingLike,
    tracker: Tracker,
    session: SceneRun | None,
    settings: dict[str, Any],
    complete: bool,
    threads: int,
    begun_s: float,
    warnings: tuple[str, ...],
) -> RunReport:
    live = recording.source if isinstance(recording, Stream) else None
    used, skipped = len(tracker.T_world_camera), tuple(tracker.log.skipped)
    return RunReport(
        version=__version__,
        complete=complete,
        recording=str(recording.path),
        format=recording.format,
        poses=tracker.poses or GIVEN,
        threads=threads,
        config={**settings, **_vocabulary(tracker), "tracker": tracker.config.to_dict()},
        frames_read=used + len(skipped),
        frames_used=used,
        skipped=skipped,
        milliseconds=tracker.log.timings(),
        seconds=working_s() - begun_s,
        peak_memory_mb=peak_memory_mb(),
        warnings=(*recording.warnings, *(session.warnings() if session else ()), *warnings),
        frames_dropped=live.dropped if live else 0,
        limits=tracker.log.limits(),
    )


def _vocabulary(tracker: Tracker) -> dict[str, Any]:
    """Return the classes of the detector, if one was used."""
    return {"vocabulary": list(tracker.vocabulary)} if tracker.vocabulary else {}


def _writer(
    results: ExitStack, recording: RecordingLike, output: Path | None, force: bool, corrected: bool
) -> ResultWriter | None:
    if output is None:
        return None
    if real_path(output) == real_path(Path(recording.path)):
        raise OutputError(f"{output}: is the recording itself; name another output folder")
    return results.enter_context(ResultWriter(output, force=force, corrected=corrected))


@contextmanager
def _view(
    writer: ResultWriter | None, recording: RecordingLike, every: int, make: MakeFrameSink | None
) -> Iterator[FrameSink | None]:
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


def _tracker(
    intrinsics: Intrinsics, config: TrackerConfig, proposals: str | ProposalSource | None, *, memory_mb: float
) -> TrackerLike:
    from cuboid.tracking.posed_tracker import PosedTracker

    return PosedTracker(intrinsics, config, proposals, memory_mb=memory_mb)


def _use_detector(mapper: TrackerLike, plan: Plan) -> None:
    from cuboid.tracking.posed_tracker import PosedTracker

    if not isinstance(mapper, PosedTracker):
        raise ValueError(f"a detector needs the tracker of Cuboid, not a {type(mapper).__name__}")
    mapper.use_detector(plan.detector, plan.detector_every)


def _video(path: Path, intrinsics: Intrinsics, every: int) -> FrameSink:
    from cuboid.views.video import VideoView, video_rate

    return VideoView(path, intrinsics, video_rate(every))
