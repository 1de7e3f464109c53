"""The table of objects against a search through all of them."""

from __future__ import annotations

import numpy as np

from cuboid.geometry.box import Box
from cuboid.objects.entry import MapObject
from cuboid.objects.index import ObjectIndex


def thing(number: int, center: np.ndarray, size: float, voxels: int = 10) -> MapObject:
    points = np.zeros((voxels, 3), np.float32)
    box = Box(center, np.full(3, size), np.eye(3))
    return MapObject(number, points, np.zeros((voxels, 3), np.uint8), box, None, 1.0, np.zeros(3), 0, 0)


def test_neighbours_are_those_of_a_search_through_all() -> None:
    rng = np.random.default_rng(1)
    things = [thing(k, rng.uniform(-2, 2, 3), float(rng.uniform(0.05, 0.5))) for k in range(1, 200)]
    index = ObjectIndex()
    for one in things:
        index.note(one)
    here = things[17].box
    apart = {o.number: float(np.linalg.norm(o.box.center - here.center)) for o in things}
    assert index.near(here.center, 0.9) == [n for n in apart if apart[n] <= 0.9]
    half = 0.5 * float(np.linalg.norm(here.size))
    touching = [o.number for o in things if apart[o.number] <= half + 0.5 * float(np.linalg.norm(o.box.size)) + 0.1]
    assert index.beside(here, 0.1) == touching
    low, high = (f(things[3].box.center, things[5].box.center) for f in (np.minimum, np.maximum))
    inside = [o.number for o in things if ((o.box.center >= low - 0.3) & (o.box.center <= high + 0.3)).all()]
    assert index.around([4, 6], 0.3) == inside
    assert len(inside) > 2


def test_what_is_gone_is_near_nothing_and_what_comes_back_is() -> None:
    index = ObjectIndex()
    one, two = thing(1, np.zeros(3), 0.1), thing(2, np.zeros(3), 0.1, voxels=50)
    index.note(one)
    index.note(two)
    assert index.near(np.zeros(3), 0.1) == [1, 2]
    assert index.large(3, 20).tolist() == [0, 0, 1]
    assert list(index.unlabelled) == [1, 2]
    one.label = two.label = 1
    two.retired = True
    index.note(one)
    index.note(two)
    assert index.near(np.zeros(3), 0.1) == index.around([1], 0.1) == [1]
    assert index.large(3, 20).tolist() == [0, 0, 0]
    assert (list(index.unlabelled), list(index.retired)) == ([], [2])
    two.retired = False
    index.note(two)
    index.drop(1)
    assert index.near(np.zeros(3), 0.1) == [2]
    assert index.around([1], 1.0) == []
