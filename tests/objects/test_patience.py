from __future__ import annotations

import numpy as np

from cuboid.geometry.box import Box
from cuboid.objects.entry import MapObject
from cuboid.objects.patience import BESIDE_PATIENCE, FLOATING_PATIENCE, SMALL_PATIENCE, patience

FLOOR = (np.array([0.0, 0.0, 1.0]), 0.0)


def thing(number: int, x: float, low: float = 0.0, points: int = 400) -> MapObject:
    """A cube of 20 cm that begins so high above the floor."""
    center = np.array([x, 0.0, low + 0.1])
    cloud = center + np.random.default_rng(number).uniform(-0.1, 0.1, (points, 3))
    return MapObject(
        number=number,
        points=cloud.astype(np.float32),
        colors=np.zeros((points, 3), np.uint8),
        box=Box(center, np.full(3, 0.2), np.eye(3)),
        plane=None,
        heat=0.9,
        mean_color=np.zeros(3),
        first_frame=0,
        last_frame=0,
    )


def test_what_stands_alone_waits_no_longer_than_usual() -> None:
    assert patience(thing(1, 0.0), None, None, FLOOR) == 1


def test_what_floats_or_is_small_may_be_a_part() -> None:
    assert patience(thing(1, 0.0, low=0.3), None, None, FLOOR) == FLOATING_PATIENCE
    assert patience(thing(1, 0.0, points=30), None, None, FLOOR) == SMALL_PATIENCE


def test_what_touches_another_waits_until_the_frames_have_said_that_they_are_two() -> None:
    assert patience(thing(1, 0.0), thing(2, 0.2), None, FLOOR) == BESIDE_PATIENCE
    assert patience(thing(1, 0.0), thing(2, 0.2), False, FLOOR) == 1


def test_two_that_share_room_cannot_both_be_whole_whatever_a_few_frames_say() -> None:
    assert patience(thing(1, 0.0), thing(2, 0.1), False, FLOOR) == BESIDE_PATIENCE
