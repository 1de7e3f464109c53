"""Carries results whose camera poses were estimated into the world of the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cuboid.errors import FrameError, InputError
from cuboid.evaluation.result import Result
from cuboid.frame import Float64Array
from cuboid.geometry.se3 import compose, quat_wxyz_from_rotation
from cuboid.outputs import read_trajectory
from cuboid.readers.posetext import Trajectory

# What a made recording calls its true camera poses, beside its truth file.
TRUE_TRAJECTORY = "true_trajectory.txt"


def in_world_of(result: Result, truth: Path, trajectory: Path | None) -> Result:
    """Return the result in the world of the truth.

    Parameters
    ----------
    result : Result
    truth : Path
        The truth file. A true trajectory beside it is used where the result's poses were estimated.
    trajectory : Path or None
        True poses in the TUM form, which are used whatever the result's poses are.

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
    known, true, found = Trajectory(trajectory), [], []
    for row in read_trajectory(result.trajectory):
        try:
            true.append(known.at(row.timestamp_s))
        except FrameError:  # no true pose near this time
            continue
        found.append(row.T_world_camera)
    if not true:
        raise InputError(f"{trajectory}: has no pose at any time of {result.trajectory}")
    return result.moved(mean_motion(np.array(true), np.array(found)))


def mean_motion(T_a_camera: Float64Array, T_b_camera: Float64Array) -> Float64Array:
    """Return the rigid T_a_b (4, 4) that best carries the poses (N, 4, 4) of one world to those of another.

    The rotation is the chordal mean of R_a R_b^T (Hartley, Trumpf, Dai, Li, "Rotation Averaging", IJCV 2013), so
    that a camera that moved along a line, or not at all, determines it too; the translation then has least
    squares.
    """
    turns = T_a_camera[:, :3, :3] @ T_b_camera[:, :3, :3].transpose(0, 2, 1)
    left, _, right = np.linalg.svd(turns.sum(0))
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    shift = (T_a_camera[:, :3, 3] - T_b_camera[:, :3, 3] @ rotation.T).mean(0)
    return compose(quat_wxyz_from_rotation(rotation), shift)
