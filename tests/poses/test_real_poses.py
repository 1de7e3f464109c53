"""The way of a real camera, against the poses published with its recording."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from posed_pictures import ate_m

from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame
from cuboid.inputs.readers import Recording, open_recording
from cuboid.method.poses import PoseEstimator


def frames_of(recording: Recording, indices: range) -> Iterator[Frame]:
    bare = recording.without_poses()
    for index in indices:
        try:
            yield bare.read(index)
        except FrameError:  # color without depth
            continue


def true_poses(recording: Recording, frames: list[int]) -> dict[int, np.ndarray]:
    found = {}
    for index in frames:
        try:
            found[index] = recording.pose(index)
        except FrameError:
            continue
    return found


def error_m(estimator: PoseEstimator, recording: Recording) -> float:
    trajectory = estimator.trajectory()
    true = true_poses(recording, list(trajectory))
    return ate_m([trajectory[k] for k in true], list(true.values()))


def test_a_hand_held_camera_at_a_desk(data_dir: Path) -> None:
    recording = open_recording(data_dir / "rgbd_dataset_freiburg1_xyz")
    estimator = PoseEstimator(recording.intrinsics)
    lost = [f.index for f in frames_of(recording, range(400)) if estimator.update(f).T_world_camera is None]
    assert lost == []
    assert error_m(estimator, recording) < 0.012


@pytest.fixture(scope="module")
def table(data_dir: Path) -> Recording:
    return open_recording(data_dir / "rgbd-scenes-v2")


def test_once_round_a_table_at_six_times_the_speed(table: Recording) -> None:
    estimator = PoseEstimator(table.intrinsics)
    lost = [f.index for f in frames_of(table, range(0, 888, 6)) if estimator.update(f).T_world_camera is None]
    assert lost == []
    assert error_m(estimator, table) < 0.012


def test_a_covered_lens_and_a_jump(table: Recording) -> None:
    """From frame 300 on the lens is covered for 10 frames, in which the camera moves on by a second."""
    estimator = PoseEstimator(table.intrinsics)
    covered = 0
    for k, frame in enumerate(frames_of(table, range(240, 390, 3))):
        if 300 <= frame.index < 330:
            frame = Frame(frame.index, frame.timestamp_s, np.zeros_like(frame.color), np.zeros_like(frame.depth_m))
            covered += 1
        estimate = estimator.update(frame)
        assert (estimate.T_world_camera is None) == (300 <= frame.index < 330), k
    assert covered == 10
    assert error_m(estimator, table) < 0.008
