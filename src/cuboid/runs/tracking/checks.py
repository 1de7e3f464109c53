"""Checks at the end of a run: likely faults of its frames, poses, intrinsics and registration."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import RigCamera
from cuboid.ground.core.plausible import field_of_view_warning
from cuboid.ground.formats.rig_file import FIXED
from cuboid.inputs.readers import Recording
from cuboid.inputs.recordings.rig import RigRecording
from cuboid.method.poses.sources import ESTIMATED, GIVEN, LOST, NO_POSE
from cuboid.runs.tracking.diagnosis import RunFacts, diagnose, explains, median_or_none
from cuboid.runs.tracking.running import NO_DEPTH, RunningTracker
from cuboid.runs.tracking.types import RecordingLike, RigLike


def checked_warnings(tracker: RunningTracker, recording: RecordingLike, every: int) -> tuple[str, ...]:
    """Return the warnings of a run, including those for which frames are read again.

    This takes a second or two.

    Parameters
    ----------
    tracker : RunningTracker
        The tracker at the end of the run.
    recording : RecordingLike
        The recording of its frames.
    every : int
        Step between the frames that were read.
    """
    facts, poses = run_facts(tracker, recording, every), tracker.trajectory
    if not isinstance(recording, RigLike):
        found = diagnose(_checked(facts, tracker, recording, poses))
        return (*found, *tracker.pose_warnings, *tracker.view_warnings)
    # Depth is judged camera by camera.
    warnings = dict.fromkeys(diagnose(replace(facts, depth_fraction=None, depth_median_m=None)))
    for camera in recording.rig.cameras:
        of_camera = {k: T for k, T in poses.items() if tracker.camera_of.get(k) == camera.name}
        if of_camera:
            checked = _checked(_facts_of(facts, tracker, of_camera), tracker, recording, of_camera, camera)
            warnings |= {f"camera {camera.name}: {line}": None for line in diagnose(checked) if line not in warnings}
    return (*warnings, *tracker.pose_warnings, *tracker.view_warnings)


def _facts_of(facts: RunFacts, tracker: RunningTracker, frames: Collection[int]) -> RunFacts:
    """Return the facts of a run with the depth of some frames."""
    fractions, medians_m = tracker.counts.depth_fraction, tracker.counts.depth_median_m
    return replace(
        facts,
        depth_fraction=median_or_none([fractions[k] for k in frames if k in fractions]),
        depth_median_m=median_or_none([medians_m[k] for k in frames if k in medians_m]),
        depth_constant=tracker.counts.mostly_constant(frames),
    )


def _checked(
    facts: RunFacts,
    tracker: RunningTracker,
    recording: RecordingLike,
    poses: Mapping[int, Float64Array],
    camera: RigCamera | None = None,
) -> RunFacts:
    """Return the facts of a run with what frames of one camera, which are read again, tell.

    Only frames of a camera that moves tell whether intrinsics and given poses fit.

    Parameters
    ----------
    facts : RunFacts
    tracker : RunningTracker
    recording : RecordingLike
    poses : mapping of int to (4, 4) float64
        Poses of the frames of the camera.
    camera : RigCamera, optional
        The camera, if it is one of a rig.
    """
    from cuboid.inputs.calibration.check import intrinsics_warning
    from cuboid.inputs.calibration.pose_fit import pose_fit
    from cuboid.inputs.calibration.registering import DISPLACED, registration_warning

    own, moves = recording, not isinstance(recording, RigLike) or recording.rig.kind != FIXED
    if camera is not None and isinstance(recording, RigRecording):
        own = recording.of(camera.name)
    intrinsics = recording.intrinsics if camera is None else camera.intrinsics
    estimated, fit, calibration, registration = tracker.poses == ESTIMATED, None, None, None
    if moves and not estimated:  # poses as given: drift correction would adapt them to a wrong depth scale
        given = ((frame, recording.pose(frame)) for frame in poses if _has_pose(recording, frame))
        fit = pose_fit(recording.read, intrinsics, {k: T for k, T in given if T is not None})
    if moves and (fit is None or explains(fit)):
        units = None if estimated else own.depth_units_per_metre
        calibration = intrinsics_warning(recording.read, intrinsics, poses, units)
    # The check reads frames of the whole recording and needs 40 MB: once is enough.
    checked = isinstance(own, Recording) and own.registration_checked
    if not checked and not any(DISPLACED in line for line in own.warnings):
        registration = registration_warning(recording.read, intrinsics, sorted(poses))
    return replace(
        facts,
        depth_units_per_metre=own.depth_units_per_metre,
        pose_fit=fit,
        calibration=calibration,
        registration=registration,
    )


def own_warnings(tracker: RunningTracker) -> tuple[str, ...]:
    """Return the likely faults of a tracker's frames that it knows without their recording, one line each."""
    return (*diagnose(run_facts(tracker)), *tracker.pose_warnings, *tracker.view_warnings)


def run_facts(tracker: RunningTracker, recording: RecordingLike | None = None, every: int = 1) -> RunFacts:
    """Return the facts of a run for its diagnosis; without the recording, only those that the tracker knows."""
    reasons = [reason for _, reason in tracker.log.skipped]
    return RunFacts(
        frames_read=len(tracker.T_world_camera) + len(reasons),
        frames_used=len(tracker.T_world_camera),
        frames_lost=reasons.count(LOST),
        frames_without_pose=_without_pose(tracker, recording),
        frames_without_depth=reasons.count(NO_DEPTH),
        every=every,
        depth_fraction=median_or_none(tracker.counts.depth_fraction.values()),
        depth_median_m=median_or_none(tracker.counts.depth_median_m.values()),
        depth_units_per_metre=1.0 if recording is None else recording.depth_units_per_metre,
        pose_fit=None,
        misfit=tracker.pose_misfit or _clock_misfit(tracker, recording),
        up_known=tracker.up is not None,
        field_of_view=field_of_view_warning(tracker.intrinsics),
        depth_constant=tracker.counts.mostly_constant(tracker.T_world_camera),
        planes=len(tracker.planes),
        proposals=tracker.counts.proposals,
        objects=len(tracker.objects),
        untimely=_untimely(tracker),
        farthest_m=max((float(np.abs(T[:3, 3]).max()) for T in tracker.T_world_camera.values()), default=0.0),
    )


def _clock_misfit(tracker: RunningTracker, recording: RecordingLike | None) -> str | None:
    """Return why given poses do not fit neighbouring frames, as found when the recording was opened."""
    if tracker.poses != GIVEN or not isinstance(recording, Recording):
        return None
    return recording.pose_clock.misfit or None


def _untimely(tracker: RunningTracker) -> tuple[int, ...]:
    """Return the frames whose time is not later than that of the frame before of the same camera."""
    last_s: dict[str, float] = {}
    found = []
    for frame, time_s in tracker.times_s.items():
        camera = tracker.camera_of.get(frame, "")
        if time_s <= last_s.get(camera, -np.inf):
            found.append(frame)
        last_s[camera] = time_s
    return tuple(found)


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
