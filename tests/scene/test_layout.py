"""A place is known again by its objects, from any side; another one is not."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from cuboid.method.objects.entry import MapObject
from cuboid.runs.scene.layout import find_layout, same_place

UP = np.array([0.6, 0.0, 0.8])


def room(seed: int, count: int = 9) -> list[MapObject]:
    """Objects on a table of a square metre, each of a size and a color of its own."""
    rng = np.random.default_rng(seed)
    level = np.stack([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0], UP], axis=1)
    things = []
    for label in range(1, count + 1):
        size = rng.uniform(0.05, 0.25, 3)
        box = Box(level @ [*rng.uniform(-0.6, 0.6, 2), size[2] / 2], size, level)
        points = (box.center + (rng.uniform(-0.5, 0.5, (200, 3)) * size) @ level.T).astype(np.float32)
        colors = np.tile(rng.integers(20, 235, 3), (200, 1)).astype(np.uint8)
        entry = MapObject(label, 0, 9, box, points=points)
        entry.label, entry.colors, entry.frames_seen = label, colors, 10
        things.append(entry)
    return things


def carried(things: list[MapObject], T: Float64Array) -> list[MapObject]:
    moved = []
    for item in things:
        box = Box(se3.transform(T, item.box.center), item.box.size, T[:3, :3] @ item.box.rotation)
        entry = MapObject(item.number, 0, 9, box, points=se3.transform(T, item.points).astype(np.float32))
        entry.label, entry.colors, entry.frames_seen = item.label, item.colors, item.frames_seen
        moved.append(entry)
    return moved


def test_a_place_is_known_again_though_things_were_moved() -> None:
    for seed in range(12):
        known, others = room(seed), room(1000 + seed)
        T = se3.exp([*(1.4 * UP), *(0.0, 0.0, 0.0)]) @ se3.exp([0.0, 0.0, 0.0, *(0.5 * seed * UP)])
        T[:3, 3] += [150.0, -80.0, 3.0]
        seen = carried([*known[2:], *others[:3]], T)
        found = find_layout(known, seen, UP)
        assert found is not None
        np.testing.assert_allclose(found @ T, np.eye(4), atol=2e-3)
        points = np.concatenate([item.points for item in known])
        there = np.concatenate([item.points for item in seen])
        assert same_place(points, there, found, se3.transform(T, np.zeros(3)))
        beside = found.copy()
        beside[:3, 3] += 0.3
        assert not same_place(points, there, beside, se3.transform(T, np.zeros(3)))


def test_another_place_is_not() -> None:
    for seed in range(60):
        assert find_layout(room(seed, 14), room(5000 + seed, 14), UP) is None
    assert find_layout(room(1)[:4], room(1)[:4], UP) is None, "four objects are not enough"
