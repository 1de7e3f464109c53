"""The box of an object of the map."""

from __future__ import annotations

import numpy as np
import pytest
from made_maps import grid, map_of, shell

from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou
from cuboid.method.boxes.hidden import with_hidden_foot
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.boxing import Boxing

UP = np.array([0.0, 0.0, 1.0])
GROUND = (UP, 0.0)
THING = 1
X, Y, Z = (-0.15, 0.15), (-0.06, 0.06), (0.0, 0.2)
TRUE = Box(np.array([0.0, 0.0, 0.1]), np.array([0.3, 0.12, 0.2]), np.eye(3))


def floor(hidden: np.ndarray | None = None) -> np.ndarray:
    """What is seen of a floor: not what lies under the thing, nor in its shadow."""
    points = grid((-0.6, 0.6), (-0.6, 0.6), (-0.01, 0.0))
    under = (np.abs(points[:, 0]) < 0.15) & (np.abs(points[:, 1]) < 0.06)
    return points[~under if hidden is None else ~under & ~hidden]


def fitted(voxels: VoxelMap, plane: tuple[np.ndarray, float] | None, others: list[Box] | None = None) -> Box:
    rows = voxels.stored.rows_of(THING)
    box = Boxing(voxels).fit(rows, voxels.stored.xyz(rows), plane, UP, others or [])[0]
    return box if plane is None else with_hidden_foot(box, *plane, others or [], voxels, 1.0)


def test_what_was_seen_all_round_has_its_own_box() -> None:
    voxels = map_of((floor(), 0), (shell(X, Y, Z), THING))
    assert iou(fitted(voxels, GROUND), TRUE) > 0.85
    assert iou(fitted(voxels, None), TRUE) > 0.8


def test_a_few_strays_change_nothing() -> None:
    thing = shell(X, Y, Z)
    strays = np.array([[0.3, 0.3, 0.3], [-0.4, 0.1, 0.2], [0.1, -0.4, 0.35]]) + 0.005
    clean, spoilt = map_of((floor(), 0), (thing, THING)), map_of((floor(), 0), (thing, THING), (strays, THING))
    assert iou(fitted(clean, GROUND), fitted(spoilt, GROUND)) > 0.9


def test_a_foot_that_no_frame_has_seen_reaches_down_to_the_plane() -> None:
    points = grid((-0.6, 0.6), (-0.6, 0.6), (-0.01, 0.0))
    upper = shell(X, Y, (0.1, 0.2))
    hidden = map_of((floor(), 0), (upper, THING))
    assert iou(fitted(hidden, GROUND), TRUE) > 0.8
    floats = map_of((points, 0), (upper, THING))  # the ground beneath it was seen
    assert fitted(floats, GROUND).size[2] < 0.12


def test_the_dwelt_on_side_is_not_all_of_it() -> None:
    thing = shell(X, Y, Z)
    voxels = map_of((floor(), 0), (thing, THING))
    once = fitted(voxels, GROUND)
    rows = voxels.stored.rows_of(THING)
    near = rows[voxels.stored.xyz(rows)[:, 1] < -0.05]
    voxels.stored.hits[near] *= 300
    voxels.stored.points.weight[near] *= 300
    np.testing.assert_allclose(fitted(voxels, GROUND).size, once.size, atol=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_a_can_far_away_has_the_box_of_a_can_not_that_of_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    across, height = rng.uniform(-0.06, 0.06, 4000), rng.uniform(0.0, 0.12, 4000)
    near = -np.sqrt(0.06**2 - across**2) + rng.normal(0.0, 0.013, 4000)
    voxels = map_of((floor(), 0), (np.column_stack([across, near, height]), THING), far_m=4.0)
    can = Box(np.array([0.0, 0.0, 0.06]), np.array([0.12, 0.12, 0.12]), np.eye(3))
    rows = voxels.stored.rows_of(THING)
    places = voxels.stored.xyz(rows)
    from_there = Boxing(voxels).fit(rows, places, GROUND, UP, [], np.array([0.0, -4.0, 0.06]))[0]
    assert iou(from_there, can) > max(0.75, iou(fitted(voxels, GROUND), can) + 0.2)


@pytest.mark.parametrize("shows", [True, False], ids=["ground shows", "ground hidden"])
def test_a_half_ring_is_a_whole_disc_only_where_no_frame_saw_the_ground(shows: bool) -> None:
    """A banana from above, and a can from its side: both show half a ring of 8 cm radius."""
    ring = grid((-0.09, 0.09), (-0.09, 0.005), (0.0, 0.04))
    ring = ring[np.abs(np.hypot(*ring[:, :2].T) - 0.075) < 0.008]
    ground = grid((-0.6, 0.6), (-0.6, 0.6), (-0.01, 0.0))
    beyond = (np.hypot(*ground[:, :2].T) < 0.1) & (ground[:, 1] > -0.06)
    box = fitted(map_of((ground if shows else ground[~beyond], 0), (ring, THING)), GROUND)
    assert box.size[0] == pytest.approx(0.16, abs=0.015)
    if shows:
        assert box.size[1] < 0.1
    else:
        assert box.size[1] == pytest.approx(0.16, abs=0.015)
