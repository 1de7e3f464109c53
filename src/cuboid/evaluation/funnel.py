"""What each stage of a run gave in single frames, as rectangles: from 2D proposals to labelled sightings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cuboid.downscaling import downscale
from cuboid.errors import CuboidError, FrameError, InputError
from cuboid.evaluation.result import RectRows, read_rects
from cuboid.frame import Float64Array
from cuboid.outputs import ObjectsFile, RunReport, read_objects, read_trajectory
from cuboid.outputs.folder import OBJECTS, PROPOSALS, TRAJECTORY
from cuboid.outputs.text import LENGTH, number
from cuboid.proposals import SOURCES, make_source
from cuboid.readers.recording import Recording
from cuboid.readers.reopen import reopen_recording
from cuboid.views.projection import visible_rect
from cuboid.views.replay import used_frames

Rects = Mapping[int, Float64Array]
NO_RECTS = np.zeros((0, 4))


@dataclass(frozen=True, slots=True)
class Stage:
    """The rectangles that a stage of the method gave.

    Attributes
    ----------
    name, short : str
    rects_xyxy : mapping of int to (N, 4) float64, or None
        By frame of the recording, those of frames that have any; pixels of the recording's full size. None where
        they cannot be had.
    reason : str
        Why they cannot be had.
    """

    name: str
    short: str
    rects_xyxy: Rects | None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Finished:
    """A finished run, with its recording where that can be opened.

    Attributes
    ----------
    path : Path
        The result folder.
    report : RunReport
    content : ObjectsFile
        The map of objects.
    recording : Recording or None
    no_recording : str
        Why there is none.
    """

    path: Path
    report: RunReport
    content: ObjectsFile
    recording: Recording | None
    no_recording: str

    @classmethod
    def open(cls, path: Path, report: RunReport, recording: Path | None) -> Finished:
        """Read a result folder; InputError where it is malformed, or a recording that was named is another one."""
        content = read_objects(path / OBJECTS)
        used = used_frames(report)
        try:
            opened = reopen_recording(
                recording or Path(report.recording),
                report.format,
                content.intrinsics,
                report.distortion,
                used[-1] if used else -1,
            )
        except CuboidError as error:
            if recording is not None:
                raise
            return cls(path, report, content, None, str(error))
        return cls(path, report, content, opened.without_poses(), "")


def rects_by_frame(rows: RectRows) -> Rects:
    """Return the rectangles of each frame that has any."""
    return {int(frame): rows.rects_xyxy[rows.frame == frame] for frame in np.unique(rows.frame)}


def early_stages(run: Finished, frames: Sequence[int]) -> list[Stage]:
    """Return the stages before the labelled sightings, in the order of work.

    Parameters
    ----------
    run : Finished
    frames : sequence of int
        Frames of the recording that the run used.
    """
    return [
        _stage("2D proposals", "2D", _proposals_2d, run, frames),
        _stage("the frame's own 3D boxes", "3D", _proposals_3d, run, frames),
        _stage("boxes of the map", "map", _map_boxes, run, frames),
    ]


def _stage(
    name: str, short: str, rects_of: Callable[[Finished, Sequence[int]], Rects], run: Finished, frames: Sequence[int]
) -> Stage:
    try:
        return Stage(name, short, rects_of(run, frames))
    except CuboidError as error:
        return Stage(name, short, None, str(error))


def _proposals_2d(run: Finished, frames: Sequence[int]) -> Rects:
    """Compute the 2D proposals again, from the same images with the same source."""
    if run.recording is None:
        raise InputError(f"the recording cannot be opened: {run.no_recording}")
    spec, scale = str(run.report.config.get("proposals", "")), int(run.report.config.get("scale", 1))
    if spec.partition(":")[0] not in SOURCES.names():
        raise InputError(f"the proposals came from '{spec}', which has no name on the command line")
    source, camera = make_source(spec), run.content.intrinsics.downscaled(scale)
    found = {}
    for frame in frames:
        try:
            image = downscale(run.recording.read(frame), scale)
        except FrameError:
            continue
        found[frame] = source(image, camera).boxes_xyxy.astype(np.float64) * scale
    return found


def _proposals_3d(run: Finished, frames: Sequence[int]) -> Rects:
    return rects_by_frame(read_rects(run.path / PROPOSALS))


def _map_boxes(run: Finished, frames: Sequence[int]) -> Rects:
    """Project the map's boxes at the end into the frames."""
    poses = _poses(run)
    found = {}
    for frame in frames:
        if frame in poses:
            rects = [visible_rect(item.box, poses[frame], run.content.intrinsics) for item in run.content.objects]
            found[frame] = np.array([rect for rect in rects if rect is not None]).reshape(-1, 4)
    return found


def _poses(run: Finished) -> Mapping[int, Float64Array]:
    """Return T_world_camera by frame: lines of the trajectory have times, and no frame numbers."""
    rows, used = read_trajectory(run.path / TRAJECTORY), used_frames(run.report)
    if run.recording is not None:
        by_time = {number(row.timestamp_s, LENGTH): row.T_world_camera for row in rows}
        times = {frame: number(run.recording.timestamp_s(frame), LENGTH) for frame in used}
        return {frame: by_time[time] for frame, time in times.items() if time in by_time}
    if len(rows) != len(used):
        raise InputError(
            f"{TRAJECTORY} has {len(rows)} poses for {len(used)} frames; which is whose the recording would tell, "
            f"but it cannot be opened: {run.no_recording}"
        )
    return {frame: row.T_world_camera for frame, row in zip(used, rows, strict=True)}
