"""Where planes begin: what lies far apart at one height is two."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.method.surfaces.plane_rules import connected_groups, largest_level

CELL_M2 = 0.04**2


def level(x: float, y: float, z: float, wide_m: float) -> np.ndarray:
    across = np.arange(0.0, wide_m, 0.04)
    grid = np.stack(np.meshgrid(x + across, y + across), -1).reshape(-1, 2)
    return np.column_stack([grid, np.full(len(grid), z)])


def of(*parts: np.ndarray) -> list[set[int]]:
    ends = np.cumsum([len(part) for part in parts])
    return [set(range(end - len(part), end)) for end, part in zip(ends, parts, strict=True)]


def test_a_book_on_a_table_does_not_begin_with_a_board_across_the_room_at_its_height() -> None:
    book, board = level(0.0, 0.0, 0.75, 0.2), level(2.5, 1.0, 0.76, 0.6)
    centers = np.concatenate([book, board])
    found = largest_level(centers, np.full(len(centers), CELL_M2), np.arange(len(centers)), 1.0)
    assert set(found.tolist()) == of(book, board)[1]


def test_a_table_that_things_hide_in_part_begins_as_one() -> None:
    left, right, floor = level(0.0, 0.0, 0.7, 0.3), level(1.0, 0.0, 0.71, 0.3), level(0.0, 0.0, 0.0, 0.35)
    centers = np.concatenate([left, right, floor])
    found = largest_level(centers, np.full(len(centers), CELL_M2), np.arange(len(centers)), 1.0)
    one, other, _ = of(left, right, floor)
    assert set(found.tolist()) == one | other


def test_cells_that_belong_to_a_plane_begin_no_other() -> None:
    large, small = level(0.0, 0.0, 0.7, 0.6), level(0.0, 0.0, 0.4, 0.3)
    centers = np.concatenate([large, small])
    _, free = of(large, small)
    found = largest_level(centers, np.full(len(centers), CELL_M2), np.array(sorted(free)), 1.0)
    assert set(found.tolist()) == free


@pytest.mark.parametrize("shift", [-300.0, 0.0, 1e5])
def test_steps_no_wider_than_a_gap_lead_from_one_end_to_the_other_wherever_that_is(shift: float) -> None:
    chain = np.column_stack([shift + np.arange(8) * 0.9, np.full(8, shift)])
    assert len(np.unique(connected_groups(chain, 1.0))) == 1
    assert len(np.unique(connected_groups(chain, 0.5))) == 8


def test_what_is_wider_than_a_ground_plan_is_one_group() -> None:
    assert len(np.unique(connected_groups(np.array([[0.0, 0.0], [500.0, 0.0]]), 1.0))) == 1
