"""Which level surfaces are the tops of things, and which hold things up."""

from __future__ import annotations

import pytest
from made_planes import level

from cuboid.method.surfaces.plane import Plane
from cuboid.method.surfaces.plane_rules import is_lid

LARGEST_M2 = 1.0


TABLE = level(0, 0.75, (0.0, 0.0, 2.0, 1.0))


def lid(plane: Plane, below: Plane = TABLE) -> bool:
    return is_lid(plane, LARGEST_M2, lambda: [below, plane])


def test_the_tops_of_several_books_are_no_support_though_together_they_are_large() -> None:
    books = level(1, 0.8, *((x, y, x + 0.3, y + 0.25) for x in (0.1, 0.6, 1.1) for y in (0.1, 0.6)))
    assert books.plan.area_m2() > 0.4
    assert lid(books)


@pytest.mark.parametrize(("z", "on_top"), [(0.76, False), (0.8, True), (1.0, True), (1.2, False)])
def test_the_top_of_a_box_is_above_its_plane_but_not_high_above_it(z: float, on_top: bool) -> None:
    assert lid(level(1, z, (0.5, 0.3, 0.9, 0.6))) == on_top


def test_a_board_beside_a_table_holds_things_up() -> None:
    assert not lid(level(1, 0.9, (1.8, 0.0, 2.4, 0.5)))


def test_what_is_most_of_a_table_is_a_table_too() -> None:
    assert not lid(level(1, 0.8, (0.1, 0.1, 1.3, 0.9)), level(0, 0.75, (0.0, 0.0, 1.4, 1.0)))


def test_no_object_has_a_top_larger_than_an_object() -> None:
    floor = level(0, 0.0, (0.0, 0.0, 4.0, 4.0))
    assert lid(level(1, 0.25, (1.0, 1.0, 1.9, 2.0)), floor)
    assert not lid(level(1, 0.25, (1.0, 1.0, 2.2, 2.0)), floor)
