"""Which way is up: told by what a camera sees of level surfaces, however it is held."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.config import TrackerConfig
from cuboid.frame import Float64Array
from cuboid.geometry.box import Box
from cuboid.surfaces.cells import VOTING_PIXELS, find_cells
from cuboid.surfaces.up import STILL_VOTES, UpVote
from made_scenes import CAMERA, cast, look_at, upright

TABLE = upright((0, 0), (1.4, 1.0, 0.05), z=-0.05)
WALL = upright((0, 2.0), (12, 0.1, 8), z=-4.0)
CONFIG = TrackerConfig()
UP = np.array([0.0, 0.0, 1.0])


def rolled(T: Float64Array, degrees: float) -> Float64Array:
    """The same camera, turned about its own axis of sight."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turned = T.copy()
    turned[:3, :3] = T[:3, :3] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    return turned


def around_a_table(count: int, radius: float = 0.8, height: float = 0.7) -> list[Float64Array]:
    angles = np.linspace(-0.5, 0.5, count) - np.pi / 2
    return [look_at((radius * np.cos(a), radius * np.sin(a), height), (0, 0, 0)) for a in angles]


def vote(scene: list[Box], poses: list[Float64Array], seed: int = 0) -> tuple[UpVote, Float64Array | None]:
    rng, up = np.random.default_rng(seed), UpVote()
    found = None
    for T in poses:
        depth, _ = cast(scene, T)
        depth = np.where(depth > 0, depth + rng.normal(size=depth.shape) * 1e-3 * depth**2, 0).astype(np.float32)
        c = CONFIG
        cells = find_cells(depth, CAMERA, T, c.depth_noise_per_m, c.max_depth_m, VOTING_PIXELS)
        found = up.update(cells, T)
    return up, found


def degrees_off(found: Float64Array | None, up: Float64Array = UP) -> float:
    assert found is not None
    return float(np.degrees(np.arccos(np.clip(found @ up, -1, 1))))


def test_a_level_table_seen_by_an_upright_camera_is_up_at_once() -> None:
    _, up = vote([TABLE], around_a_table(1))
    assert degrees_off(up) < 1.0


def test_up_is_that_of_the_table_and_not_of_the_wall_behind_it() -> None:
    _, up = vote([TABLE, upright((0, 0.6), (6, 0.05, 3), z=-1.0)], around_a_table(5))
    assert degrees_off(up) < 1.0


@pytest.mark.parametrize("roll", [90.0, -90.0, 180.0])
def test_a_camera_held_in_an_odd_way_over_a_table_near_by_finds_up_all_the_same(roll: float) -> None:
    _, up = vote([TABLE], [rolled(T, roll) for T in around_a_table(12)])
    assert degrees_off(up) < 1.0


def test_a_camera_that_looks_straight_down_from_near_finds_up() -> None:
    poses = [look_at((0.02 * k, 0.001, 0.8), (0.02 * k, 0.0, 0.0)) for k in range(6)]
    _, up = vote([TABLE], poses)
    assert degrees_off(up) < 1.0


def test_a_camera_fixed_above_a_far_floor_finds_up_when_it_has_not_moved_for_long() -> None:
    floor = upright((0, 0), (8, 8, 0.1), z=-0.1)
    T = look_at((0.0, 0.001, 2.4), (0.0, 0.0, 0.0))
    assert vote([floor], [T] * 3)[1] is None
    assert degrees_off(vote([floor], [T] * (STILL_VOTES + 1))[1]) < 1.0


def test_a_wall_alone_is_not_up() -> None:
    poses = [look_at((0.1 * k, 0.0, 1.0), (0.1 * k, 2.0, 1.0)) for k in range(30)]
    assert vote([WALL], poses)[1] is None


def test_a_camera_that_pans_before_a_wall_turns_about_up() -> None:
    yaw = np.radians(np.linspace(-60, 60, 40))
    poses = [look_at((0.0, 0.0, 1.0), (np.sin(a), np.cos(a), 1.0)) for a in yaw]
    assert degrees_off(vote([WALL], poses)[1]) < 3.0


def test_a_wall_seen_first_gives_way_to_the_table() -> None:
    """What is up at first for a wall within arm's reach changes when a table is seen."""
    near_wall = upright((0, 0.9), (6, 0.1, 4), z=-2.0)
    poses = [look_at((0.02 * k, 0.0, 0.6), (0.02 * k, 1.0, 0.6)) for k in range(8)]
    _, up = vote([near_wall], poses)
    _, found = vote([near_wall, TABLE], [*poses, *around_a_table(25, 0.9, 0.8)])
    assert degrees_off(found) < 2.0
    assert up is None or degrees_off(up) > 80


def test_the_images_up_stands_in_while_nothing_tells() -> None:
    up = UpVote()
    np.testing.assert_allclose(up.image_up, UP)
    T = look_at((0.0, 0.0, 1.0), (0.0, 2.0, 1.0))
    up, found = vote([], [T, rolled(T, 20), rolled(T, -20)])
    assert found is None
    assert degrees_off(up.image_up) < 0.1


def test_votes_are_asked_for_each_frame_until_up_is_known_and_then_now_and_then() -> None:
    up, _ = vote([], around_a_table(1))
    assert all(up.is_due() for _ in range(10))
    up, _ = vote([TABLE], around_a_table(1))
    due = [up.is_due() for _ in range(30)]
    assert 0 < sum(due) < 15
