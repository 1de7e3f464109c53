"""Which way is up: the direction of the flat areas that things stand on, whichever way the camera is held."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.depth import DepthImage
from cuboid.ground.core.frame import unit
from cuboid.ground.geometry.box import Box
from cuboid.inputs.readers import open_recording
from cuboid.method.surfaces.standing import find_flat_areas
from cuboid.method.surfaces.up import UpVote
from cuboid.runs.tracking.rolling import Roll
from made_scenes import CAMERA, cast, look_at, upright

TABLE = upright((0, 0), (1.4, 1.0, 0.05), z=-0.05)
THINGS = [
    upright((-0.3, 0.0), (0.2, 0.12, 0.1), 0.4),
    upright((0.2, 0.1), (0.1, 0.1, 0.15)),
    upright((0.3, -0.2), (0.15, 0.1, 0.06)),
]
WALL = upright((0, 0.6), (6, 0.1, 4), z=-2.0)
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


def vote(
    scene: Sequence[Box], poses: Sequence[Float64Array], up: UpVote | None = None, measured: Float64Array | None = None
) -> tuple[UpVote, Float64Array | None]:
    rng, up = np.random.default_rng(0), up or UpVote()
    found = None
    for T in poses:
        depth, _ = cast(scene, T)
        depth = np.where(depth > 0, depth + rng.normal(size=depth.shape) * 1e-3 * depth**2, 0).astype(np.float32)
        up_camera = None if measured is None else T[:3, :3].T @ measured
        found = up.update(find_flat_areas(DepthImage(depth, CAMERA), CONFIG), T, up_camera)
    return up, found


def degrees_off(found: Float64Array | None, up: Float64Array = UP) -> float:
    assert found is not None
    return float(np.degrees(np.arccos(np.clip(found @ up, -1, 1))))


@pytest.mark.parametrize("roll", [0.0, 90.0, 180.0, 270.0, 37.0])
def test_the_table_that_things_stand_on_is_level_however_the_camera_is_turned(roll: float) -> None:
    _, up = vote([TABLE, WALL, *THINGS], [rolled(T, roll) for T in around_a_table(3)])
    assert degrees_off(up) < 2.0


def test_a_table_with_things_is_level_in_any_world() -> None:
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    A = np.eye(4)
    A[:3, :3] = turn * np.linalg.det(turn)
    depth, _ = cast([TABLE, *THINGS], (T := around_a_table(1)[0]))
    found = UpVote().update(find_flat_areas(DepthImage(depth.astype(np.float32), CAMERA), CONFIG), A @ T)
    assert degrees_off(found, A[:3, :3] @ UP) < 2.0


def test_a_camera_that_looks_down_from_nearly_above_finds_up() -> None:
    _, up = vote([TABLE, *THINGS], [look_at((0.02 * k, -0.4, 0.9), (0.02 * k, 0.0, 0.0)) for k in range(4)])
    assert degrees_off(up) < 2.0


def test_an_empty_table_is_level_while_nothing_stands_anywhere() -> None:
    assert degrees_off(vote([TABLE, WALL], around_a_table(3))[1]) < 2.0


@pytest.mark.parametrize("scene", [[WALL], []], ids=["wall", "nothing"])
def test_where_nothing_stands_up_is_not_known(scene: list[Box]) -> None:
    assert vote(scene, around_a_table(6))[1] is None


def test_ripples_of_a_wall_are_no_things() -> None:
    T = look_at((0.0, -1.0, 1.0), (0.0, 0.6, 1.0))
    depth, _ = cast([WALL], T)
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]]
    rippled = depth + 0.02 * np.sin(u / 12.0) * np.sin(v / 10.0)
    found = find_flat_areas(DepthImage(rippled.astype(np.float32), CAMERA), CONFIG)
    assert found.evidence.sum() < 0.01


def test_shelves_on_a_wall_seen_first_give_way_to_a_table_with_more_on_it() -> None:
    """What stands off a wall makes it up at first; more that stands on a table changes that, and says so."""
    wall = upright((0, 0.8), (6, 0.1, 4), z=-2.0)
    fixed = [Box(np.array([x, 0.7, 0.7]), np.array([0.15, 0.12, 0.1]), np.eye(3)) for x in (-0.3, 0.1)]
    up, first = vote([wall, *fixed], [look_at((0.1 * k, -0.4, 1.2), (0.0, 0.75, 0.7)) for k in range(3)])
    assert first is not None
    assert degrees_off(first, np.array([0.0, -1.0, 0.0])) < 3.0
    changes = 0
    for T in around_a_table(30):
        _, found = vote([TABLE, *THINGS], [T], up)
        changes += up.changed
    assert degrees_off(found) < 2.0
    assert changes == 1


def test_what_was_measured_as_up_needs_no_surface_and_outweighs_any() -> None:
    tilted = unit([0, -0.5, 0.87])
    assert degrees_off(vote([], around_a_table(1), measured=UP)[1]) < 0.1
    assert degrees_off(vote([TABLE, *THINGS], around_a_table(4), measured=tilted)[1], tilted) < 0.1


def test_a_level_surface_says_more_exactly_what_an_accelerometer_measured() -> None:
    tilted = unit([0.06, -0.05, 1.0])
    assert degrees_off(vote([TABLE], around_a_table(4), measured=tilted)[1]) < 1.0


def test_the_images_up_stands_in_while_nothing_tells() -> None:
    np.testing.assert_allclose(UpVote().image_up, UP)
    T = look_at((0.0, 0.0, 1.0), (0.0, 2.0, 1.0))
    up, found = vote([], [T, rolled(T, 20), rolled(T, -20)])
    assert found is None
    assert degrees_off(up.image_up) < 0.1


def test_votes_are_asked_for_each_frame_until_up_is_sure_and_then_now_and_then() -> None:
    up, _ = vote([], around_a_table(1))
    assert all(up.is_due(1.0) for _ in range(10))
    up, _ = vote([TABLE, *THINGS], around_a_table(10))
    asked = 0
    for T in around_a_table(30):
        if up.is_due(1.0):
            vote([TABLE, *THINGS], [T], up)
            asked += 1
    assert 0 < asked < 15


def test_a_wall_does_not_become_up_because_more_frames_show_it() -> None:
    """What stands off a wall is seen for three seconds at 30 Hz, from one viewpoint: 90 frames of the weight 0.1."""
    wall = upright((0, 0.8), (6, 0.1, 4), z=-2.0)
    fixed = [Box(np.array([x, 0.7, 0.7]), np.array([0.15, 0.12, 0.1]), np.eye(3)) for x in (-0.3, 0.1)]
    up, found = vote([TABLE, *THINGS], around_a_table(10))
    votes = 0
    for _ in range(90):
        if up.is_due(0.1):
            _, found = vote([wall, *fixed], [look_at((0.1, -0.4, 1.2), (0.0, 0.75, 0.7))], up)
            votes += 1
    assert votes > 0
    assert degrees_off(found) < 2.0


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_a_real_desk_is_level_however_the_camera_was_rolled(data_dir: Path, turns: int) -> None:
    """TUM fr1/xyz, in whose world z is up: a desk with monitors, keyboards and books, seen from 1 m."""
    recording = open_recording(data_dir / "rgbd_dataset_freiburg1_xyz")
    roll, up, found = Roll(recording.intrinsics, turns), UpVote(), None
    for k in range(10, 40, 10):
        frame = roll.frame(recording.read(k))
        assert frame.T_world_camera is not None
        found = up.update(find_flat_areas(DepthImage(frame.depth_m, roll.camera), CONFIG), frame.T_world_camera)
    assert degrees_off(found) < 5.0


@pytest.mark.parametrize(
    ("name", "up"),
    [("office-scan", UP), ("overhead-hands", unit([-0.18, 0.88, -0.45]))],
)
def test_real_places_whose_tables_no_upright_camera_sees_are_level(data_dir: Path, name: str, up: Float64Array) -> None:
    recording = open_recording(data_dir / name)
    vote, found = UpVote(), None
    for k in range(8):
        frame = recording.read(k)
        assert frame.T_world_camera is not None
        found = vote.update(
            find_flat_areas(DepthImage(frame.depth_m, recording.intrinsics), CONFIG), frame.T_world_camera
        )
    assert degrees_off(found, up) < 5.0
