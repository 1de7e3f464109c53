"""Measure the objects on the surface in front of a camera: a short run of the tracker without result files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import InputError, counted
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult
from cuboid.results.files.measures import Measure, measures_of
from cuboid.runs.pipeline.options import ResultOptions, RunHooks, TrackOptions, never
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.pipeline.streaming import FrameSource
from cuboid.runs.tracking.diagnosis import FEW_FRAMES
from cuboid.runs.tracking.types import MapLike, Progress, RecordingLike

# Objects of this many last frames of each camera are in view: in a single frame one may be missed.
RECENT_FRAMES = 5


@dataclass(frozen=True, slots=True)
class Measured:
    """The measures, and the last frame.

    Attributes
    ----------
    measures : list of Measure
    color : (H, W, 3) uint8
    T_world_camera : (4, 4) float64
    intrinsics : Intrinsics
    frames : int
        Number of used frames.
    warnings : tuple of str
        Likely faults of the frames, one line each; without measures they tell what is missing.
    """

    measures: list[Measure]
    color: UInt8Array
    T_world_camera: Float64Array
    intrinsics: Intrinsics
    frames: int
    warnings: tuple[str, ...] = ()


class _Follower:
    """Keeps the last frame, and ends the run after a time."""

    def __init__(self, seconds: float | None, stop: Callable[[], bool]) -> None:
        self._seconds, self._stop = seconds, stop
        self._first_s = self._last_s = 0.0
        # The labels in the last frames, by the name of the camera.
        self.seen: dict[str, list[frozenset[int]]] = {}
        self.last: tuple[Frame, FrameResult, MapLike] | None = None

    def watch(self, frame: Frame, result: FrameResult, tracker: MapLike) -> None:
        if self.last is None:
            self._first_s = frame.timestamp_s
        self._last_s = frame.timestamp_s
        self.last = frame, result, tracker
        seen = self.seen.setdefault(frame.camera_name, [])
        seen.append(frozenset(one.label for one in result.sightings))
        del seen[:-RECENT_FRAMES]

    def stop(self) -> bool:
        return self._stop() or (self._seconds is not None and self._last_s - self._first_s >= self._seconds)


def measure(
    source: RecordingLike | FrameSource,
    options: TrackOptions,
    *,
    seconds: float | None = None,
    progress: Progress | None = None,
    stop: Callable[[], bool] = never,
) -> Measured:
    """Track a source for a time, and measure what stands on the surface in front of the camera at its end.

    Parameters
    ----------
    source : RecordingLike or FrameSource
    options : TrackOptions
    seconds : float, optional
        Time of the frames that are used; by default all.
    progress : Progress, optional
    stop : callable
        Called before each frame; True ends the run.

    Raises
    ------
    InputError
        No frame can be used, or too few for a measure.
    """
    follower = _Follower(seconds, stop)
    hooks = RunHooks(progress=progress or Progress(), watch=follower.watch, stop=follower.stop)
    found = track_recording(source, None, options, results=ResultOptions(furniture=False), hooks=hooks)
    if follower.last is None:
        raise InputError("nothing was measured: no frame could be used")
    frame, result, tracker = follower.last
    # The labels of the end: an object may have been merged into an older one since.
    older = {label: item.label for item in found.objects for label in item.merged_labels}
    in_view = {older.get(label, label) for seen in follower.seen.values() for labels in seen for label in labels}
    measures = measures_of(found.objects, tracker.map_points(), in_view)
    used, warnings = found.report.frames_used, tuple(found.report.warnings)
    if not measures and used < FEW_FRAMES:
        raise InputError(
            f"nothing was measured in {counted(used, 'frame')}: an object is measured once it was seen clearly about "
            "three times; record the scene for a second, or give more frames"
        )
    pose = np.asarray(result.T_world_camera)
    intrinsics = frame.intrinsics_or(source.intrinsics)
    return Measured(measures, frame.color, pose, intrinsics, used, warnings)
