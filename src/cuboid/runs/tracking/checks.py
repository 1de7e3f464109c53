"""Checks at the end of a run: likely faults of its frames, poses, intrinsics and registration."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from cuboid.ground.core.errors import FrameError
from cuboid.method.poses.sources import ESTIMATED, LOST, NO_POSE
from cuboid.runs.tracking.diagnosis import RunFacts, diagnose, explains, median_or_none
from cuboid.runs.tracking.running import RunningTracker
from cuboid.runs.tracking.types import RecordingLike

if TYPE_CHECKING:
    from cuboid.inputs.calibration.pose_fit import PoseFit


def checked_warnings(tracker: RunningTracker, recording: RecordingLike, every: int) -> tuple[str, ...]:
    """Return the warnings of a run, including those for which frames are read again; this takes a second or two.

    Parameters
    ----------
    tracker : RunningTracker
        The tracker at the end of the run.
    recording : RecordingLike
        The recording of its frames.
    every : int
        Step between the frames that were read.
    """
    from cuboid.inputs.calibration.check import intrinsics_warning
    from cuboid.inputs.calibration.pose_fit import pose_fit
    from cuboid.inputs.calibration.registering import DISPLACED, registration_warning

    estimated, poses, fit = tracker.poses == ESTIMATED, tracker.trajectory, None
    if not estimated:  # poses as given: drift correction would adapt them to a wrong depth scale
        given = ((frame, recording.pose(frame)) for frame in poses if _has_pose(recording, frame))
        fit = pose_fit(recording.read, recording.intrinsics, {k: T for k, T in given if T is not None})
    calibration = registration = None
    if fit is None or explains(fit):
        units = None if estimated else recording.depth_units_per_metre
        calibration = intrinsics_warning(recording.read, recording.intrinsics, poses, units)
    if not any(line.startswith(DISPLACED) for line in recording.warnings):
        registration = registration_warning(recording.read, recording.intrinsics, sorted(poses))
    facts = replace(run_facts(tracker, recording, every, fit), calibration=calibration, registration=registration)
    return (*diagnose(facts), *tracker.pose_warnings, *tracker.view_warnings)


def own_warnings(tracker: RunningTracker) -> tuple[str, ...]:
    """Return the likely faults of a tracker's frames that it knows without their recording, one line each."""
    return (*diagnose(run_facts(tracker)), *tracker.pose_warnings, *tracker.view_warnings)


def run_facts(
    tracker: RunningTracker, recording: RecordingLike | None = None, every: int = 1, fit: PoseFit | None = None
) -> RunFacts:
    """Return the facts of a run for its diagnosis; without the recording, only those that the tracker knows."""
    reasons = [reason for _, reason in tracker.log.skipped]
    return RunFacts(
        frames_read=len(tracker.T_world_camera) + len(reasons),
        frames_used=len(tracker.T_world_camera),
        frames_lost=reasons.count(LOST),
        frames_without_pose=_without_pose(tracker, recording),
        every=every,
        depth_fraction=median_or_none(tracker.counts.depth_fraction),
        depth_median_m=median_or_none(tracker.counts.depth_median_m),
        depth_units_per_metre=1.0 if recording is None else recording.depth_units_per_metre,
        pose_fit=fit,
        misfit=tracker.pose_misfit,
        up_known=tracker.up is not None,
        planes=len(tracker.planes),
        proposals=tracker.counts.proposals,
        objects=len(tracker.objects),
        untimely=tuple(b for (_, before), (b, after) in pairwise(tracker.times_s.items()) if after <= before),
        farthest_m=max((float(np.abs(T[:3, 3]).max()) for T in tracker.T_world_camera.values()), default=0.0),
    )


def _without_pose(tracker: RunningTracker, recording: RecordingLike | None) -> int:
    """Return the number of skipped frames that lack a pose although poses come with the frames."""
    if tracker.poses == ESTIMATED:
        return 0
    return sum(
        reason == NO_POSE if recording is None else not _has_pose(recording, frame)
        for frame, reason in tracker.log.skipped
    )


def _has_pose(recording: RecordingLike, frame: int) -> bool:
    try:
        recording.pose(frame)
    except FrameError:
        return False
    return True
