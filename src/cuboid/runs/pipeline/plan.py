"""The plan of a run: the options of the user, completed with properties of the recording."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Intrinsics, Rig
from cuboid.ground.core.tolerances import DETECT_EVERY
from cuboid.ground.formats.rig_file import FIXED
from cuboid.method.poses.named import source_of_poses
from cuboid.method.poses.rig_poses import RigPoses
from cuboid.method.poses.sources import (
    ESTIMATED,
    GIVEN,
    MIN_CORRECTION,
    BridgedPoses,
    FixedPoses,
    Poses,
)
from cuboid.runs.pipeline.options import TrackOptions
from cuboid.runs.tracking.types import RecordingLike, RigLike, lens_settings

if TYPE_CHECKING:
    from cuboid.method.proposals.types import ProposalSource

# Smallest working width after scaling, pixels: smaller images do not resolve objects.
MIN_WORKING_PX = 120


@dataclass(frozen=True, slots=True)
class Plan:
    """The plan for tracking a recording.

    Attributes
    ----------
    recording : RecordingLike
    options : TrackOptions
        The options of the user.
    config : TrackerConfig
        The configuration at the scale of the frames.
    proposals : str or ProposalSource or None
        Name of a source of 2D proposals at this scale, with its options, or the source itself; None for the default.
    poses : {"given", "auto", "corrected", "estimated"}
        Source of the camera poses.
    detector_every : int
        The detector processes each n-th used frame.
    """

    recording: RecordingLike
    options: TrackOptions
    config: TrackerConfig
    proposals: str | ProposalSource | None
    poses: str
    detector_every: int

    @property
    def camera(self) -> Intrinsics:
        """Intrinsics of the scaled frames."""
        return self.recording.intrinsics.downscaled(self.options.scale)

    def source_of_poses(self) -> Poses:
        """Return the source of the poses."""
        if self.options.fixed:
            return FixedPoses()
        if isinstance(self.recording, RigLike) and self.poses == ESTIMATED:
            shift_m = MIN_CORRECTION * self.config.voxel_m
            return RigPoses(self.camera, self.recording.rig.T_rig_camera, shift_m)
        if self.options.bridge:
            return BridgedPoses(self.camera, self.recording.pose)
        return source_of_poses(self.poses, self.camera, self.config.voxel_m)

    def settings(self) -> dict[str, Any]:
        """Return all settings on which results depend, besides the recording's files, ready for JSON."""
        from cuboid.method.detection import detector_name
        from cuboid.method.proposals import source_name

        options, detector = self.options, self.options.detector
        named = {"detector": detector_name(detector), "detector_every": self.detector_every} if detector else {}
        return {
            "every": options.every,
            "limit": options.limit,
            "scale": options.scale,
            "bridge": options.bridge,
            **({"fixed": True} if options.fixed else {}),
            **lens_settings(self.recording),
            **({"rig": self.recording.settings()} if isinstance(self.recording, RigLike) else {}),
            "proposals": source_name(self.proposals),
            **named,
            "tracker": self.config.to_dict(),
        }


def plan_for(recording: RecordingLike, options: TrackOptions) -> Plan:
    """Return the plan for tracking a recording.

    Raises
    ------
    InputError
        If the poses of the recording are required and it has none, or if options do not fit together.
    """
    if options.detector_every is not None and options.detector is None:
        raise InputError(f"{recording.path}: --detector-every needs --detector")
    if isinstance(recording, RigLike):
        _check_rig(recording, recording.rig, options)
    if options.fixed and (options.poses or options.bridge):
        raise InputError(f"{recording.path}: --fixed needs no poses; leave out --poses and --bridge")
    origin = options.poses or (GIVEN if recording.has_poses or options.fixed else ESTIMATED)
    if not options.fixed and origin != ESTIMATED and not recording.has_poses:
        raise InputError(f"{recording.path}: has no camera poses; --poses estimated takes them from the video")
    if options.bridge and origin != GIVEN:
        raise InputError(f"{recording.path}: --bridge fills gaps between given poses, and there are none in use")
    config, proposals = _at_scale(options)
    return Plan(recording, options, config, proposals, origin, options.detector_every or DETECT_EVERY)


def _check_rig(recording: RecordingLike, rig: Rig, options: TrackOptions) -> None:
    """Raise InputError if the options do not fit a rig of several cameras."""
    path = recording.path
    if options.fixed or options.bridge:
        option = "--fixed" if options.fixed else "--bridge"
        raise InputError(f"{path}: {option} is for one camera; the 'kind' in rig.json says whether a rig moves")
    if rig.kind == FIXED and options.poses not in (None, GIVEN):
        raise InputError(f"{path}: a fixed rig has the poses of its cameras; leave out --poses {options.poses}")
    if options.poses not in (None, GIVEN, ESTIMATED):
        raise InputError(f"{path}: --poses {options.poses} is for one camera; a rig takes given or estimated")
    estimated = options.poses == ESTIMATED or not recording.has_poses
    if estimated and not rig.T_rig_camera:
        raise InputError(f"{path}: estimated poses need the 'T_rig_camera' of each camera")


def _at_scale(options: TrackOptions) -> tuple[TrackerConfig, str | ProposalSource | None]:
    """Reduce the working resolution by the same scale as the frames: users scale frames down for speed."""
    config, proposals, scale = options.config, options.proposals, options.scale
    if scale == 1:
        return config, proposals
    from cuboid.method.proposals.depth import WIDEST

    width = max(MIN_WORKING_PX, config.working_width_px // scale)
    if proposals in (None, "depth"):
        proposals = f"depth:{max(MIN_WORKING_PX, WIDEST // scale)}"
    return dataclasses.replace(config, working_width_px=width), proposals
