"""A chair is its back and its seat, down to the floor."""

from __future__ import annotations

import numpy as np
import pytest
from made_planes import level

from cuboid.ground.arrays import Float64Array
from cuboid.method.surfaces.plane import Plane
from cuboid.method.surfaces.seats import seat_of, supporting_plane

MIN_M2 = 0.08
FLOOR = level(0, 0.0, (-2.0, -2.0, 2.0, 2.0))
SEAT = level(1, 0.45, (0.0, 0.0, 0.5, 0.5))


def upright(x: float, y0: float, y1: float, low: float, high: float) -> Float64Array:
    """Points of a slab at x, 6 cm thick."""
    along = np.linspace(0.0, 1.0, 15)
    y, z = (m.ravel() for m in np.meshgrid(y0 + (y1 - y0) * along, low + (high - low) * along))
    return np.concatenate([np.column_stack([np.full(len(y), x + d), y, z]) for d in (0.0, 0.06)])


BACK = upright(0.53, 0.0, 0.5, 0.45, 0.85)


def seat(points: Float64Array, *planes: Plane) -> Float64Array:
    return seat_of(points, FLOOR, [FLOOR, *planes], MIN_M2)


def test_the_seat_of_a_chair_is_a_part_of_it() -> None:
    places = seat(BACK, SEAT)
    np.testing.assert_allclose(places[:, 2], 0.45)
    np.testing.assert_allclose([places[:, :2].min(0), places[:, :2].max(0)], [[0.025] * 2, [0.475] * 2], atol=0.051)


def test_a_sofa_as_high_as_the_seat_is_no_part_of_the_chair() -> None:
    both = level(1, 0.45, (0.0, 0.0, 0.5, 0.5), (-1.5, 0.0, -0.3, 1.5))
    assert seat(BACK, both)[:, 0].min() > -0.1


@pytest.mark.parametrize(
    "beside",
    [
        level(1, 0.45, (-1.0, 0.0, 0.5, 0.5)),  # a table, which holds what stands at its edge
        level(1, 0.45, (-0.5, 0.0, 0.2, 0.5)),  # not touched
        level(1, 0.45, (0.3, 0.1, 0.5, 0.3)),  # a sliver
        level(1, 0.04, (0.0, 0.0, 0.5, 0.5)),  # a mat
        level(1, 1.2, (0.0, 0.0, 0.5, 0.5)),  # above it all
    ],
)
def test_what_is_no_seat(beside: Plane) -> None:
    assert not len(seat(BACK, beside))


def test_the_floor_carries_the_back_of_a_chair_that_was_seen_above_its_seat() -> None:
    assert supporting_plane(BACK, SEAT, lambda: [FLOOR, SEAT], MIN_M2) is FLOOR


def test_a_seat_carries_what_lies_on_it() -> None:
    bag = upright(0.2, 0.1, 0.4, 0.45, 0.7)
    assert supporting_plane(bag, SEAT, lambda: [FLOOR, SEAT], MIN_M2) is SEAT


def test_a_table_carries_what_stands_at_its_edge_where_little_of_it_was_seen() -> None:
    table = level(1, 0.75, (-1.0, 0.0, 0.5, 0.5))
    assert supporting_plane(upright(0.56, 0.1, 0.4, 0.75, 1.0), table, lambda: [FLOOR, table], MIN_M2) is table


def test_a_cup_is_not_carried_by_a_floor_far_below() -> None:
    cup = upright(0.55, 0.1, 0.5, 0.45, 0.55)
    assert supporting_plane(cup, SEAT, lambda: [level(0, -0.6, (-2.0, -2.0, 2.0, 2.0)), SEAT], MIN_M2) is SEAT
