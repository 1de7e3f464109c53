"""The side of an object that no frame has seen, and a foot that another object hides."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.fit import fit_box
from cuboid.method.boxes.hidden import as_deep_as_wide, hidden_foot_m, mirrored_points, with_hidden_foot
from cuboid.method.heatmap.voxel_map import VoxelMap
from made_scenes import CAMERA, cast, look_at, upright

UP = np.array([0.0, 0.0, 1.0])
TABLE = Box(np.array([0.0, 0.0, -0.05]), np.array([3.0, 3.0, 0.1]), np.eye(3))
HALF = np.array([0.15, 0.1, 0.1])


def seen_from(eyes: list[tuple[float, float, float]], things: list[Box]) -> VoxelMap:
    """The map of a table with things on it, after the frames that show it from these places."""
    config = TrackerConfig()
    voxels = VoxelMap(config.voxel_m, config.depth_noise_per_m, config.max_depth_m)
    for k in range(4 * len(eyes)):  # cold pixels take turns: four frames show them all
        T = look_at(eyes[k // 4], (0.0, 0.0, 0.0))
        depth, _ = cast([TABLE, *things], T)
        image = WorkingImage(depth, np.full((*depth.shape, 3), 128, np.uint8), CAMERA, 1, (0, 0))
        voxels.fuse(image, np.zeros(depth.shape, np.float32), T, k)
    return voxels


def dome(towards: float) -> np.ndarray:
    """What a viewer in the direction `towards` (radians) sees of an oval dome, 30 x 20 x 10 cm."""
    rng = np.random.default_rng(3)
    away = rng.normal(size=(1200, 3))
    away /= np.linalg.norm(away, axis=1)[:, None]
    away[:, 2] = np.abs(away[:, 2])
    faces = away @ np.array([np.cos(towards), np.sin(towards), 0.0]) + 0.5 * away[:, 2] > 0.0
    return HALF * away[faces]


def test_the_far_half_of_a_dome_is_added_where_nothing_was_seen_of_it() -> None:
    points = dome(-np.pi / 2)
    seen = fit_box(points, UP, 0.0, 0.0)
    voxels = seen_from([(0.0, -1.2, 0.5)], [upright((0.0, 0.0), (0.3, 0.2, 0.1))])
    more = mirrored_points(points, UP, 0.0, seen, [], voxels)
    whole = fit_box(np.concatenate([seen.corners(), more]), UP, 0.0, 0.0)
    assert seen.size[:2].min() < 0.16
    np.testing.assert_allclose(whole.size[:2], 2 * HALF[:2], atol=0.02)
    np.testing.assert_allclose(whole.center[:2], 0.0, atol=0.01)


def test_nothing_is_added_where_the_ground_was_seen_or_another_object_stands() -> None:
    points = dome(-np.pi / 2)
    seen = fit_box(points, UP, 0.0, 0.0)
    block = upright((0.0, -0.03), (0.3, 0.14, 0.1))
    walked_round = seen_from([(0.0, -1.2, 0.5), (0.0, 1.2, 0.5)], [block])
    assert len(mirrored_points(points, UP, 0.0, seen, [], walked_round)) == 0
    one_side = seen_from([(0.0, -1.2, 0.5)], [upright((0.0, 0.0), (0.3, 0.2, 0.1))])
    behind = upright((0.0, 0.1), (0.4, 0.16, 0.2))
    assert len(mirrored_points(points, UP, 0.0, seen, [behind], one_side)) == 0


def test_a_lone_handle_has_no_twin() -> None:
    rng = np.random.default_rng(5)
    turn = rng.uniform(0, 2 * np.pi, 900)
    mug = np.column_stack([0.04 * np.cos(turn), 0.04 * np.sin(turn), rng.uniform(0, 0.1, 900)])
    handle = np.column_stack(
        [rng.uniform(-0.005, 0.005, 50), rng.uniform(-0.07, -0.04, 50), rng.uniform(0.03, 0.07, 50)]
    )
    points = np.concatenate([mug, handle])
    voxels = seen_from([(0.0, -1.2, 0.5)], [upright((0.0, 0.0), (0.08, 0.08, 0.1))])
    assert len(mirrored_points(points, UP, 0.0, fit_box(points, UP, 0.0, 0.0), [], voxels)) == 0


def test_a_foot_behind_another_object_is_hidden_until_it_is_seen() -> None:
    screen = upright((0.0, -0.12), (0.3, 0.05, 0.1))
    floating = upright((0.0, 0.0), (0.08, 0.08, 0.08), z=0.09)
    in_front = seen_from([(0.0, -1.2, 0.5)], [screen, upright((0.0, 0.0), (0.08, 0.08, 0.17))])
    assert hidden_foot_m(floating, UP, 0.0, [screen], in_front) == 0.0
    walked_round = seen_from([(0.0, -1.2, 0.5), (0.0, 1.2, 0.5)], [screen, floating])
    assert hidden_foot_m(floating, UP, 0.0, [screen], walked_round) is None


ABOVE = [(0.0, 1e-3, 1.0)]


def test_a_thing_of_which_only_the_top_is_seen_reaches_down_to_the_table() -> None:
    whole = upright((0.0, 0.0), (0.14, 0.08, 0.26))
    slab = upright((0.0, 0.0), (0.14, 0.08, 0.003), z=0.257)
    box = with_hidden_foot(slab, UP, 0.0, [], seen_from(ABOVE, [whole]), 1.0)
    np.testing.assert_allclose(box.center, whole.center, atol=1e-9)
    np.testing.assert_allclose(box.size, whole.size, atol=1e-9)


def test_no_foot_is_assumed_that_would_make_a_thing_too_large() -> None:
    """A mug on an espresso machine, with the floor far beneath that no frame has seen."""
    mug = upright((0.0, 0.0), (0.1, 0.08, 0.1), z=1.6)
    nothing = VoxelMap(0.01, 1.425e-3, 3.5)
    assert hidden_foot_m(mug, UP, 0.0, [], nothing) == 0.0
    assert with_hidden_foot(mug, UP, 0.0, [], nothing, 1.0) is mug
    assert with_hidden_foot(mug, UP, 0.0, [], nothing, 2.0).size[2] == pytest.approx(1.7)


def test_a_foot_may_be_narrower_than_its_object_if_it_stands_beneath_the_middle() -> None:
    leaves = upright((0.0, 0.0), (0.2, 0.2, 0.06), z=0.14)
    # A ray past the lowest edge at 0.1 m reaches the table 0.033 m further in: within 0.067 m nothing is seen.
    high = [(0.0, -0.35, 1.2), (0.0, 0.35, 1.2), (0.35, 0.0, 1.2), (-0.35, 0.0, 1.2)]
    assert hidden_foot_m(leaves, UP, 0.0, [], seen_from(high, [leaves])) == 0.0
    low = [(0.0, -1.2, 0.25), (0.0, 1.2, 0.25)]
    assert hidden_foot_m(leaves, UP, 0.0, [], seen_from(low, [leaves])) is None


def test_a_thing_above_another_one_stands_on_it_and_one_beside_it_does_not() -> None:
    lower, upper = upright((0.0, 0.0), (0.2, 0.2, 0.1)), upright((0.0, 0.0), (0.08, 0.08, 0.15), z=0.1)
    voxels = seen_from(ABOVE, [lower, upper])
    top = upright((0.0, 0.0), (0.08, 0.08, 0.01), z=0.24)
    assert hidden_foot_m(top, UP, 0.0, [lower], voxels) == pytest.approx(0.1)
    assert with_hidden_foot(top, UP, 0.0, [lower], voxels, 1.0).size[2] == pytest.approx(0.15)
    # The neighbour that reaches beyond the foot from below may hold it, as a teapot its spout; one above is no support.
    beside = upright((0.03, 0.0), (0.1, 0.1, 0.3))
    assert hidden_foot_m(top, UP, 0.0, [beside], voxels) is None
    assert hidden_foot_m(top, UP, 0.0, [upright((0.0, 0.0), (0.05, 0.05, 0.05), z=0.25)], voxels) == 0.0


def test_a_place_is_seen_when_enough_of_the_voxels_around_it_are() -> None:
    voxels = seen_from([(0.0, -1.2, 0.5)], [upright((0.0, 0.0), (0.3, 0.2, 0.1))])
    rng = np.random.default_rng(5)
    ground = np.column_stack([rng.uniform(-0.6, 0.6, (300, 2)), np.zeros(300)])
    steps = np.array([-1.0, 0.0, 1.0]) * voxels.voxel_m
    around = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    held = (voxels.rows_at((ground[:, None] + around).reshape(-1, 3)) >= 0).reshape(-1, 9, 3).any(2).sum(1)
    for least in (1, 2, 9):
        np.testing.assert_array_equal(voxels.is_occupied_around(ground, np.eye(3), least), held >= least)
    assert 0 < (held >= 2).sum() < len(held)


FRONT = Box(np.array([0.0, 0.02, 0.06]), np.array([0.2, 0.04, 0.12]), np.eye(3))


def test_what_is_seen_from_the_front_alone_is_as_deep_as_it_is_wide() -> None:
    whole = as_deep_as_wide(FRONT, np.array([0.0, -3.3, 0.3]), [], 0.02)
    np.testing.assert_allclose(whole.center, [0.0, 0.1, 0.06], atol=1e-12)
    np.testing.assert_allclose(whole.size, [0.2, 0.2, 0.12])
    behind = as_deep_as_wide(FRONT, np.array([0.0, 3.3, 0.3]), [], 0.02)
    np.testing.assert_allclose(behind.center, [0.0, -0.06, 0.06], atol=1e-12)


@pytest.mark.parametrize("eye", [(0.0, -2.0, 1.5), (1.5, -2.5, 0.3), (-3.0, 0.0, 0.06), (0.0, 0.02, 0.06)])
def test_no_depth_is_added_that_the_camera_would_have_seen_or_that_is_known(eye: tuple[float, float, float]) -> None:
    assert as_deep_as_wide(FRONT, np.array(eye), [], 0.02) is FRONT


def test_no_depth_is_added_where_another_object_is() -> None:
    neighbour = Box(np.array([0.0, 0.12, 0.05]), np.array([0.1, 0.1, 0.1]), np.eye(3))
    eye = np.array([0.0, -3.3, 0.3])
    assert as_deep_as_wide(FRONT, eye, [neighbour], 0.02) is FRONT
    assert as_deep_as_wide(FRONT, eye, [], 0.02) is not FRONT
