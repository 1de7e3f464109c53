"""A candidate gets a label when it is probably one whole thing, and has the size of an object."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.geometry.box import Box
from cuboid.method.objects.confirmation import is_confirmable
from cuboid.method.objects.entry import MapObject

UP = np.eye(3)


def candidate(probability: float, size: tuple[float, float, float] = (0.1, 0.08, 0.12)) -> MapObject:
    return MapObject(
        1, 0, 0, Box(np.zeros(3), np.array(size), UP), points=np.zeros((20, 3), np.float32), probability=probability
    )


@pytest.mark.parametrize(
    ("probability", "least", "expected"), [(0.5, 0.4, True), (0.4, 0.4, True), (0.39, 0.4, False), (0.5, 0.9, False)]
)
def test_the_probability_decides(probability: float, least: float, expected: bool) -> None:
    assert is_confirmable(candidate(probability), TrackerConfig(min_probability=least)) is expected


@pytest.mark.parametrize("size", [(0.1, 0.02, 0.02), (0.1, 0.08, 0.005), (1.5, 0.5, 0.5)])
def test_a_box_that_has_not_the_size_of_an_object_gets_no_label(size: tuple[float, float, float]) -> None:
    assert not is_confirmable(candidate(0.99, size), TrackerConfig())


def test_a_candidate_without_a_box_of_its_points_gets_no_label() -> None:
    entry = candidate(0.99)
    entry.points = np.zeros((0, 3), np.float32)
    assert not is_confirmable(entry, TrackerConfig())
