"""Calibration of a recording, with its own poses or with poses that are estimated alongside."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Frame
from cuboid.inputs.calibration.calibrate import CalibrationResult, calibrate, spread_out
from cuboid.inputs.readers import Recording
from cuboid.inputs.readers.usable import posed_frames, usable_poses

# Poses and focal length are estimated alternately: maximum number of rounds, and relative change of the focal length at
# which the iteration ends.
MAX_ROUNDS = 4
CONVERGED = 0.004
# Up to every third frame is enough for the poses (the camera turns little in a tenth of a second), but at least
# ENOUGH_FRAMES frames are used.
LONGEST_STEP, ENOUGH_FRAMES = 3, 300


def calibrate_recording(
    recording: Recording,
    *,
    poses: str | None = None,
    every: int = 1,
    limit: int | None = None,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> CalibrationResult:
    """Find the pinhole and the depth scale of a recording.

    Parameters
    ----------
    recording : Recording
        The recording; its intrinsics are the start of the search.
    poses : {"given", "estimated"}, optional
        Source of poses; default: the recording's own, if it has any.
    every, limit : int
        Use every n-th frame, and at most this many.
    progress : callable
        Called during pose estimation with the number of finished frames and the total number.

    Raises
    ------
    InputError
        The frames do not determine the intrinsics; or given poses are requested and there are none.
    """
    if poses == "estimated" or (poses is None and not recording.has_poses):
        return _with_estimated_poses(recording, every, limit, progress)
    if not recording.has_poses:
        raise InputError(f"{recording.path}: has no camera poses; --poses estimated finds them")
    frames = range(0, len(recording), every)[:limit]
    return calibrate(_posed(recording, usable_poses(recording, frames)), recording.intrinsics)


def _with_estimated_poses(
    recording: Recording, every: int, limit: int | None, progress: Callable[[int, int], None]
) -> CalibrationResult:
    """Estimate poses and focal length alternately."""
    found, previous = None, recording
    count = len(range(0, len(recording), every)[:limit])
    step = min(LONGEST_STEP, max(1, count // ENOUGH_FRAMES))
    for _ in range(MAX_ROUNDS):
        frames = range(0, len(previous), every * step)[: -(-count // step)]
        trajectory = _trajectory(previous, frames, progress)
        result = calibrate(_posed(previous, trajectory), previous.intrinsics, estimated=True)
        change = abs(float(np.log(result.intrinsics.fx / previous.intrinsics.fx)))
        found = replace(
            result,
            start=recording.intrinsics,
            gap_before_m=result.gap_before_m if found is None else found.gap_before_m,
            focal_error=float(np.hypot(result.focal_error, change)),  # a next round could change as much again
        )
        previous = previous.with_intrinsics(found.intrinsics)
        if change < CONVERGED:
            break
    assert found is not None
    return found


def _trajectory(
    recording: Recording, frames: range, progress: Callable[[int, int], None]
) -> Mapping[int, Float64Array]:
    """Estimate T_world_camera (4, 4) of frames, by number; frames without a pose are left out."""
    from cuboid.method.poses import PoseEstimator  # imported here: it compiles kernels that given poses do not need

    unposed = recording.without_poses()
    estimator = PoseEstimator(unposed.intrinsics)
    for done, index in enumerate(frames, 1):
        with suppress(FrameError):
            estimator.update(unposed.read(index))
        progress(done, len(frames))
    if not estimator.keyframes:
        raise InputError(f"{recording.path}: no frame has enough depth and texture to start with")
    return estimator.trajectory()


def _posed(recording: Recording, T_world_camera: Mapping[int, Float64Array]) -> Iterator[Frame]:
    """Iterate over the frames to compare, with their poses."""
    return posed_frames(recording.without_poses().read, T_world_camera, spread_out(T_world_camera))
