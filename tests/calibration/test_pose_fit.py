from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.pose_convention import POSE_CONVENTIONS, converted
from cuboid.ground.geometry.se3 import exp
from cuboid.inputs.calibration.pose_fit import DEPTH_FACTORS, pose_fit

K = Intrinsics(160.0, 160.0, 79.5, 59.5, 160, 120)


# The world of the given poses: that of the walls, turned and moved.
WORLD = exp(np.array([0.4, -0.7, 0.3, 0.5, -0.9, 0.7]))


def _true_pose(k: int) -> np.ndarray:
    """The camera goes sideways and turns, in front of a room's corner."""
    T = exp(np.array([0.0, 0.0, 0.0, 0.0, 0.017 * k, 0.0])) @ exp(np.array([0, 0, 0, 0.1 * np.sin(k / 7), 0, 0]))
    T[:3, 3] = [0.03 * k, 0.01 * k, 0.0]
    return T


def _read(k: int) -> Frame:
    """Depth of two walls that meet at right angles, z = 2 - |x| / 2 and the like, by the true pose."""
    T = _true_pose(k)
    rows, columns = np.indices((120, 160))
    rays = K.points(columns, rows, np.ones((120, 160))) @ T[:3, :3].T
    depth = np.full((120, 160), np.inf)
    for normal, offset in (((0.6, 0.0, 0.8), 2.0), ((-0.6, 0.0, 0.8), 2.0), ((0.0, 1.0, 0.0), 0.7)):
        n = np.array(normal)
        with np.errstate(divide="ignore"):
            along = (offset - n @ T[:3, 3]) / (rays @ n)
        depth = np.where((along > 0) & (along < depth), along, depth)
    depth[:10] = 0.0  # no reading
    return Frame(k, k / 30, np.zeros((120, 160, 3), np.uint8), depth.astype(np.float32), T)


def _fit(change: Callable[[np.ndarray], np.ndarray] = lambda T: T, read: Callable[[int], Frame] = _read):
    return pose_fit(read, K, {k: change(WORLD @ _true_pose(k)) for k in range(40)})


def test_true_poses_explain_the_depth() -> None:
    fit = _fit()
    assert fit.given > 0.95
    assert max(fit.converted, fit.still, fit.scaled) < fit.given - 0.1
    assert fit.moves
    assert fit.jump is None


def _read_as(names: tuple[str, ...]) -> Callable[[np.ndarray], np.ndarray]:
    """Return what turns a pose into one that `converted` turns back."""
    back = {"wxyz": ("xyzw",), "xyzw": ("wxyz",), "inverse": ("inverse",), "opengl": ("opengl",)}

    def spoilt(T: np.ndarray) -> np.ndarray:
        for name in reversed(names):
            T = T.copy()
            if name in ("mm", "cm"):
                T[:3, 3] *= {"mm": 1000.0, "cm": 100.0}[name]
            else:
                T = converted(T, back[name])
        return T

    return spoilt


@pytest.mark.parametrize("names", POSE_CONVENTIONS)
def test_poses_in_another_convention_are_recognised(names: tuple[str, ...]) -> None:
    spoilt = _read_as(names)
    assert converted(spoilt(_true_pose(7)), names) == pytest.approx(_true_pose(7))
    fit = _fit(spoilt)
    assert fit.convention == names
    assert fit.converted > 0.95
    assert max(fit.given or 0.0, fit.scaled) < fit.converted - 0.1


@pytest.mark.parametrize("frames", [-3, 3])
def test_poses_that_come_late_or_early_are_recognised(frames: int) -> None:
    """The camera moves forth and back, so that its motion is not the same at each time."""

    def to_and_fro(k: int) -> int:
        return round(30 + 30 * np.sin(k / 5))

    fit = pose_fit(lambda k: _read(to_and_fro(k)), K, {k: _true_pose(to_and_fro(k - frames)) for k in range(40)})
    assert fit.shift == frames
    assert fit.shifted > 0.95
    assert fit.given < fit.shifted - 0.1


def test_a_jump_that_the_frames_do_not_show_is_found() -> None:
    far = np.eye(4)
    far[0, 3] = 10.0
    fit = pose_fit(_read, K, {k: far @ _true_pose(k) if k >= 20 else _true_pose(k) for k in range(40)})
    assert fit.jump.frame == 20
    assert fit.jump.step_m == pytest.approx(10.0, abs=0.1)


def test_poses_that_never_change_are_recognised() -> None:
    fit = _fit(lambda _: np.eye(4))
    assert not fit.moves
    assert fit.given == fit.still < 0.6


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
    from cuboid.inputs.readers import open_recording
    from cuboid.runs.tracking.diagnosis import explains

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
        for names in (("inverse",), ("opengl",), ("wxyz",), ("mm",)):
            spoilt = _read_as(names)
            wrong = pose_fit(recording.read, recording.intrinsics, {k: spoilt(T) for k, T in poses.items()})
            assert not explains(wrong), name
            assert wrong.convention == names, name
