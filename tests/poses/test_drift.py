from __future__ import annotations

import dataclasses
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hostile_worlds import DRIFTS, EXACT, FRAMES, TRUE, World, small_motion

from cuboid import open_recording
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.pose_convention import convention_names, converted
from cuboid.method.poses import drift
from cuboid.method.poses.alignment import pick
from cuboid.method.poses.comparison import COMPARED_LEVEL, clearly_better, explained
from cuboid.method.poses.drift import DriftCorrection
from cuboid.method.poses.pyramid import build_levels, shrink
from cuboid.method.poses.sources import CorrectedPoses
from made_scenes import CAMERA


def run(world: World) -> tuple[DriftCorrection, list[np.ndarray]]:
    correction = DriftCorrection(CAMERA)
    return correction, [correction.correct(frame, frame.T_world_camera) for frame in world.frames()]


def as_read(T: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Return how a pose reads whose file is in conventions that are taken for ours."""
    back = {"wxyz": ("xyzw",)}
    for name in reversed(names):
        T = converted(T, back.get(name, (name,)))
    return T


CONVENTIONS = ("inverse", "opengl", "wxyz", "inverse,opengl", "wxyz,inverse")
BODY = small_motion((0.05, 0.02, -0.03), (0.03, -0.05, 0.02))
OTHERS = {name: World(given=[as_read(T, convention_names(name)) for T in TRUE]) for name in CONVENTIONS}
OTHERS["another body"] = World(given=[T @ BODY for T in TRUE])


@cache
def run_of(name: str) -> tuple[DriftCorrection, list[np.ndarray]]:
    return run((EXACT | DRIFTS | OTHERS)[name])


def off_m(found: list[np.ndarray]) -> np.ndarray:
    return np.array([np.linalg.norm(T[:3, 3] - true[:3, 3]) for T, true in zip(found, TRUE, strict=True)])


@pytest.mark.parametrize("name", EXACT)
def test_exact_poses_stay_as_they_are_to_the_last_bit(name: str) -> None:
    """Whatever moves in the picture, and whatever the sensor has wrong."""
    correction, found = run_of(name)
    assert correction.proven_at is None
    assert correction.withdrawn_at is None
    assert correction.max_shift_m == 0.0
    assert all(T is true for T, true in zip(found, TRUE, strict=True))


@pytest.mark.parametrize("factor", [0.9, 0.95, 1.05, 1.1])
def test_a_wrong_depth_scale_is_named(factor: float) -> None:
    correction, _ = run_of(f"depth times {factor}")
    assert correction.cause is not None
    assert correction.cause.scale == pytest.approx(factor, abs=0.002)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_poses_in_another_convention_are_named_and_never_corrected(convention: str) -> None:
    correction, found = run_of(convention)
    assert (correction.proven_at, correction.withdrawn_at, correction.max_shift_m) == (None, None, 0.0)
    assert all(T is as_given for T, as_given in zip(found, OTHERS[convention].given, strict=True))
    assert correction.cause is not None
    assert correction.cause.convention == convention_names(convention)


def test_poses_of_another_body_than_the_camera_are_named() -> None:
    correction, _ = run_of("another body")
    assert correction.proven_at is None
    assert correction.cause is not None
    assert correction.cause.offset is not None


@pytest.mark.parametrize(
    ("name", "proven", "end_m"),
    [
        ("drift 1 mm", 30, 0.01),
        ("drift 2 mm", 20, 0.01),
        ("drift 0.5 mm", 60, 0.01),
        ("walk", 20, 0.01),
        ("drift 2 mm and a mover", 20, 0.02),
        ("drift 2 mm and a large mover", 20, 0.02),
        ("drift 1 mm and a large mover", 50, 0.01),
        ("drift 2 mm and a mover that turns", 55, 0.01),
        ("drift 1 mm and a mover that turns", 55, 0.01),
    ],
)
def test_poses_that_drift_are_held_to_what_was_seen_before(name: str, proven: int, end_m: float) -> None:
    correction, found = run_of(name)
    assert correction.proven_at is not None
    assert correction.proven_at < proven
    # Back where it began the camera is known to be there again.
    assert off_m(found)[-10:].max() < end_m
    assert off_m(found).mean() < 0.5 * off_m(DRIFTS[name].given).mean()
    assert correction.max_shift_m == pytest.approx(
        max(np.linalg.norm(a[:3, 3] - b[:3, 3]) for a, b in zip(found, DRIFTS[name].given, strict=True))
    )


def test_a_jump_is_taken_back_and_so_is_its_end() -> None:
    correction, found = run_of("jump")
    assert correction.proven_at is not None
    assert 30 <= correction.proven_at < 50
    after = off_m(found)[correction.proven_at :]
    # Frames between two comparisons have what the last one found: of the jump's end one frame or two.
    assert np.median(after) < 0.006
    assert np.count_nonzero(after > 0.02) <= 3


def test_a_correction_that_does_not_hold_is_taken_back() -> None:
    """A large thing enters before plain walls, and nothing else tells that it is not the camera that moves."""
    correction, found = run(World("enter", 0.6, contrast=0.0))
    assert correction.withdrawn_at is not None
    assert correction.proven_at is None
    assert off_m(found).max() > 0.1
    assert off_m(found)[correction.withdrawn_at - FRAMES :].max() == 0.0


def test_poses_of_a_run_are_corrected_once_they_have_proved_to_drift() -> None:
    world, poses = DRIFTS["drift 2 mm"], CorrectedPoses(CAMERA)
    found = [poses.locate(frame).T_world_camera for frame in world.frames()]
    first = run_of("drift 2 mm")[0].proven_at
    assert first is not None
    assert all(T is given for T, given in zip(found[:first], world.given, strict=False))
    assert not any(np.array_equal(T, given) for T, given in zip(found[first:], world.given[first:], strict=True))
    assert off_m(found).mean() < 0.5 * off_m(world.given).mean()
    assert off_m(found)[-10:].max() < 0.01 < off_m(world.given)[-10:].min()
    (warning,) = poses.warnings()
    assert warning.startswith(f"the given camera poses drift: from frame {first} on they are aligned")


def test_a_run_says_how_many_moving_pixels_were_left_out() -> None:
    correction, _ = run_of("drift 2 mm")
    assert correction.left_out.frames == 0
    poses = CorrectedPoses(CAMERA)
    for frame in DRIFTS["drift 2 mm and a large mover"].frames():
        poses.locate(frame)
    _, moved = poses.warnings()
    assert re.fullmatch(
        r"something moved in \d+ frames: [23]\d % of their pixels were left out of the camera poses", moved
    )


def test_a_run_says_why_poses_do_not_fit() -> None:
    def said(poses: CorrectedPoses) -> tuple[str, ...]:
        return (*poses.warnings(), *(() if poses.misfit is None else (poses.misfit,)))

    def warnings(name: str) -> tuple[str, ...]:
        poses = CorrectedPoses(CAMERA)
        assert poses.origin == "corrected"
        poses._drift = run_of(name)[0]
        return said(poses)

    assert warnings("nothing wrong") == ()
    (warning,) = warnings("drift 2 mm")
    assert re.fullmatch(
        r"the given camera poses drift: from frame \d+ on they are aligned to earlier frames, \d+ cm off at most",
        warning,
    )
    unchanged = CorrectedPoses(CAMERA, apply=False)
    assert unchanged.origin == "given"
    for frame in DRIFTS["drift 2 mm"].frames():
        np.testing.assert_array_equal(unchanged.locate(frame).T_world_camera, frame.T_world_camera)
    (warning,) = said(unchanged)
    assert re.fullmatch(
        r"the given camera poses drift: from frame \d+ on they disagree .*; --poses corrected .*", warning
    )
    (warning,) = warnings("depth times 0.9")
    assert "the depth is 0.90 times what the poses say; --depth-scale" in warning
    (warning,) = warnings("another body")
    assert "another sensor than the camera" in warning
    (warning,) = warnings("inverse")
    assert warning.endswith("they agree with the frames; run again with --pose-convention inverse")


def test_a_frame_without_a_pose_is_refused() -> None:
    with pytest.raises(FrameError, match="no camera pose"):
        CorrectedPoses(CAMERA).locate(dataclasses.replace(next(World().frames()), T_world_camera=None))


def test_the_same_frames_give_the_same_poses() -> None:
    (_, once), (_, again) = run_of("drift 2 mm"), run(DRIFTS["drift 2 mm"])
    assert all(np.array_equal(a, b) for a, b in zip(once, again, strict=True))


def test_keyframes_are_no_more_than_are_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drift, "MAX_KEYFRAMES", 3)
    correction, _ = run(World())
    assert len(correction._keyframes) == 3


def test_a_frame_without_depth_or_of_another_size_changes_nothing() -> None:
    correction = DriftCorrection(CAMERA)
    empty = Frame(0, 0.0, np.zeros((240, 320, 3), np.uint8), np.zeros((240, 320), np.float32), TRUE[0])
    other = Frame(1, 0.1, np.zeros((120, 160, 3), np.uint8), np.ones((120, 160), np.float32), TRUE[1])
    assert correction.correct(empty, TRUE[0]) is TRUE[0]
    assert correction.correct(other, TRUE[1]) is TRUE[1]
    assert correction.correct(next(World().frames()), TRUE[2]) is TRUE[2]


def test_what_a_pose_explains_by_hand() -> None:
    """A wall at 1 m, seen from 1 m and, as is claimed, from 2 cm nearer: 3 deviations at 1 m are 7 mm."""
    v, u = np.mgrid[:240, :320]
    color = np.repeat(((u // 7 + v // 5) % 2 * 120 + 60).astype(np.uint8)[..., None], 3, axis=2)
    levels = build_levels(*shrink(Frame(0, 0.0, color, np.ones((240, 320), np.float32)), CAMERA))
    reference = pick(levels)
    nearer, little = np.eye(4), np.eye(4)
    nearer[2, 3], little[2, 3] = -0.02, -0.005
    level = levels[COMPARED_LEVEL]
    same, near, far = (explained(reference, level, T) for T in (np.eye(4), little, nearer))
    assert (same.fraction, near.fraction, far.fraction) == (1.0, 1.0, 0.0)
    away = np.eye(4)
    away[2, 3] = 1.0  # half a metre and more off: hidden by something, which tells nothing
    assert explained(reference, level, away).fraction == 0.0
    assert clearly_better(same, far)
    assert not clearly_better(far, same)
    assert not clearly_better(same, near)
    # It gains half of the wall and loses the other half, as an alignment to a thing that moves does.
    half = np.arange(len(same.alike)) % 2 == 0
    assert not clearly_better(
        dataclasses.replace(same, alike=same.alike & half), dataclasses.replace(same, alike=same.alike & ~half)
    )


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
