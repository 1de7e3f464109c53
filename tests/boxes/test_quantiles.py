"""Quantiles are NumPy's."""

from __future__ import annotations

import numpy as np

from cuboid.method.boxes.quantiles import quantile


def test_a_quantile_is_that_of_numpy_to_the_last_bit() -> None:
    rng = np.random.default_rng(1)
    for count in (1, 2, 3, 7, 40, 333):
        values = rng.normal(size=count)
        for fraction in (0.0, 0.02, 0.5, 0.98, 1.0):
            assert quantile(values, fraction) == np.quantile(values, fraction)
