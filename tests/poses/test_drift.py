from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from cuboid import open_recording
from cuboid.core.errors import FrameError
from cuboid.core.frame import Frame
from cuboid.geometry import se3
from cuboid.geometry.box import Box
from cuboid.poses import drift
from cuboid.poses.alignment import pick
from cuboid.poses.drift import DriftCorrection, explained
from cuboid.poses.pyramid import build_levels, shrink
from cuboid.poses.sources import CorrectedPoses
from made_scenes import CAMERA, frame_of, look_at, upright

# A table top with things of several sizes, seen from an arc of 60 degrees, there and back.
SCENE = [
    Box(np.array([0.0, 0.0, -0.02]), np.array([1.6, 1.2, 0.04]), np.eye(3)),
    upright((-0.35, 0.1), (0.2, 0.12, 0.25), 0.4),
    upright((0.1, -0.2), (0.15, 0.15, 0.1)),
    upright((0.4, 0.2), (0.1, 0.25, 0.18), 1.1),
    upright((-0.1, 0.35), (0.3, 0.08, 0.05), 0.2),
]
ANGLES = np.radians(np.concatenate([np.linspace(-30, 30, 40), np.linspace(30, -30, 40)]))
TRUE = [look_at((1.3 * np.sin(a), -1.3 * np.cos(a), 0.8), (0.0, 0.0, 0.05)) for a in ANGLES]


def small_motion(metres: np.ndarray, radians: np.ndarray) -> np.ndarray:
    return se3.exp(np.concatenate([metres, radians]))


def drifting(step_m: float, step_rad: float) -> list[np.ndarray]:
    """The true poses with an error that adds up, always the same way: what a gyroscope's bias leaves."""
    wrong, given = np.eye(4), []
    for T in TRUE:
        given.append(wrong @ T)
        wrong = wrong @ small_motion(np.array([step_m, 0.0, 0.0]), np.array([0.0, 0.0, step_rad]))
    return given


def run(given: list[np.ndarray]) -> tuple[DriftCorrection, list[np.ndarray]]:
    correction = DriftCorrection(CAMERA)
    found = [
        correction.correct(frame_of(SCENE, true, k, T_shown=shown), shown)
        for k, (true, shown) in enumerate(zip(TRUE, given, strict=True))
    ]
    return correction, found


def off_m(found: list[np.ndarray]) -> np.ndarray:
    return np.array([np.linalg.norm(T[:3, 3] - true[:3, 3]) for T, true in zip(found, TRUE, strict=True)])


def test_poses_that_explain_what_is_seen_stay_as_they_are_to_the_last_bit() -> None:
    correction, found = run(TRUE)
    assert correction.proven_at is None
    assert correction.most_m == 0.0
    assert all(T is true for T, true in zip(found, TRUE, strict=True))


def test_poses_that_drift_are_held_to_what_was_seen_before() -> None:
    given = drifting(0.001, 0.001)
    correction, found = run(given)
    assert correction.proven_at is not None
    assert correction.proven_at < 60
    assert off_m(given)[-10:].min() > 0.08
    # Back where it began the camera is known to be there again.
    assert off_m(found)[-10:].max() < 0.015
    assert correction.most_m == pytest.approx(
        max(np.linalg.norm(a[:3, 3] - b[:3, 3]) for a, b in zip(found, given, strict=True))
    )


def test_a_jump_is_taken_back_and_so_is_its_end() -> None:
    jump = small_motion(np.array([0.05, 0.02, 0.0]), np.array([0.0, 0.0, 0.03]))
    given = [jump @ T if 30 <= k < 60 else T for k, T in enumerate(TRUE)]
    correction, found = run(given)
    assert correction.proven_at is not None
    assert 30 <= correction.proven_at < 50
    after = off_m(found)[correction.proven_at :]
    # Frames between two comparisons have what the last one found: of the jump's end one frame or two.
    assert np.median(after) < 0.006
    assert np.count_nonzero(after > 0.02) <= 3


def test_a_run_says_that_its_poses_drift() -> None:
    warnings = {}
    for name, given in (("drifting", drifting(0.002, 0.001)), ("true", TRUE)):
        poses = CorrectedPoses(CAMERA)
        for k, (true, shown) in enumerate(zip(TRUE, given, strict=True)):
            posed = poses.locate(frame_of(SCENE, true, k, T_shown=shown))
        warnings[name] = poses.warnings()
        assert np.linalg.norm(posed.T_world_camera[:3, 3] - TRUE[-1][:3, 3]) < 0.015
    assert warnings["true"] == ()
    (warning,) = warnings["drifting"]
    assert re.fullmatch(
        r"the given camera poses drift: from frame \d+ on they are aligned to earlier frames, \d+ cm off at most",
        warning,
    )
    with pytest.raises(FrameError, match="no camera pose"):
        poses.locate(dataclasses.replace(frame_of(SCENE, TRUE[0], 0), T_world_camera=None))


def test_poses_that_are_only_checked_stay_as_they_are() -> None:
    poses, given = CorrectedPoses(CAMERA, apply=False), drifting(0.002, 0.001)
    for k, (true, shown) in enumerate(zip(TRUE, given, strict=True)):
        frame = frame_of(SCENE, true, k, T_shown=shown)
        assert np.array_equal(poses.locate(frame).T_world_camera, frame.T_world_camera)
    (warning,) = poses.warnings()
    assert re.fullmatch(
        r"the given camera poses drift: from frame \d+ on they disagree .*; --poses corrected .*", warning
    )
    assert poses.origin == "given"


def test_the_same_frames_give_the_same_poses() -> None:
    given = drifting(0.002, 0.001)
    assert all(np.array_equal(a, b) for a, b in zip(run(given)[1], run(given)[1], strict=True))


def test_keyframes_are_no_more_than_are_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drift, "MAX_KEYFRAMES", 3)
    correction, _ = run(TRUE)
    assert len(correction._keyframes) == 3


def test_a_frame_without_depth_or_of_another_size_changes_nothing() -> None:
    correction = DriftCorrection(CAMERA)
    empty = Frame(0, 0.0, np.zeros((240, 320, 3), np.uint8), np.zeros((240, 320), np.float32), TRUE[0])
    other = Frame(1, 0.1, np.zeros((120, 160, 3), np.uint8), np.ones((120, 160), np.float32), TRUE[1])
    assert correction.correct(empty, TRUE[0]) is TRUE[0]
    assert correction.correct(other, TRUE[1]) is TRUE[1]
    assert correction.correct(frame_of(SCENE, TRUE[2], 2), TRUE[2]) is TRUE[2]


def test_what_a_pose_explains_by_hand() -> None:
    """A wall at 1 m, seen from 1 m and, as is claimed, from 2 cm nearer: 3 deviations at 1 m are 7 mm."""
    v, u = np.mgrid[:240, :320]
    color = np.repeat(((u // 7 + v // 5) % 2 * 120 + 60).astype(np.uint8)[..., None], 3, axis=2)
    levels = build_levels(*shrink(Frame(0, 0.0, color, np.ones((240, 320), np.float32)), CAMERA))
    reference = pick(levels)
    nearer, little = np.eye(4), np.eye(4)
    nearer[2, 3], little[2, 3] = -0.02, -0.005
    assert explained(reference, levels[drift.TOLD_AT], np.eye(4)) == 1.0
    assert explained(reference, levels[drift.TOLD_AT], little) == 1.0
    assert explained(reference, levels[drift.TOLD_AT], nearer) == 0.0
    away = np.eye(4)
    away[2, 3] = 1.0  # half a metre and more off: hidden by something, which tells nothing
    assert explained(reference, levels[drift.TOLD_AT], away) == 0.0


def test_a_tracker_that_drifts_on_a_real_desk_is_told_from_exact_poses_of_a_real_office(data_dir: Path) -> None:
    proven = {}
    for name in ("desk-realsense", "office-scan"):
        recording = open_recording(data_dir / name)
        correction = DriftCorrection(recording.intrinsics)
        for k in range(60):
            frame = recording.read(k)
            assert frame.T_world_camera is not None
            correction.correct(frame, frame.T_world_camera)
        proven[name] = correction.proven_at is not None
    assert proven == {"desk-realsense": True, "office-scan": False}
