"""Which way is up: told by what a camera sees of level surfaces, however it is held."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cuboid.config import TrackerConfig
from cuboid.frame import Float64Array, Intrinsics, unit
from cuboid.geometry.box import Box
from cuboid.readers import open_recording
from cuboid.surfaces.cells import find_voting_cells
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
        cells = find_voting_cells(depth, CAMERA, T, c.depth_noise_per_m, c.max_depth_m)
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


@pytest.mark.parametrize("roll", [0.0, 90.0, -90.0])
def test_a_camera_in_portrait_that_walks_round_a_far_table_finds_up(roll: float) -> None:
    """All that it sees faces up on average, with a board that stands behind."""
    wall = upright((0, 0.6), (0.8, 0.05, 0.6))
    poses = [rolled(T, roll) for T in around_a_table(8, 1.5, 1.1)]
    for count in (3, 8):
        up, found = vote([TABLE, wall], poses[:count])
        assert degrees_off(found) < 1.0
        assert degrees_off(up.image_up) < 50.0


@pytest.mark.parametrize("turns", [0, 1, 3])
def test_a_real_desk_is_level_however_the_camera_was_rolled(data_dir: Path, turns: int) -> None:
    """TUM fr1/xyz, in whose world z is up: a desk with monitors, keyboards and books, seen from 1 m."""
    recording = open_recording(data_dir / "rgbd_dataset_freiburg1_xyz")
    frames = (recording.read(k) for k in range(10, 60, 10))
    quarter, up, found = turned(turns), UpVote(), None
    for frame in frames:
        assert frame.T_world_camera is not None
        depth = np.ascontiguousarray(np.rot90(frame.depth_m, -turns)[::2, ::2])
        K = recording.intrinsics
        width, height = (K.width, K.height) if turns % 2 == 0 else (K.height, K.width)
        camera = Intrinsics(K.fx / 2, K.fx / 2, width / 4, height / 4, width // 2, height // 2)
        T = frame.T_world_camera.copy()
        T[:3, :3] = T[:3, :3] @ quarter
        found = up.update(find_voting_cells(depth, camera, T, CONFIG.depth_noise_per_m, CONFIG.max_depth_m), T)
    assert degrees_off(found) < 5.0


def turned(turns: int) -> Float64Array:
    """R_camera_turned of a camera whose picture is turned clockwise by so many quarters."""
    return np.asarray(np.linalg.matrix_power(np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]), turns), dtype=np.float64)


def test_what_was_measured_as_up_needs_no_surface_and_outweighs_any() -> None:
    T = look_at((0.0, 0.0, 1.0), (0.0, 2.0, 1.0))
    depth = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    nothing = find_voting_cells(depth, CAMERA, T, CONFIG.depth_noise_per_m, CONFIG.max_depth_m)
    assert degrees_off(UpVote().update(nothing, T, T[:3, :3].T @ UP)) < 0.1
    # On a slanted board that looks level, and is not.
    slanted = unit([0, -0.5, 0.87])
    up, found = vote([TABLE], around_a_table(4))
    assert degrees_off(found) < 1.0
    T = around_a_table(1)[0]
    assert degrees_off(up.update(nothing, T, T[:3, :3].T @ slanted), slanted) < 0.1
    assert up.changed


def test_a_level_surface_says_more_exactly_what_an_accelerometer_measured() -> None:
    tilted = unit([0.06, -0.05, 1.0])
    up = UpVote()
    for T in around_a_table(4):
        depth, _ = cast([TABLE], T)
        cells = find_voting_cells(depth, CAMERA, T, CONFIG.depth_noise_per_m, CONFIG.max_depth_m)
        found = up.update(cells, T, T[:3, :3].T @ tilted)
    assert degrees_off(found) < 0.5


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
