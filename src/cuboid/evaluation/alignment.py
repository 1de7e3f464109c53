"""Transforms results with estimated camera poses into the world of the ground truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cuboid.core.errors import FrameError, InputError
from cuboid.evaluation.result import Result
from cuboid.geometry.se3 import mean_motion
from cuboid.outputs import read_trajectory
from cuboid.readers.posetext import Trajectory

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
    beside = truth.parent / TRUE_TRAJECTORY
    if trajectory is None and result.poses == "estimated" and beside.is_file():
        trajectory = beside
    if trajectory is None:
        return result
    if result.trajectory is None:
        raise InputError(f"{result.path}: has no trajectory to compare with {trajectory}")
    true_trajectory, true, found = Trajectory(trajectory), [], []
    for row in read_trajectory(result.trajectory):
        try:
            true.append(true_trajectory.at(row.timestamp_s))
        except FrameError:  # no true pose near this time
            continue
        found.append(row.T_world_camera)
    if not true:
        raise InputError(f"{trajectory}: has no pose at any time of {result.trajectory}")
    return result.moved(mean_motion(np.array(true), np.array(found)))
