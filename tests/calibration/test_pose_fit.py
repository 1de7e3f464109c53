from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cuboid.calibration.pose_fit import DEPTH_FACTORS, pose_fit
from cuboid.core.errors import FrameError
from cuboid.core.frame import Frame, Intrinsics

K = Intrinsics(160.0, 160.0, 79.5, 59.5, 160, 120)


def _true_pose(k: int) -> np.ndarray:
    """The camera goes sideways and turns, in front of a room's corner."""
    angle = np.radians(1.0 * k)
    T = np.eye(4)
    T[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    T[:3, 3] = [0.03 * k, 0.01 * k, 0.0]
    return T


def _read(k: int) -> Frame:
    """Depth of two walls that meet at right angles, z = 2 - |x| / 2 and the like, by the true pose."""
    T = _true_pose(k)
    rows, columns = np.indices((120, 160))
    rays = np.stack([(columns - K.cx) / K.fx, (rows - K.cy) / K.fy, np.ones((120, 160))], axis=-1) @ T[:3, :3].T
    depth = np.full((120, 160), np.inf)
    for normal, offset in (((0.6, 0.0, 0.8), 2.0), ((-0.6, 0.0, 0.8), 2.0), ((0.0, 1.0, 0.0), 0.7)):
        n = np.array(normal)
        with np.errstate(divide="ignore"):
            along = (offset - n @ T[:3, 3]) / (rays @ n)
        depth = np.where((along > 0) & (along < depth), along, depth)
    depth[:10] = 0.0  # no reading
    return Frame(k, k / 30, np.zeros((120, 160, 3), np.uint8), depth.astype(np.float32), T)


def _fit(change: Callable[[np.ndarray], np.ndarray] = lambda T: T, read: Callable[[int], Frame] = _read):
    return pose_fit(read, K, {k: change(_true_pose(k)) for k in range(40)})


def test_true_poses_explain_the_depth() -> None:
    fit = _fit()
    assert fit.given > 0.95
    assert max(fit.inverted, fit.still, fit.scaled) < fit.given - 0.1


def test_inverted_poses_are_better_inverted() -> None:
    fit = _fit(np.linalg.inv)
    assert fit.inverted > 0.95
    assert max(fit.given, fit.scaled) < fit.inverted - 0.1


@pytest.mark.parametrize("factor", DEPTH_FACTORS)
def test_a_wrong_depth_scale_is_found(factor: float) -> None:
    """Poses times 1 / factor are a depth that is too large by factor."""

    def shrunk(T: np.ndarray) -> np.ndarray:
        return np.block([[T[:3, :3], T[:3, 3:] / factor], [T[3:]]])

    fit = _fit(shrunk)
    assert fit.depth_factor == pytest.approx(1 / factor)
    assert fit.scaled > 0.95
    assert (fit.given or 0.0) < fit.scaled - 0.1


def test_too_few_frames_tell_nothing() -> None:
    assert pose_fit(_read, K, {k: _true_pose(k) for k in range(5)}) is None

    def unreadable(k: int) -> Frame:
        raise FrameError("gone")

    assert _fit(read=unreadable) is None


def test_given_poses_of_real_recordings_explain_them(data_dir) -> None:
    from cuboid.readers import open_recording
    from cuboid.tracking.diagnosis import explains

    for name in ("office-scan", "rgbd-scenes-v2/imgs/scene_01", "rgbd_dataset_freiburg1_xyz", "desk-realsense"):
        recording = open_recording(data_dir / name)
        poses = {}
        for k in range(min(100, len(recording))):
            try:
                poses[k] = recording.pose(k)
            except FrameError:
                continue
        good = pose_fit(recording.read, recording.intrinsics, poses)
        assert explains(good), name
        inverted = {k: np.linalg.inv(T) for k, T in poses.items()}
        assert not explains(pose_fit(recording.read, recording.intrinsics, inverted)), name
