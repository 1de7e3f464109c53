"""Camera poses at times, from any file or folder that holds them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import CuboidError, FrameError, InputError
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.formats.folder import TRAJECTORY
from cuboid.ground.formats.table_validation import data_lines
from cuboid.inputs.readers import open_recording
from cuboid.inputs.readers.posetext import Trajectory, parse_numbers, pose_from_quaternion
from cuboid.inputs.readers.recording import DEFAULT_RATE_HZ
from cuboid.inputs.readers.usable import usable_poses

# Suffix of pose files of RGB-D Scenes v2: one line per frame, without times.
POSE_SUFFIX = ".pose"
POSE_FIELDS = "qw qx qy qz tx ty tz"


@dataclass(frozen=True, slots=True)
class TimedPoses:
    """Poses in the order of their times.

    Attributes
    ----------
    path : Path
        Source of the poses.
    times_s : (N,) float64
        Increasing times, seconds.
    T_world_camera : (N, 4, 4) float64
    """

    path: Path
    times_s: Float64Array
    T_world_camera: Float64Array

    def __post_init__(self) -> None:
        if self.T_world_camera.shape != (len(self.times_s), 4, 4):
            raise ValueError(f"{len(self.times_s)} times need as many 4x4 poses, got {self.T_world_camera.shape}")
        if np.any(np.diff(self.times_s) < 0):
            raise ValueError("times must rise")

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.times_s)

    @property
    def interval_s(self) -> float:
        """The median time between consecutive poses; 0 for a single pose."""
        return float(np.median(np.diff(self.times_s))) if len(self) > 1 else 0.0


def read_poses(path: PathLike) -> TimedPoses:
    """Read camera poses.

    Parameters
    ----------
    path : path
        A file of lines ``timestamp tx ty tz qx qy qz qw`` (the TUM format, as in ``trajectory.txt``), a ``.pose`` file
        of RGB-D Scenes v2 (one line per frame, time = frame / 30 s), the folder of a result, or a recording with poses.

    Raises
    ------
    InputError
        If there are no poses, or a line is malformed.
    """
    path = as_path(path)
    if not path.exists():
        raise InputError(f"{path} does not exist")
    if not path.is_dir():
        return _frame_lines(path) if path.suffix == POSE_SUFFIX else _lines(path)
    if (path / TRAJECTORY).is_file():
        return _lines(path / TRAJECTORY)
    return _recording(path)


def _lines(path: Path) -> TimedPoses:
    trajectory = Trajectory(path)
    return TimedPoses(path, trajectory.times_s, trajectory.T_world_camera)


def _frame_lines(path: Path) -> TimedPoses:
    times, poses = [], []
    for frame, (number, line) in enumerate(data_lines(path)):
        try:
            values = parse_numbers(line, 7, POSE_FIELDS)
        except ValueError as error:
            raise InputError(f"{path} line {number}: {error}") from None
        try:
            poses.append(pose_from_quaternion(values[:4], values[4:], f"{path} line {number}"))
        except FrameError:  # a gap: this frame has no pose
            continue
        times.append(frame / DEFAULT_RATE_HZ)
    return _of(path, times, poses)


def _recording(path: Path) -> TimedPoses:
    try:
        recording = open_recording(path)
    except CuboidError as error:
        raise InputError(f"{path}: is neither a result with {TRAJECTORY} nor a recording: {error}") from None
    poses = usable_poses(recording, range(len(recording)))
    return _of(path, [recording.timestamp_s(index) for index in poses], list(poses.values()))


def _of(path: Path, times_s: list[float], poses: list[Float64Array]) -> TimedPoses:
    if not poses:
        raise InputError(f"{path}: holds no camera pose")
    order = np.argsort(times_s, kind="stable")
    return TimedPoses(path, np.array(times_s)[order], np.array(poses)[order])
