"""Track a recording: read, track, write results and a report."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from cuboid.ground.compiling.compiletime import working_s
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.frame import Intrinsics, RigCamera
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.core.threads import return_free_memory
from cuboid.ground.formats.folder import VIDEO
from cuboid.ground.formats.reading import real_path
from cuboid.ground.formats.rig_file import FIXED
from cuboid.ground.version import __version__
from cuboid.inputs.recordings.rig import RigRecording
from cuboid.method.poses.sources import AUTO, CORRECTED, ESTIMATED, GIVEN, Poses
from cuboid.results.files import Results, ResultWriter, RunReport
from cuboid.runs.pipeline.loop import FRAMES_AHEAD, LIVE_FRAMES_AHEAD, Decoded, Pipeline, decode, prepare_ahead
from cuboid.runs.pipeline.options import ResultOptions, RunHooks, TrackOptions
from cuboid.runs.pipeline.plan import Plan, plan_for
from cuboid.runs.pipeline.streaming import FrameSource, RigStream, Stream, stream_of
from cuboid.runs.tracking.checks import checked_warnings, own_warnings
from cuboid.runs.tracking.measuring import peak_memory_mb
from cuboid.runs.tracking.running import RunningTracker
from cuboid.runs.tracking.saving import objects_file, write_page
from cuboid.runs.tracking.types import MakeFrameSink, MakeTracker, RecordingLike, RigLike, RunOutcome, TrackerLike

if TYPE_CHECKING:
    from cuboid.inputs.calibration.rig_check import RigWatch
    from cuboid.method.proposals.types import ProposalSource
    from cuboid.results.views.video import FrameSink
    from cuboid.runs.scene.running import IntoScene, SceneRun


def track_recording(
    recording: RecordingLike | FrameSource,
    output: PathLike | None,
    options: TrackOptions | None = None,
    *,
    results: ResultOptions | None = None,
    into: IntoScene | None = None,
    hooks: RunHooks | None = None,
) -> RunOutcome:
    """Track the objects of a recording and write the results.

    Parameters
    ----------
    recording : RecordingLike or FrameSource
        From `cuboid.open_recording` or `cuboid.open_camera`.
    output : path or None
        Folder of the results; None writes nothing.
    options : TrackOptions, optional
        How the recording is tracked.
    results : ResultOptions, optional
        Which results are made.
    into : IntoScene, optional
        The scene to which the recording is added.
    hooks : RunHooks, optional
        Who follows and stops the run.

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

    Examples
    --------
    >>> recording = cuboid.open_recording("my-recording")  # doctest: +SKIP
    >>> cuboid.track_recording(recording, "results", cuboid.TrackOptions(limit=300))  # doctest: +SKIP
    """
    output = None if output is None else as_path(output)
    taken: RecordingLike = stream_of(recording) if isinstance(recording, FrameSource) else recording
    results, hooks = results or ResultOptions(), hooks or RunHooks()
    plan = plan_for(taken, options or TrackOptions())
    if into is not None and plan.poses in (AUTO, CORRECTED):
        raise InputError(f"{taken.path}: --poses {plan.poses} cannot go into a scene; use given or estimated")
    if into is not None and plan.options.fixed:
        raise InputError(f"{taken.path}: --fixed cannot go into a scene; use given or estimated poses")
    outcome = _track(plan, output, results, into, hooks)
    if output is not None and results.page:
        return_free_memory()  # the map is not needed any more
        write_page(Results(output), taken.read, () if into is None else into.shown_changes())
    return outcome


def _track(
    plan: Plan, output: Path | None, results: ResultOptions, into: IntoScene | None, hooks: RunHooks
) -> RunOutcome:
    """Track the frames and write all results but the page."""
    begun_s, taken, every, frames = working_s(), plan.recording, plan.options.every, _frames(plan)
    with ExitStack() as opened:
        corrected = plan.poses == ESTIMATED if into is None else into.corrects(plan.poses)
        writer = None
        if output is not None:
            if real_path(output) == real_path(Path(taken.path)):
                raise OutputError(f"{output}: is the recording itself; name another output folder")
            rig = isinstance(taken, RigLike)
            writer = opened.enter_context(ResultWriter(output, force=results.force, corrected=corrected, rig=rig))
        session = None if into is None else opened.enter_context(_session(plan, into))
        tracker, source = _tracking(plan, session, writer, hooks.make_tracker, shapes=results.shapes)
        if session is not None:
            frames = session.go_on(frames, writer)
        planned = None if isinstance(taken, Stream) else len(frames)
        hooks.progress.start(planned)
        images_only = taken if source.given_with_frames else taken.without_poses()
        cameras = taken.rig.cameras if isinstance(taken, RigLike) else ()
        rig_watch = None if writer is None else _rig_watch(taken, plan.options)
        if rig_watch is not None:
            opened.callback(rig_watch.close)
        make_view = (hooks.make_view or partial(_video, cameras=cameras)) if results.video else None
        with _view(writer, taken, every, make_view) as view:
            problems = [] if rig_watch is None else [rig_watch.warnings]
            problems += [taken.source.warnings] if isinstance(taken, Stream) else []
            stages = (tracker, plan.options.scale, view, hooks.watch, hooks.progress, session, rig_watch)
            pipeline = Pipeline(taken.path, planned, *stages, problems)
            with closing(_decode(images_only, frames, pipeline, plan.options)) as decoded:
                complete = pipeline.follow(decoded, hooks.stop)
        tracker.leave_out_prepared()
        if complete and not tracker.T_world_camera and plan.poses == ESTIMATED:
            raise InputError(f"{taken.path}: no camera pose can be estimated: no frame has enough depth and texture")
        return_free_memory()
        warnings = own_warnings(tracker) if writer is None else checked_warnings(tracker, _readable(images_only), every)
        if rig_watch is not None:
            rig_watch.finish()
            warnings = (*rig_watch.warnings, *warnings)
        if session is not None:
            warnings = (*session.tracker.warnings(), *warnings)
        report = _report(plan, tracker, complete=complete, begun_s=begun_s, warnings=warnings)
        points = tracker.map_points()
        found = objects_file(
            tracker, taken.intrinsics, points, relations=results.relations, furniture=results.furniture
        )
        if writer is not None:
            writer.finish(found, points, report, tracker.corrected_trajectory(), tracker.kept_views)
        if session is not None:
            walls = found.walls if results.relations else None
            session.tracker.close(complete=complete, walls=walls, settings=plan.settings())
    return RunOutcome(
        report=report,
        objects=found.objects,
        planes=found.planes,
        up=found.up,
        milliseconds=tracker.log.milliseconds,
        frames_per_second=tracker.log.frames_per_second(),
        points=tracker.points_known,
        map_bytes=tracker.map_bytes,
        furniture=found.furniture,
    )


def _frames(plan: Plan) -> Sequence[int]:
    """Return the frames to read; none for a live camera, whose frames are not known in advance."""
    recording, options = plan.recording, plan.options
    if isinstance(recording, Stream):
        return range(0)
    every = options.every
    whole = recording.thinned(every) if isinstance(recording, RigRecording) else range(0, len(recording), every)
    frames = whole[: options.limit]
    if not frames:
        raise InputError(f"{recording.path}: the recording has no frames")
    return frames


def _session(plan: Plan, into: IntoScene) -> AbstractContextManager[SceneRun]:
    """Return the run within a scene."""
    from cuboid.runs.scene import RecordingInfo

    recording = plan.recording
    live = isinstance(recording, Stream)
    path, frames = (recording.path, 0) if live else (Path(recording.path).resolve(), len(recording))
    visit = RecordingInfo(str(path), recording.format, plan.poses, frames, recording.intrinsics, plan.settings())
    return into.session(visit, plan.camera, plan.config, plan.proposals, plan.options.memory_mb)


def _tracking(
    plan: Plan, session: SceneRun | None, writer: ResultWriter | None, make_tracker: MakeTracker | None, *, shapes: bool
) -> tuple[RunningTracker, Poses]:
    """Return the tracker, and the source of its poses."""
    camera, options, source = plan.camera, plan.options, plan.source_of_poses()
    write = None if writer is None else partial(writer.add, pixels=options.scale)
    if session is None:
        make = make_tracker or partial(_tracker, memory_mb=options.memory_mb)
        mapper = make(camera, plan.config, plan.proposals)
        if options.detector is not None:
            _use_detector(mapper, plan)
        return RunningTracker(camera, plan.config, mapper, source, write, shapes=shapes), source
    session.tracker.use_detector(options.detector, plan.detector_every)
    source = session.tracker.poses(source)
    tracker = RunningTracker(camera, plan.config, session.tracker, source, write, shapes=shapes)
    session.resume(tracker)
    return tracker, source


def _readable(recording: RecordingLike) -> RecordingLike:
    """Return the recording whose frames can be read again: of the live cameras of a rig, the one that was made."""
    return recording.kept or recording if isinstance(recording, RigStream) else recording


def _rig_watch(recording: RecordingLike, options: TrackOptions) -> RigWatch | None:
    """Return the check of the cameras of a fixed rig; None for a single camera, and for cameras that move."""
    if not isinstance(recording, RigLike) or recording.rig.kind != FIXED:
        return None
    from cuboid.inputs.calibration.rig_check import RigWatch

    return RigWatch(ahead=options.threads > 1)


def _decode(
    recording: RecordingLike, frames: Sequence[int], pipeline: Pipeline, options: TrackOptions
) -> Generator[Decoded, None, None]:
    """Iterate over the frames; with several threads, the next ones are decoded and prepared ahead.

    In a scene the poses depend on its map, so nothing but decoding is done ahead.
    """
    threads, live = options.threads, isinstance(recording, Stream)
    capacity = LIVE_FRAMES_AHEAD if live else FRAMES_AHEAD
    to_prepare = pipeline.prepare if pipeline.session is None else lambda one: one
    # With three threads, decoding has one of its own; a live camera has one already.
    with closing(
        recording.decode(options.every, options.limit)
        if isinstance(recording, Stream)
        else decode(recording, frames, ahead=threads > 2)
    ) as decoded:
        yield from decoded if threads == 1 else prepare_ahead(decoded, to_prepare, capacity)


def _report(
    plan: Plan, tracker: RunningTracker, *, complete: bool, begun_s: float, warnings: tuple[str, ...]
) -> RunReport:
    recording = plan.recording
    live = recording.source if isinstance(recording, Stream) else None
    used, skipped = len(tracker.T_world_camera), tuple(tracker.log.skipped)
    classes = {"vocabulary": list(tracker.vocabulary)} if tracker.vocabulary else {}
    return RunReport(
        version=__version__,
        complete=complete,
        recording=str(recording.path),
        format=recording.format,
        poses=tracker.poses or GIVEN,
        threads=plan.options.threads,
        config={**plan.settings(), **classes, "tracker": tracker.config.to_dict()},
        frames_read=used + len(skipped),
        frames_used=used,
        skipped=skipped,
        milliseconds=tracker.log.timings(),
        seconds=working_s() - begun_s,
        peak_memory_mb=peak_memory_mb(),
        warnings=(*recording.warnings, *warnings),
        frames_dropped=live.dropped if live else 0,
        limits=tracker.log.limits(),
    )


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
    from cuboid.runs.tracking.posed_tracker import PosedTracker

    return PosedTracker(intrinsics, config, proposals, memory_mb=memory_mb)


def _use_detector(mapper: TrackerLike, plan: Plan) -> None:
    from cuboid.runs.tracking.posed_tracker import PosedTracker

    if not isinstance(mapper, PosedTracker):
        raise ValueError(f"a detector needs the tracker of Cuboid, not a {type(mapper).__name__}")
    mapper.use_detector(plan.options.detector, plan.detector_every)


def _video(path: Path, intrinsics: Intrinsics, every: int, cameras: Sequence[RigCamera] = ()) -> FrameSink:
    from cuboid.results.views.video import VideoView, video_rate

    return VideoView(path, intrinsics, video_rate(every), cameras)
