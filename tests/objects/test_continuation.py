"""What goes on beyond its box into surface that is no object's is structure."""

from __future__ import annotations

import numpy as np
from made_maps import box_of, grid, map_of, shell

from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.continuation import continues

FLOOR = grid((-0.6, 0.6), (-0.6, 0.6), (-0.01, 0.0))
THING, OTHER = 3, 8
UP = np.array([0.0, 0.0, 1.0])


def structure(voxels: VoxelMap, *no_structure: int) -> bool:
    owned = np.zeros(10, np.uint8)
    owned[[THING, *no_structure]] = 1
    points = voxels.stored.xyz(voxels.stored.rows_of(THING))
    top, sides = continues(box_of(points.astype(np.float64)), points, voxels, owned)
    return top or sides > 1


def test_a_patch_of_a_wall_is_structure() -> None:
    wall = grid((-0.6, 0.6), (0.0, 0.01), (0.0, 1.2))
    patch = (np.abs(wall[:, 0]) < 0.15) & (np.abs(wall[:, 2] - 0.6) < 0.15)
    assert structure(map_of((wall[~patch], 0), (wall[patch], THING)))


def test_a_box_that_stands_free_on_a_floor_is_none() -> None:
    box = shell((-0.1, 0.1), (-0.08, 0.08), (0.0, 0.2))
    assert not structure(map_of((FLOOR, 0), (box, THING)))


def test_a_box_that_leans_on_one_wall_is_none() -> None:
    box, wall = shell((-0.1, 0.1), (-0.08, 0.08), (0.0, 0.2)), grid((0.11, 0.12), (-0.6, 0.6), (0.0, 1.0))
    voxels = map_of((FLOOR, 0), (wall, 0), (box, THING))
    assert not structure(voxels)


def test_the_leg_of_a_table_is_structure() -> None:
    leg, top = shell((-0.03, 0.03), (-0.03, 0.03), (0.0, 0.7)), grid((-0.4, 0.4), (-0.4, 0.4), (0.7, 0.73))
    voxels = map_of((FLOOR, 0), (leg, THING), (top, 0))
    owned = np.eye(10, dtype=np.uint8)[THING]
    points = voxels.stored.xyz(voxels.stored.rows_of(THING))
    assert continues(box_of(leg), points, voxels, owned) == (True, 0)
    assert structure(voxels)


def test_what_stands_beneath_a_board_with_air_between_is_none() -> None:
    box, board = shell((-0.1, 0.1), (-0.1, 0.1), (0.0, 0.3)), grid((-0.4, 0.4), (-0.4, 0.4), (0.36, 0.38))
    assert not structure(map_of((FLOOR, 0), (box, THING), (board, 0)))


def test_a_book_between_books_is_none() -> None:
    row = shell((-0.3, 0.3), (-0.1, 0.1), (0.0, 0.25))
    middle = np.abs(row[:, 0]) < 0.03
    voxels = map_of((FLOOR, 0), (row[middle], THING), (row[~middle], OTHER))
    assert not structure(voxels, OTHER)
    assert structure(voxels), "were they no objects, it would be a part of what they are"


def test_what_lies_flat_has_no_sides_to_go_on() -> None:
    mat = grid((-0.2, 0.2), (-0.2, 0.2), (0.0, 0.01))
    assert not structure(map_of((FLOOR, 0), (mat, THING)))


def test_what_was_seen_but_once_proves_nothing() -> None:
    leg, top = shell((-0.03, 0.03), (-0.03, 0.03), (0.0, 0.7)), grid((-0.4, 0.4), (-0.4, 0.4), (0.7, 0.73))
    assert not structure(map_of((FLOOR, 0), (leg, THING), (top, 0), hits=1))


def test_an_object_has_as_many_rows_as_are_asked_for_or_not() -> None:
    voxels = map_of((FLOOR, 0), (shell((-0.1, 0.1), (-0.08, 0.08), (0.0, 0.2)), THING))
    count = len(voxels.stored.rows_of(THING))
    assert count > 100
    numbers, min_rows = [THING, OTHER, THING, OTHER], [count, 0, count + 1, 1]
    assert voxels.stored.have_rows(numbers, min_rows) == [True, True, False, False]
    assert voxels.stored.have_rows([], []) == []
