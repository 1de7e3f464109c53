"""The options of a run over a recording: how it is tracked, which results are made, and who follows the run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.limits import MEMORY_MB
from cuboid.method.poses.sources import checked_origin
from cuboid.runs.tracking.types import MakeFrameSink, MakeTracker, Progress, Watch

if TYPE_CHECKING:
    from cuboid.method.detection.types import Detector
    from cuboid.method.proposals.types import ProposalSource

SCALES = (1, 2, 4)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackOptions:
    """How a recording is tracked.

    Attributes
    ----------
    every : int
        Use each n-th frame.
    limit : int, optional
        Read at most this many frames.
    scale : {1, 2, 4}
        Side in pixels of the block that becomes one pixel before tracking; results stay in the recording's pixels.
    poses : {"given", "auto", "corrected", "estimated"}, optional
        Source of the camera poses, as for `Tracker`; by default given if the recording has poses, else estimated.
    bridge : bool
        Estimate poses from the video for frames without one.
    fixed : bool
        The camera stands still, and its frame is the world: no pose is needed or used. Not for a scene.
    config : TrackerConfig
    proposals : str or ProposalSource, optional
        Name of a source of 2D proposals, with its options, or the source itself.
    detector : str or Detector, optional
        File of an ONNX model, or name of a detector, with its options; or any callable from (frame, intrinsics) to
        `Detections`. Objects get names from it.
    detector_every : int, optional
        The detector processes each n-th used frame; 3 by default.
    threads : int
        With 2, a second thread decodes the next frames and does the part of their work that needs no map; with 3 or
        more, decoding has a thread of its own. The results do not depend on it.
    memory_mb : float
        Memory limit of the process, in units of 2**20 bytes, above which parts of the map out of view are evicted.

    Raises
    ------
    ValueError
        If a number is out of its range, or `poses` is none of these words.
    """

    every: int = 1
    limit: int | None = None
    scale: int = 1
    poses: str | None = None
    bridge: bool = False
    fixed: bool = False
    config: TrackerConfig = field(default_factory=TrackerConfig)
    proposals: str | ProposalSource | None = None
    detector: str | Detector | None = None
    detector_every: int | None = None
    threads: int = 1
    memory_mb: float = MEMORY_MB

    def __post_init__(self) -> None:
        if self.scale not in SCALES or self.every < 1 or (self.limit is not None and self.limit < 1):
            numbers = f"{self.scale}, {self.every}, {self.limit}"
            raise ValueError(f"scale must be one of {SCALES}, every and limit >= 1, got {numbers}")
        if self.detector_every is not None and self.detector_every < 1:
            raise ValueError(f"detector_every must be >= 1, got {self.detector_every}")
        if self.poses is not None:
            checked_origin(self.poses)


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultOptions:
    """Which results of a run are made.

    Attributes
    ----------
    force : bool
        Replace existing results in the output folder.
    page : bool
        Write the 3D page; `write_page` can write it later.
    video : bool
        Write `labelled.mp4`.
    shapes : bool
        Keep views of the objects, as for `Tracker`.
    relations : bool
        Find the relations of the objects at the end, and include them in the results and in the scene.
    furniture : bool
        Find the furniture that bears the supporting planes at the end, and keep it in the results; in a scene it keeps
        its labels.
    """

    force: bool = False
    page: bool = True
    video: bool = False
    shapes: bool = False
    relations: bool = False
    furniture: bool = True


def never() -> bool:
    """Return False: the run goes on to the last frame."""
    return False


@dataclass(frozen=True, slots=True, kw_only=True)
class RunHooks:
    """Who follows and stops a run, and factories of its parts.

    Attributes
    ----------
    progress : Progress
        Receives the progress of the run.
    stop : callable
        Called before each frame; True ends the run, and its results are marked as incomplete.
    watch : callable, optional
        Called between frames with each used frame, its result, and the tracker.
    make_tracker, make_view : callable, optional
        Factories of the tracker and of the video; by default `cuboid.Tracker` and the labelled video.
    """

    progress: Progress = field(default_factory=Progress)
    stop: Callable[[], bool] = never
    watch: Watch | None = None
    make_tracker: MakeTracker | None = None
    make_view: MakeFrameSink | None = None
