"""The result folder of a run, written at its end from the tracker."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import gcd
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.formats.folder import REPORT
from cuboid.ground.version import __version__
from cuboid.results.files import ObjectsFile, Results, ResultWriter, RunReport
from cuboid.results.files.writer import RowLog
from cuboid.runs.tracking.checks import checked_warnings, own_warnings
from cuboid.runs.tracking.measuring import peak_memory_mb
from cuboid.runs.tracking.running import RunningTracker
from cuboid.runs.tracking.types import RecordingLike, lens_settings

if TYPE_CHECKING:
    from cuboid.ground.core.results import MapPoints, SceneChange
    from cuboid.results.views.report.pictures import Picture

# Name of the format, in `run.json`, for frames that a program passed to the tracker.
FRAMES_FORMAT = "frames"
NOT_GIVEN = "the frame was not given to the tracker"
NO_RECORDING = "the recording of the frames is not known"


def save_results(
    tracker: RunningTracker,
    rows: RowLog,
    output: Path,
    recording: RecordingLike | None,
    settings: Mapping[str, Any],
    seconds: float,
    *,
    force: bool,
    relations: bool,
    furniture: bool,
) -> None:
    """Write the result folder of a tracker that got its frames one by one; parameters as for `Tracker.save`.

    Parameters
    ----------
    tracker : RunningTracker
    rows : RowLog
        Rows of the frames.
    output : Path
    recording : RecordingLike or None
    settings : mapping
        Settings for `run.json`.
    seconds : float
        Time since the tracker was made.
    force : bool
    relations, furniture : bool
    """
    corrected = tracker.corrected_trajectory()
    read = _no_frame if recording is None else recording.read
    rig = bool(tracker.camera_of)
    with ResultWriter(output, force=force, corrected=corrected is not None, rig=rig) as writer:
        writer.go_on(rows.texts(corrected=corrected is not None))
        every, skipped = _counted(tracker)
        lens = {} if recording is None else lens_settings(recording)
        warnings = (
            own_warnings(tracker)
            if recording is None
            else (*recording.warnings, *checked_warnings(tracker, recording, every))
        )
        report = RunReport(
            version=__version__,
            complete=True,
            recording="" if recording is None else str(recording.path),
            format=FRAMES_FORMAT if recording is None else recording.format,
            poses=tracker.poses or "given",
            threads=1,
            config={"every": every, "limit": None, "scale": 1, "bridge": False, **lens, **settings},
            frames_read=len(tracker.T_world_camera) + len(skipped),
            frames_used=len(tracker.T_world_camera),
            skipped=skipped,
            milliseconds=tracker.log.timings(),
            seconds=seconds,
            peak_memory_mb=peak_memory_mb(),
            warnings=warnings,
            limits=tracker.log.limits(),
        )
        points = tracker.map_points()
        found = objects_file(tracker, tracker.intrinsics, points, relations=relations, furniture=furniture)
        writer.finish(found, points, report, corrected, tracker.kept_views)
    write_page(Results(output), read)


def objects_file(
    tracker: RunningTracker, intrinsics: Intrinsics, points: MapPoints, *, relations: bool, furniture: bool
) -> ObjectsFile:
    """Return the content of `objects.json` at the end of a run.

    Parameters
    ----------
    tracker : RunningTracker
    intrinsics : Intrinsics
        Of the recording's color image at its full size.
    points : MapPoints
        The global point map.
    relations, furniture : bool
        Whether they are found too.
    """
    pieces = tuple(tracker.find_furniture(points)) if furniture else ()
    objects, names = points.counted(tracker.objects), tracker.gone_names
    found = ObjectsFile(tracker.up, intrinsics, tuple(tracker.planes), objects, furniture=pieces, gone_names=names)
    return found.with_relations(points) if relations else found


def write_page(
    results: Results, read: Callable[[int], Frame], changes: Sequence[SceneChange] = ()
) -> Mapping[int, Picture]:
    """Write the 3D page of results into their folder.

    Parameters
    ----------
    results : Results
    read : callable
        Returns a frame of the recording by its index; raises FrameError if it cannot.
    changes : sequence of SceneChange
        Changes in the scene to which the recording was added.

    Returns
    -------
    mapping of int to Picture
        The page's images of objects, by label.
    """
    from cuboid.results.views.report import summarise, write_report

    summary = summarise(results, read, changes)
    write_report(results.folder / REPORT, summary)
    return summary.pictures


def _counted(tracker: RunningTracker) -> tuple[int, tuple[tuple[int, str], ...]]:
    """Return the step between the given frames, and all unused frames with reasons.

    `run.json` counts frames 0, n, 2n, ... of a recording: those of them that were not given are listed.
    """
    skipped = dict(tracker.log.skipped)
    given = sorted({*tracker.T_world_camera, *skipped})
    every = gcd(*given) or 1
    missing = dict.fromkeys(range(0, given[-1] + 1 if given else 0, every), NOT_GIVEN)
    reasons = missing | skipped
    return every, tuple((k, why) for k, why in sorted(reasons.items()) if k not in tracker.T_world_camera)


def _no_frame(index: int) -> Frame:
    raise FrameError(NO_RECORDING)
