"""Calibrates a recording: with its own poses, or with poses that are estimated along."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from cuboid.calibration.calibrate import CalibrationResult, calibrate, spread_out
from cuboid.core.errors import FrameError, InputError
from cuboid.core.frame import Float64Array, Frame
from cuboid.readers import Recording

# Poses and focal length are estimated in turn, so often at most, until the latter changes by less than this fraction.
ROUNDS = 4
CONVERGED = 0.004
# Up to every third frame is enough for that (the camera turns little in a tenth of a second), but this many are used.
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
        Its intrinsics are where the search begins.
    poses : {"given", "estimated"}, optional
        The recording's own where it has them.
    every, limit : int
        Use each n-th frame; of the first this many.
    progress : callable
        Told, while poses are estimated, how many frames are done and of how many.

    Raises
    ------
    InputError
        The frames do not tell; or poses are to be given and there are none.
    """
    if poses == "estimated" or (poses is None and not recording.has_poses):
        return _with_estimated_poses(recording, every, limit, progress)
    if not recording.has_poses:
        raise InputError(f"{recording.path}: has no camera poses; --poses estimated finds them")
    frames = range(0, len(recording), every)[:limit]
    known: dict[int, Float64Array] = {}
    for index in frames:
        with suppress(FrameError):
            pose = recording.pose(index)
            if pose is not None:
                known[index] = pose
    return calibrate(_posed(recording, known), recording.intrinsics)


def _with_estimated_poses(
    recording: Recording, every: int, limit: int | None, progress: Callable[[int, int], None]
) -> CalibrationResult:
    """Estimate poses, then the focal length with them, and again with that one."""
    found, previous = None, recording
    count = len(range(0, len(recording), every)[:limit])
    step = min(LONGEST_STEP, max(1, count // ENOUGH_FRAMES))
    for _ in range(ROUNDS):
        frames = range(0, len(previous), every * step)[: -(-count // step)]
        trajectory = _trajectory(previous, frames, progress)
        result = calibrate(_posed(previous, trajectory), previous.intrinsics, estimated=True)
        change = abs(float(np.log(result.intrinsics.fx / previous.intrinsics.fx)))
        found = replace(
            result,
            start=recording.intrinsics,
            gap_before_m=result.gap_before_m if found is None else found.gap_before_m,
            focal_error=float(np.hypot(result.focal_error, change)),  # what the last round changed, a next one may too
        )
        previous = previous.with_intrinsics(found.intrinsics)
        if change < CONVERGED:
            break
    assert found is not None
    return found


def _trajectory(
    recording: Recording, frames: range, progress: Callable[[int, int], None]
) -> Mapping[int, Float64Array]:
    """Estimate T_world_camera (4, 4) of frames from their images, by number; those without a pose are left out."""
    from cuboid.poses import PoseEstimator  # compiles kernels that given poses do not need

    bare = recording.without_poses()
    estimator = PoseEstimator(bare.intrinsics)
    for done, index in enumerate(frames, 1):
        with suppress(FrameError):
            estimator.update(bare.read(index))
        progress(done, len(frames))
    if not estimator.keyframes:
        raise InputError(f"{recording.path}: no frame has enough depth and texture to start with")
    return estimator.trajectory()


def _posed(recording: Recording, T_world_camera: Mapping[int, Float64Array]) -> Iterator[Frame]:
    """Iterate over frames that are worth comparing, with their poses."""
    bare = recording.without_poses()
    for index in spread_out(T_world_camera):
        with suppress(FrameError):
            yield replace(bare.read(index), T_world_camera=T_world_camera[index])
