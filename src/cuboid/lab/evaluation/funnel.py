"""Rectangles of each stage of a run in single frames, from 2D proposals to labelled sightings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.downscaling import downscale
from cuboid.ground.core.errors import ConfigError, CuboidError, InputError
from cuboid.ground.formats.folder import PROPOSALS
from cuboid.ground.formats.rows_files import OwnRectEntry
from cuboid.inputs.readers.recording import Recording
from cuboid.lab.evaluation.result import RectRows, read_rects
from cuboid.method.proposals import SOURCES, make_source
from cuboid.results.files import Results
from cuboid.results.views.projection import visible_rect

Rects = Mapping[int, Float64Array]
NO_RECTS = np.zeros((0, 4))


@dataclass(frozen=True, slots=True)
class Stage:
    """The rectangles that a stage of the method produced.

    Attributes
    ----------
    name, short : str
    rects_xyxy : mapping of int to (N, 4) float64, or None
        Rectangles by frame of the recording, for frames that have any; pixels of the recording's full size. None if
        they are not available.
    reason : str
        Reason why they are not available.
    """

    name: str
    short: str
    rects_xyxy: Rects | None
    reason: str = ""


def open_again(run: Results) -> Recording | str:
    """Return the recording of results, without its poses, or the reason why it cannot be opened.

    Raises
    ------
    InputError
        A recording was named, but it is missing or is another one.
    """
    try:
        return run.recording.without_poses()
    except CuboidError as error:
        if run.recording_path is not None:
            raise
        return str(error)


def rects_by_frame(rows: RectRows) -> Rects:
    """Return the rectangles of each frame that has any."""
    return {int(frame): rows.rects_xyxy[rows.frame == frame] for frame in np.unique(rows.frame)}


def early_stages(run: Results, recording: Recording | str, frames: Sequence[int]) -> list[Stage]:
    """Return the stages before the labelled sightings, in processing order.

    Parameters
    ----------
    run : Results
    recording : Recording or str
        Recording of the run, or the reason why it cannot be opened.
    frames : sequence of int
        Frames of the recording that the run used.
    """
    return [
        _stage("2D proposals", "2D", lambda: _proposals_2d(run, recording, frames)),
        _stage(
            "the frame's own 3D boxes", "3D", lambda: rects_by_frame(read_rects(run.folder / PROPOSALS, OwnRectEntry))
        ),
        _stage("boxes of the map", "map", lambda: _map_boxes(run, frames)),
    ]


def _stage(name: str, short: str, rects: Callable[[], Rects]) -> Stage:
    try:
        return Stage(name, short, rects())
    except CuboidError as error:
        return Stage(name, short, None, str(error))


def _proposals_2d(run: Results, recording: Recording | str, frames: Sequence[int]) -> Rects:
    """Compute the 2D proposals again, from the same images with the same source."""
    if isinstance(recording, str):
        raise InputError(f"the recording cannot be opened: {recording}")
    if "proposals" not in run.report.config:
        raise InputError("run.json does not say where they came from")
    spec, scale = str(run.report.config["proposals"]), int(run.report.config.get("scale", 1))
    if spec.partition(":")[0] not in SOURCES.names():
        raise InputError(f"they came from '{spec}', which has no name on the command line")
    source, camera = make_source(spec, _settings(run)), recording.intrinsics.downscaled(scale)
    found = {}
    for frame in frames:
        image = downscale(recording.read(frame), scale)
        found[frame] = source(image, camera).boxes_xyxy.astype(np.float64) * scale
    return found


def _settings(run: Results) -> TrackerConfig:
    """Return the tracker's settings of a run; the defaults if they are missing or in an older format."""
    settings = run.report.config.get("tracker")
    try:
        return TrackerConfig.from_dict(settings if isinstance(settings, dict) else {})
    except ConfigError:
        return TrackerConfig()


def _map_boxes(run: Results, frames: Sequence[int]) -> Rects:
    """Project the boxes of the final map into the frames."""
    poses = {frame: row.T_world_camera for frame, row in run.poses.items()}
    found = {}
    for frame in frames:
        if frame in poses:
            rects = [visible_rect(item.box, poses[frame], run.found.intrinsics) for item in run.found.objects]
            found[frame] = np.array([rect for rect in rects if rect is not None]).reshape(-1, 4)
    return found
