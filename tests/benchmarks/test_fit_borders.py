"""The fit of the evidence of borders: it finds known weights, and an order of scores gives the area under the curve."""

from __future__ import annotations

import numpy as np
import pytest

from fit_borders import area_under_curve, fit


def test_the_fit_finds_the_weights_of_made_cases() -> None:
    rng = np.random.default_rng(1)
    x = rng.normal(0.0, 1.0, (20000, 2))
    y = (rng.random(len(x)) < 1.0 / (1.0 + np.exp(-(0.5 + 1.2 * x[:, 0] - 0.7 * x[:, 1])))).astype(np.float64)
    assert fit(x, y, np.ones(len(y))) == pytest.approx([0.5, 1.2, -0.7], abs=0.08)


def test_the_area_under_the_curve_is_the_fraction_of_pairs_in_order() -> None:
    scores, y = np.array([0.1, 0.4, 0.35, 0.8]), np.array([0.0, 0.0, 1.0, 1.0])
    assert area_under_curve(scores, y) == 0.75
