"""The loop of `cuboid slam`: read, estimate the pose of each frame, write the trajectory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from cuboid.ground.arrays import Float64Array
from cuboid.ground.compiling.compiletime import working_s
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.formats.folder import RUN, TRAJECTORY, TRAJECTORY_ONLINE, ResultFolder, writing
from cuboid.ground.version import __version__
from cuboid.inputs.readers import Recording
from cuboid.method.poses import PoseEstimator
from cuboid.method.poses.sources import LOST
from cuboid.results.files import PoseRow, RunReport, write_run
from cuboid.runs.pipeline.loop import decode
from cuboid.runs.tracking.measuring import FrameClock, FrameLog, peak_memory_mb


@dataclass(frozen=True, slots=True)
class SlamOutcome:
    """The outcome of `cuboid slam`.

    Attributes
    ----------
    report : RunReport
    trajectory : mapping of int to (4, 4) float64
        Corrected T_world_camera of each frame that has one; the world is the camera frame of the first of these.
    lost : int
        Number of frames without a pose when they were processed; some may have one in the trajectory.
    keyframes, loops : int
        Number of keyframes, and of places recognised by appearance (loop closures).
    """

    report: RunReport
    trajectory: Mapping[int, Float64Array]
    lost: int
    keyframes: int
    loops: int


def estimate_trajectory(
    recording: Recording,
    output: PathLike | None,
    *,
    every: int = 1,
    limit: int | None = None,
    threads: int = 1,
    force: bool = False,
    progress: Callable[[int, int], None] = lambda done, of: None,
    stop: Callable[[], bool] = lambda: False,
) -> SlamOutcome:
    """Estimate the camera poses of a recording from its images and write them.

    Parameters
    ----------
    recording : Recording
        From `cuboid.open_recording`; its poses are not used.
    output : path or None
        Folder of the results; None writes nothing.
    every : int
        Use each n-th frame.
    limit : int, optional
        Read at most this many frames.
    threads : int
        With 2 or more, the next frames are decoded ahead in a separate thread.
    force : bool
        Replace existing results in `output`.
    progress : callable
        Called with the number of processed frames and the total number.
    stop : callable
        Called before each frame; True ends the run, and its results are marked as incomplete.

    Returns
    -------
    SlamOutcome

    Raises
    ------
    InputError
        If the recording has no frames, or none shows enough to start with.
    OutputError
        If the results cannot be written; no partial results are left.
    """
    begun_s = working_s()
    unposed = recording.without_poses()
    frames = range(0, len(unposed), every)[:limit]
    if not frames:
        raise InputError(f"{recording.path}: the recording has no frames")
    estimator, log = PoseEstimator(unposed.intrinsics), FrameLog()
    online: dict[int, Float64Array] = {}
    complete = True
    with closing(decode(unposed, frames, ahead=threads > 1)) as decoded:
        for done, one in enumerate(decoded):
            if stop():
                complete = False
                break
            clock = FrameClock({"decode": one.milliseconds})
            try:
                if one.frame is None:
                    raise FrameError(one.reason)
                T_world_camera = estimator.update(one.frame).T_world_camera
                if T_world_camera is None:
                    raise FrameError(LOST)
                online[one.index] = T_world_camera
                clock.lap("poses")
                log.use(clock.done())
            except FrameError as error:
                log.skip(one.index, str(error))
            progress(done + 1, len(frames))
    if complete and not estimator.keyframes:
        raise InputError(f"{recording.path}: no frame has enough depth and texture to start with")
    trajectory = estimator.trajectory()
    lens = unposed.depth_camera.document() if unposed.depth_camera is not None else {}
    report = RunReport(
        version=__version__,
        complete=complete,
        recording=str(recording.path),
        format=recording.format,
        poses="estimated",
        threads=threads,
        config={"every": every, "limit": limit, "distortion": list(unposed.distortion), **lens},
        frames_read=log.read,
        frames_used=log.used,
        skipped=tuple(log.skipped),
        milliseconds=log.timings(),
        seconds=working_s() - begun_s,
        peak_memory_mb=peak_memory_mb(),
        warnings=(
            *unposed.warnings,
            *estimator.left_out.warnings(),
            *(() if output is None else _warnings(unposed, trajectory)),
        ),
    )
    if output is not None:
        _write(recording, as_path(output), force, trajectory, online, report)
    lost = sum(reason == LOST for _, reason in log.skipped)
    return SlamOutcome(report, trajectory, lost, len(estimator.keyframes), estimator.loops)


def _warnings(recording: Recording, trajectory: Mapping[int, Float64Array]) -> tuple[str, ...]:
    from cuboid.inputs.calibration.check import intrinsics_warning
    from cuboid.inputs.calibration.registering import DISPLACED, registration_warning

    if not any(line.startswith(DISPLACED) for line in recording.warnings):
        displaced = registration_warning(recording.read, recording.intrinsics, sorted(trajectory))
        if displaced is not None:
            return (displaced,)
    off = intrinsics_warning(recording.read, recording.intrinsics, trajectory)
    return () if off is None else (off,)


def _write(
    recording: Recording,
    output: Path,
    force: bool,
    trajectory: Mapping[int, Float64Array],
    online: Mapping[int, Float64Array],
    report: RunReport,
) -> None:
    with ResultFolder(output, force=force) as folder:
        for name, poses in ((TRAJECTORY, trajectory), (TRAJECTORY_ONLINE, online)):
            rows = (PoseRow(recording.timestamp_s(frame), T).line() + "\n" for frame, T in sorted(poses.items()))
            with writing(folder.file(name), output / name):
                folder.file(name).write_text("".join(rows), encoding="utf-8", newline="\n")
        with writing(folder.file(RUN), output / RUN):
            write_run(folder.file(RUN), report)
        folder.commit()
