"""Furniture: what bears the supporting planes of a map."""

from __future__ import annotations

import numpy as np

from cuboid.ground.core.results import MapPoints, SupportPlane
from cuboid.method.relations.furniture import find_furniture

UP = np.array([0.0, 0.0, 1.0])
STEP_M = 0.02


def points(*parts: np.ndarray) -> MapPoints:
    xyz = np.concatenate(parts).astype(np.float32)
    return MapPoints(
        xyz, np.zeros((len(xyz), 3), np.uint8), np.zeros(len(xyz), np.float32), np.zeros(len(xyz), np.int32)
    )


def block(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> np.ndarray:
    """Points of a block of these extents, every 2 cm; one layer where an extent is nothing."""
    axes = [np.arange(low, high + STEP_M / 2, STEP_M) for low, high in (x, y, z)]
    return np.stack(np.meshgrid(*axes), -1).reshape(-1, 3)


def level(x: tuple[float, float], y: tuple[float, float], z: float) -> tuple[SupportPlane, np.ndarray]:
    """A supporting plane and the points of it that were seen."""
    outline = np.array([(x[0], y[0], z), (x[1], y[0], z), (x[1], y[1], z), (x[0], y[1], z)])
    return SupportPlane(UP, -z, outline), block(x, y, (z, z))


FLOOR, FLOOR_POINTS = level((-1.0, 3.0), (-1.0, 3.0), 0.0)


def table_at(x: float) -> tuple[SupportPlane, np.ndarray]:
    top, seen = level((x, x + 0.8), (0.0, 0.6), 0.7)
    legs = [block((x + a, x + a + 0.04), (b, b + 0.04), (0.02, 0.68)) for a in (0.0, 0.76) for b in (0.0, 0.56)]
    return top, np.concatenate([seen, *legs])


def test_a_table_is_a_box_from_its_feet_to_its_top_and_the_floor_is_none() -> None:
    top, seen = table_at(0.5)
    (table,) = find_furniture([FLOOR, top], points(FLOOR_POINTS, seen), UP)
    assert table.planes == (1,)
    assert np.allclose(np.sort(table.box.size), [0.6, 0.66, 0.8], atol=0.05)
    assert np.allclose(table.box.center, [0.9, 0.3, 0.37], atol=0.03)
    assert np.allclose(table.box.rotation[:, 2], UP, atol=1e-9)


def test_two_tables_are_two_whichever_way_the_world_lies() -> None:
    (first, one), (second, two) = table_at(0.0), table_at(1.5)
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turned = [SupportPlane(turn @ p.normal, p.offset, p.extent @ turn.T) for p in (first, FLOOR, second)]
    found = find_furniture(turned, points(*(part @ turn.T for part in (FLOOR_POINTS, one, two))), turn @ UP)
    assert [piece.planes for piece in found] == [(0,), (2,)]
    assert np.allclose(found[1].box.center, turn @ [1.9, 0.3, 0.37], atol=0.03)


def test_boards_between_the_same_sides_are_one_shelf() -> None:
    boards = [level((0.0, 0.8), (0.0, 0.3), z) for z in (0.3, 0.6, 0.9)]
    sides = [block((x, x), (0.0, 0.3), (0.02, 1.1)) for x in (-0.02, 0.82)]
    (shelf,) = find_furniture(
        [FLOOR, *(plane for plane, _ in boards)], points(FLOOR_POINTS, *(p for _, p in boards), *sides), UP
    )
    assert shelf.planes == (1, 2, 3)
    assert abs(shelf.box.size[2] - 0.9) < 0.05, "from the floor to its highest board"


def test_a_top_of_which_nothing_more_was_seen_is_no_furniture() -> None:
    top, seen = level((0.0, 0.8), (0.0, 0.6), 0.7)
    edge = block((0.0, 0.8), (0.0, 0.0), (0.64, 0.7))
    assert find_furniture([FLOOR, top], points(FLOOR_POINTS, seen, edge), UP) == ()


def test_things_beneath_a_table_are_no_part_of_it() -> None:
    top, seen = table_at(0.5)
    basket = block((0.8, 1.0), (0.2, 0.4), (0.02, 0.3))
    (with_it,) = find_furniture([FLOOR, top], points(FLOOR_POINTS, seen, basket), UP)
    (without,) = find_furniture([FLOOR, top], points(FLOOR_POINTS, seen), UP)
    assert np.allclose(with_it.box.size, without.box.size)


def test_places_without_up_and_without_planes_have_none() -> None:
    top, seen = table_at(0.5)
    assert find_furniture([FLOOR, top], points(FLOOR_POINTS, seen), None) == ()
    assert find_furniture([], points(FLOOR_POINTS, seen), UP) == ()
    labelled = points(FLOOR_POINTS, seen)
    owned = MapPoints(labelled.xyz, labelled.rgb, labelled.heat, np.ones(len(labelled.xyz), np.int32))
    assert find_furniture([FLOOR, top], owned, UP) == (), "points of objects are no furniture"
