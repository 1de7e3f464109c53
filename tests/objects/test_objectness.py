"""The probability that an object is one whole thing, from quantities with a meaning."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cuboid.ground.geometry.box import Box
from cuboid.method.objects import objectness
from cuboid.method.objects.entry import MapObject, with_direction
from cuboid.method.objects.objectness import (
    PRIOR_AGREEMENT,
    PRIOR_MATCHED,
    PRIOR_SCORED,
    Quantities,
    area_fraction,
    probability,
    quantities_of,
)
from cuboid.method.surfaces.kernels.outlines import (
    BOTTOM,
    CONTACT,
    FREE,
    HIDDEN,
    KINDS,
    LEFT,
    RIGHT,
    SUPPORT,
    TOP,
    UNSURE,
)


def entry_with(outline: dict[tuple[int, int], int], **fields: object) -> MapObject:
    """An object of 10 x 20 x 40 cm with pixels of its outline by side and kind."""
    kinds = np.zeros((4, KINDS))
    for (side, kind), pixels in outline.items():
        kinds[side, kind] = pixels
    return MapObject(1, 0, 0, Box(np.zeros(3), np.array([0.2, 0.1, 0.4]), np.eye(3)), outline=kinds, **fields)  # type: ignore[arg-type]


ALONE = {(TOP, FREE): 100, (LEFT, FREE): 100, (RIGHT, FREE): 100, (BOTTOM, SUPPORT): 100}


def test_an_object_that_stands_alone() -> None:
    views = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    entry = entry_with(
        ALONE,
        sightings=10.0,
        compared=9.0,
        agreement=8.0,
        shown=19.0,
        largest_px=99,
        directions=views,
        plane=3,
        filled=0.49,
        noise_m=0.01,
        whole_log_odds=12.0,
        scored=5.5,
    )
    found = quantities_of(entry)
    assert found.whole == pytest.approx(12.0 / (5.5 + PRIOR_SCORED)), "the mean with half a view of 0"
    assert found.agreement == pytest.approx((8.0 + PRIOR_AGREEMENT) / 10.0), "and one view of the prior"
    assert found.matched == pytest.approx((10.0 + PRIOR_MATCHED) / 20.0)
    assert found.unrepeated == pytest.approx(0.1)
    assert found.directions == pytest.approx(math.log(3))
    assert found.top_free == found.side_free == pytest.approx((100 + 0.5 * 8) / (100 + 8))
    assert found.top_judged == found.side_judged == pytest.approx((100 + 0.3 * 8) / (100 + 8))
    assert found.elongation == pytest.approx(math.log(2))
    assert found.filled == pytest.approx(math.log(0.5))
    assert found.thickness == pytest.approx(math.log(10))
    assert found.pixels == pytest.approx(math.log(100))
    assert (found.continuing, found.on_plane, found.bears) == (0.0, 1.0, 0.0)


def test_the_worse_side_counts() -> None:
    mixed = {**ALONE, (LEFT, FREE): 0, (LEFT, CONTACT): 50, (LEFT, HIDDEN): 50, (RIGHT, FREE): 50, (RIGHT, UNSURE): 50}
    found = quantities_of(entry_with(mixed))
    prior = 8.0
    assert found.side_free == pytest.approx(0.5 * prior / (50 + prior))
    assert found.side_judged == pytest.approx((50 + 0.3 * prior) / (100 + prior))


def test_more_views_alike_change_only_how_sure_the_means_are() -> None:
    few = entry_with(ALONE, sightings=11.0, compared=10.0, agreement=8.0, shown=20.0)
    many = entry_with({k: 2 * n for k, n in ALONE.items()}, sightings=22.0, compared=20.0, agreement=16.0, shown=40.0)
    a, b = quantities_of(few), quantities_of(many)
    means = {"agreement": 0.0, "matched": 0.0, "unrepeated": 0.0}
    assert a._replace(**means) == b._replace(**means)
    assert abs(a.agreement - b.agreement) < 0.03
    assert abs(a.matched - b.matched) < 0.03
    assert a.unrepeated > b.unrepeated


def test_one_view_has_the_means_of_the_prior() -> None:
    found = quantities_of(entry_with(ALONE, sightings=1.0, shown=1.0))
    assert (found.agreement, found.unrepeated) == (PRIOR_AGREEMENT, 1.0)
    assert found.matched == pytest.approx((1.0 + PRIOR_MATCHED) / 2.0)


def test_the_probability_is_the_logistic_of_the_weighted_sum(monkeypatch: pytest.MonkeyPatch) -> None:
    weights = dict.fromkeys(Quantities._fields, 0.0) | {"agreement": 2.0, "bears": -4.0}
    monkeypatch.setattr(objectness, "coefficients", lambda: objectness.Coefficients(-1.0, weights, 1, 1))
    found = Quantities(*[0.0] * len(Quantities._fields))._replace(agreement=0.75, bears=0.5)
    assert probability(found) == pytest.approx(1.0 / (1.0 + math.exp(-(-1.0 + 1.5 - 2.0))))


def test_the_fitted_weights_have_the_signs_of_their_meaning() -> None:
    weights = objectness.coefficients().weights
    assert tuple(weights) == Quantities._fields
    falls = {"unrepeated", "continuing", "elongation", "bears"}
    assert all(weight <= 0.0 if name in falls else weight >= 0.0 for name, weight in weights.items())
    assert sum(weight != 0.0 for weight in weights.values()) >= 8


def test_a_filled_box_has_the_area_of_its_faces() -> None:
    steps = np.arange(-0.09, 0.1, 0.02)
    grid = np.stack(np.meshgrid(steps, steps, steps), -1).reshape(-1, 3)
    shell = grid[(np.abs(grid) > 0.08).any(1)]
    cells, faces = 10**3 - 8**3, 6 * 100
    assert area_fraction(shell, np.full(3, 0.2), 0.02) == pytest.approx(cells / faces)
    assert area_fraction(shell[:1].repeat(50, 0), np.full(3, 0.2), 0.02) == pytest.approx(1 / faces)


def test_directions_are_kept_if_they_differ() -> None:
    found = with_direction(np.zeros((0, 3), np.float32), np.array([0.0, 0.0, 2.0]))
    found = with_direction(found, np.array([0.1, 0.0, 2.0]))
    assert len(found) == 1, "three degrees"
    found = with_direction(found, np.array([1.0, 0.0, 2.0]))
    assert len(found) == 2
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-6)
