"""Transforms results with estimated camera poses into the world of the ground truth."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.geometry.se3 import mean_motion
from cuboid.inputs.readers.posetext import Trajectory
from cuboid.lab.evaluation.result import Result
from cuboid.results.files import read_trajectory

# File of the true camera poses of a synthetic recording, beside its truth file.
TRUE_TRAJECTORY = "true_trajectory.txt"


def in_world_of(result: Result, truth: Path, trajectory: Path | None) -> Result:
    """Return the result in the world of the truth.

    Parameters
    ----------
    result : Result
    truth : Path
        The truth file. A true trajectory beside it is used if the result's poses were estimated.
    trajectory : Path or None
        True poses in the TUM format; if given, they are used for any kind of result poses.

    Raises
    ------
    InputError
        The trajectories cannot be read or have no time in common.
    """
    default = truth.parent / TRUE_TRAJECTORY
    if trajectory is None and result.poses == "estimated" and default.is_file():
        trajectory = default
    if trajectory is None:
        return result
    if result.trajectory is None:
        raise InputError(f"{result.path}: has no trajectory to compare with {trajectory}")
    poses = ((row.timestamp_s, row.T_world_camera) for row in read_trajectory(result.trajectory))
    return result.moved(motion_to_truth(trajectory, poses, str(result.trajectory)))


def motion_to_truth(trajectory: Path, poses: Iterable[tuple[float, Float64Array]], name: str) -> Float64Array:
    """Return the rigid T_truth_world (4, 4) that best aligns estimated poses with true ones.

    Parameters
    ----------
    trajectory : Path
        True poses in the TUM format.
    poses : iterable of (float, (4, 4) float64)
        Estimated poses with their times, seconds.
    name : str
        Name of the estimated poses for messages.

    Raises
    ------
    InputError
        The trajectory cannot be read or has no time in common with the poses.
    """
    true_trajectory, true, found = Trajectory(trajectory), [], []
    for time_s, T_world_camera in poses:
        with suppress(FrameError):  # no true pose near this time
            true.append(true_trajectory.at(time_s))
            found.append(T_world_camera)
    if not true:
        raise InputError(f"{trajectory}: has no pose at any time of {name}")
    return mean_motion(np.array(true), np.array(found))
