"""What moves is found, what rests is not, however the camera moves."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.working import thin
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from cuboid.method.heatmap.motion import REST_S, Motion
from made_scenes import CAMERA, cast, frame_of, look_at, upright

FLOOR = upright((0.0, 0.0), (6.0, 6.0, 0.02), z=-0.72)
TABLE = upright((0.0, 0.0), (1.2, 0.8, 0.7), z=-0.7)
STANDING = look_at((0.0, -1.1, 0.8), (0.0, 0.0, 0.0))


def thing(x: float) -> Box:
    return upright((x, 0.0), (0.12, 0.12, 0.15))


def marks(motion: Motion, boxes: list[Box], T: np.ndarray, index: int) -> np.ndarray:
    """Where something moves, (240, 320)."""
    found = motion.find(thin(frame_of(boxes, T, index), CAMERA, 320, index), T, index / 30)
    return np.zeros((CAMERA.height, CAMERA.width), bool) if found is None else found > 0


def test_what_comes_moves_until_it_has_rested() -> None:
    motion = Motion(1.4e-3)
    for index in range(20):
        assert not marks(motion, [FLOOR, TABLE], STANDING, index).any()
    truth = cast([FLOOR, TABLE, thing(0.0)], STANDING)[1] == 2
    early, late = 20 + int(30 * (REST_S - 0.1)), 20 + int(30 * (REST_S + 0.3))
    for index in range(20, early):
        found = marks(motion, [FLOOR, TABLE, thing(0.0)], STANDING, index)
        assert (found & truth).sum() > 0.7 * truth.sum()
        assert (found & ~truth).sum() < 0.1 * truth.sum()
    for index in range(early, late):
        found = marks(motion, [FLOOR, TABLE, thing(0.0)], STANDING, index)
    assert not found.any()


def test_what_was_hidden_behind_a_thing_that_leaves_does_not_move() -> None:
    motion = Motion(1.4e-3)
    for index in range(40):
        found = marks(motion, [FLOOR, TABLE, *([thing(0.1)] if index < 20 else [])], STANDING, index)
        assert not found.any()


def test_nothing_moves_round_a_table_and_where_poses_are_a_little_off() -> None:
    motion, rng = Motion(1.4e-3), np.random.default_rng(0)
    for index in range(90):
        angle = 0.02 * index
        T = look_at((1.1 * np.sin(angle), -1.1 * np.cos(angle), 0.8), (0.0, 0.0, 0.0))
        frame = frame_of([FLOOR, TABLE, thing(-0.2), thing(0.2)], T, index)
        shown = T.copy()
        shown[:3, 3] += rng.normal(0.0, 0.003, 3)
        assert motion.find(thin(frame, CAMERA, 320, index), shown, index / 30) is None


SHIFTS = {
    "jump": lambda k: se3.exp([0.02, 0.25 * (k >= 30), 0.01, 0.0, 0.0, 0.03 * (k >= 30)]),
    "drift": lambda k: se3.exp([0.001 * k, 0.002 * k, 0.0, 0.0, 0.0, 0.0005 * k]),
}


@pytest.mark.parametrize("name", SHIFTS)
def test_poses_that_are_off_move_no_things_and_hide_none_that_move(name: str) -> None:
    motion, things = Motion(1.4e-3), [FLOOR, TABLE, thing(-0.3), thing(0.3)]
    most = 0
    for index in range(70):
        angle = 0.01 * index
        T = look_at((1.1 * np.sin(angle), -1.1 * np.cos(angle), 0.8), (0.0, 0.0, 0.0))
        hand = upright((-0.8 + 0.02 * (index - 40), -0.2), (0.1, 0.1, 0.1), z=0.15)
        boxes = [*things, hand] if index >= 40 else things
        shown = SHIFTS[name](index) @ T
        found = motion.find(thin(frame_of(boxes, T, index), CAMERA, 320, index), shown, index / 30)
        truth = cast(boxes, T)[1] == 4
        if found is not None:
            assert (found.astype(bool) & ~truth).sum() < 400
            most = max(most, (found.astype(bool) & truth).sum() / max(1, truth.sum()))
    assert most > 0.7


def test_a_camera_that_moves_under_a_pose_that_stands_sees_no_things_move() -> None:
    motion = Motion(1.4e-3)
    for index in range(60):
        T = look_at((0.01 * index, -1.1, 0.8), (0.01 * index, 0.0, 0.0))
        frame = frame_of([FLOOR, TABLE, thing(-0.1), thing(0.2)], T, index)
        assert motion.find(thin(frame, CAMERA, 320, index), STANDING, index / 30) is None


def test_after_a_correction_of_poses_nothing_is_held_against_earlier_frames() -> None:
    motion = Motion(1.4e-3)
    for index in range(20):
        marks(motion, [FLOOR, TABLE], STANDING, index)
    motion.forget()
    assert not marks(motion, [FLOOR, TABLE, thing(0.0)], STANDING, 20).any()
