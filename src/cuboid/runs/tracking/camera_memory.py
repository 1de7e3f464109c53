"""The memory of a tracker of the earlier frames of one camera."""

from __future__ import annotations

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult
from cuboid.method.heatmap.motion import Motion


class CameraMemory:
    """Memory of the earlier frames of one camera: cameras of a rig share a map, but each has a memory of its own.

    Parameters
    ----------
    intrinsics : Intrinsics
        Intrinsics of its frames.
    config : TrackerConfig

    Attributes
    ----------
    config : TrackerConfig
        The configuration with the depth noise of this camera.
    turns : int or None
        Number of quarter turns by which its images are rolled; None before its first frame with depth.
    count : int
        Number of its frames so far.
    position : (3,) float64 or None
        Its position in its last frame.
    viewpoint : (4, 4) float64 or None
        T_world_camera of its last frame from a new viewpoint.
    time_s : float or None
        Time of its last frame.
    due : bool
        Whether its next frame refreshes the map.
    unscored : float
        Weight of its frames since the last one whose segments were scored.
    unlooked : float
        Weight of its frames since the last look for what only regions show.
    last : (Frame, FrameResult) or None
        Its last frame with the result.
    motion : Motion
        Its earlier frames, in which moving readings are found.
    """

    def __init__(self, intrinsics: Intrinsics, config: TrackerConfig) -> None:
        self.intrinsics, self.config = intrinsics, config
        self.turns: int | None = None
        self.count = 0
        self.position: Float64Array | None = None
        self.viewpoint: Float64Array | None = None
        self.time_s: float | None = None
        self.due = True
        self.unscored = self.unlooked = 0.0
        self.last: tuple[Frame, FrameResult] | None = None
        self.begin_motion()

    def begin_motion(self) -> None:
        """Forget the earlier frames in which motion is found: poses were corrected, or time has passed."""
        self.motion = Motion(self.config.depth_noise_per_m)

    def set_noise(self, noise_per_m: float) -> None:
        """Set the depth noise of the camera."""
        self.config = self.config.within_range(depth_noise_per_m=noise_per_m)
        self.begin_motion()

    def begin_visit(self) -> None:
        """Begin a later visit, on which the camera may be held in another orientation."""
        self.last = self.position = self.viewpoint = self.turns = None
        self.due = True
        self.begin_motion()
