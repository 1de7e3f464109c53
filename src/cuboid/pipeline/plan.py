"""The plan of a run: the validated options of the user, completed with properties of the recording."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cuboid.core.config import TrackerConfig
from cuboid.core.errors import InputError
from cuboid.core.frame import Intrinsics
from cuboid.core.tolerances import DETECT_EVERY
from cuboid.poses.sources import ESTIMATED, GIVEN, BridgedPoses, Poses, checked_origin, source_of_poses
from cuboid.tracking.types import RecordingLike, lens_settings

if TYPE_CHECKING:
    from cuboid.detection.types import Detector
    from cuboid.proposals.types import ProposalSource

# Smallest working width after scaling, pixels: smaller images do not resolve objects.
MIN_WORKING_PX = 120
SCALES = (1, 2, 4)


@dataclass(frozen=True, slots=True)
class Plan:
    """The plan for tracking a recording.

    Attributes
    ----------
    config : TrackerConfig
    proposals : str or ProposalSource or None
        Name of a source of 2D proposals, with its options, or the source itself; None for the default.
    poses : {"given", "auto", "corrected", "estimated"}
        Source of the camera poses.
    bridge : bool
        Whether frames without a pose get poses estimated from the video.
    every : int
        Each n-th frame is used.
    limit : int or None
        Largest number of frames that are read.
    scale : {1, 2, 4}
        Side in pixels of the block that becomes one pixel before tracking.
    detector : str or Detector or None
        Names the objects; see `make_detector`.
    detector_every : int
        The detector processes each n-th used frame.
    """

    config: TrackerConfig
    proposals: str | ProposalSource | None
    poses: str
    bridge: bool
    every: int
    limit: int | None
    scale: int
    detector: str | Detector | None = None
    detector_every: int = DETECT_EVERY

    def source_of_poses(self, recording: RecordingLike, camera: Intrinsics) -> Poses:
        """Return the source of the poses.

        Parameters
        ----------
        recording : RecordingLike
        camera : Intrinsics
            Intrinsics of the frames.
        """
        if self.bridge:
            return BridgedPoses(camera, recording.pose)
        return source_of_poses(self.poses, camera, self.config.voxel_m)

    def settings(self, recording: RecordingLike) -> dict[str, Any]:
        """Return all settings on which results depend, besides the recording's files, ready for JSON."""
        from cuboid.detection import detector_name
        from cuboid.proposals import source_name

        detector = self.detector
        named = {"detector": detector_name(detector), "detector_every": self.detector_every} if detector else {}
        return {
            "every": self.every,
            "limit": self.limit,
            "scale": self.scale,
            "bridge": self.bridge,
            **lens_settings(recording),
            "proposals": source_name(self.proposals),
            **named,
            "tracker": self.config.to_dict(),
        }


def plan_for(
    recording: RecordingLike,
    config: TrackerConfig,
    proposals: str | ProposalSource | None,
    *,
    poses: str | None,
    bridge: bool,
    every: int,
    limit: int | None,
    scale: int,
    detector: str | Detector | None = None,
    detector_every: int | None = None,
) -> Plan:
    """Return the plan for tracking a recording; parameters as for `cuboid.track_recording`.

    Raises
    ------
    ValueError
        If a number is out of its range.
    InputError
        If the poses of the recording are required and it has none, or if options do not fit together.
    """
    look_every = DETECT_EVERY if detector_every is None else detector_every
    if look_every < 1:
        raise ValueError(f"detector_every must be >= 1, got {look_every}")
    if detector_every is not None and detector is None:
        raise InputError(f"{recording.path}: --detector-every needs --detector")
    if scale not in SCALES or every < 1 or (limit is not None and limit < 1):
        raise ValueError(f"scale must be one of {SCALES}, every and limit >= 1, got {scale}, {every}, {limit}")
    origin = checked_origin(poses or (GIVEN if recording.has_poses else ESTIMATED))
    if origin != ESTIMATED and not recording.has_poses:
        raise InputError(f"{recording.path}: has no camera poses; --poses estimated takes them from the video")
    if bridge and origin != GIVEN:
        raise InputError(f"{recording.path}: --bridge fills gaps between given poses, and there are none in use")
    at_scale = _at_scale(config, proposals, scale)
    return Plan(*at_scale, origin, bridge, every, limit, scale, detector, look_every)


def _at_scale(
    config: TrackerConfig, proposals: str | ProposalSource | None, scale: int
) -> tuple[TrackerConfig, str | ProposalSource | None]:
    """Reduce the working resolution by the same scale as the frames: users scale frames down for speed."""
    if scale == 1:
        return config, proposals
    from cuboid.proposals.depth import WIDEST

    width = max(MIN_WORKING_PX, config.working_width_px // scale)
    if proposals in (None, "depth"):
        proposals = f"depth:{max(MIN_WORKING_PX, WIDEST // scale)}"
    return dataclasses.replace(config, working_width_px=width), proposals
