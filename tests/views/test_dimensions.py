"""Numbers of dimensions: beside their lines, and on no tag and no other number while there is room."""

from __future__ import annotations

import numpy as np

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.results.views.dimensions import place_number
from cuboid.results.views.drawing import draw_boxes
from cuboid.results.views.replay import ReplayedObject

AT, DOWN, FREE = np.array([50.0, 50.0]), np.array([0.0, 1.0]), (100, 200)


def test_a_number_is_moved_until_it_covers_nothing() -> None:
    assert place_number((20, 10), AT, DOWN, [], FREE) == (40, 45, 60, 55)
    taken = [(30, 40, 70, 50), (45, 58, 55, 62)]
    assert place_number((20, 10), AT, DOWN, taken, FREE) == (40, 65, 60, 75)


def test_a_number_without_room_covers_the_fewest() -> None:
    taken = [(0, 0, 100, 200), (0, 0, 100, 60)]
    assert place_number((20, 10), AT, DOWN, taken, FREE) == (40, 65, 60, 75)


def test_a_number_stays_in_the_picture() -> None:
    assert place_number((20, 10), np.array([95.0, 199.0]), DOWN, [], FREE) == (80, 190, 100, 200)


def test_the_places_of_tags_are_those_in_the_picture() -> None:
    K = Intrinsics(500.0, 500.0, 640.0, 480.0, 1280, 960)
    boxes = [ReplayedObject(k, Box(np.array([x, 0.0, 2.0]), np.full(3, 0.3), np.eye(3))) for k, x in ((1, 0), (2, 0.1))]
    plain = np.full((960, 1280, 3), 90, np.uint8)
    picture, tags = draw_boxes(plain, np.eye(4), K, boxes)
    assert len(tags) == 2
    for left, top, right, bottom in tags:
        assert (picture[top + 4 : bottom - 4, left + 4 : right - 4] != 90).any(2).all()
