"""Walls among the points of a map."""

from __future__ import annotations

import numpy as np

from cuboid.ground.core.results import MapPoints
from cuboid.method.relations import find_walls

UP = np.array([0.0, 0.0, 1.0])


def points(*parts: np.ndarray) -> MapPoints:
    xyz = np.concatenate(parts).astype(np.float32)
    return MapPoints(
        xyz, np.zeros((len(xyz), 3), np.uint8), np.zeros(len(xyz), np.float32), np.zeros(len(xyz), np.int32)
    )


def upright(x: float, wide: float, high: float, turn: float = 0.0) -> np.ndarray:
    """Points with 5 mm of noise on an upright rectangle at x, turned about z."""
    rng = np.random.default_rng(3)
    y, z = (grid.ravel() for grid in np.meshgrid(np.arange(-wide / 2, wide / 2, 0.02), np.arange(0, high, 0.02)))
    c, s = np.cos(turn), np.sin(turn)
    return np.column_stack([np.full(len(y), x), y, z]) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + rng.normal(
        0, 0.005, (len(y), 3)
    )


def test_a_wall_is_found_where_it_is_and_looks_to_the_room() -> None:
    floor = np.column_stack([*np.random.default_rng(1).uniform(-2, 2, (2, 20000)), np.zeros(20000)])
    (wall,) = find_walls(points(floor, upright(2.0, 3.0, 1.5, turn=0.3)), UP)
    assert abs(float(wall.normal @ (-np.cos(0.3), -np.sin(0.3), 0.0))) > 0.9999
    assert wall.normal @ UP == 0.0
    assert wall.offset > 0, "the room is on its side"
    assert abs(wall.offset - 2.0) < 0.005
    assert np.allclose(wall.extent @ wall.normal + wall.offset, 0.0, atol=1e-9)


def test_sides_of_things_and_low_fronts_are_no_walls() -> None:
    assert find_walls(points(upright(1.0, 0.4, 0.3), upright(2.0, 2.0, 0.25)), UP) == ()


def test_points_of_objects_and_places_without_up_have_none() -> None:
    seen = points(upright(2.0, 3.0, 1.5))
    assert find_walls(seen, None) == ()
    labelled = MapPoints(seen.xyz, seen.rgb, seen.heat, np.ones(len(seen.xyz), np.int32))
    assert find_walls(labelled, UP) == ()
