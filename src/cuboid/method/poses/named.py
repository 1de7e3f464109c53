"""The sources of camera poses by name."""

from __future__ import annotations

from cuboid.ground.core.frame import Intrinsics
from cuboid.method.poses.sources import (
    CORRECTED,
    ESTIMATED,
    GIVEN,
    MIN_CORRECTION,
    SYNCHRONISED,
    CorrectedPoses,
    EstimatedPoses,
    GivenPoses,
    Poses,
)


def source_of_poses(poses: str, intrinsics: Intrinsics, voxel_m: float) -> Poses:
    """Return the source of poses for a name of `POSE_SOURCES`.

    Parameters
    ----------
    poses : str
    intrinsics : Intrinsics
        Intrinsics of the frames.
    voxel_m : float
        Edge of a voxel of the map, metres.
    """
    if poses == ESTIMATED:
        return EstimatedPoses(intrinsics, MIN_CORRECTION * voxel_m)
    if poses == SYNCHRONISED:
        from cuboid.method.poses.synchronised import SynchronisedPoses  # imported here: it loads the alignment

        return SynchronisedPoses(intrinsics)
    return GivenPoses() if poses == GIVEN else CorrectedPoses(intrinsics, apply=poses == CORRECTED)
