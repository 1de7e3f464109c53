from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.kernels.sorting import stable_order


@pytest.mark.parametrize("count", [0, 1, 2, 3, 7, 64, 1000])
def test_the_order_is_that_of_numpys_stable_sort(count: int) -> None:
    rng = np.random.default_rng(count)
    for values in (rng.integers(0, 5, count).astype(float), rng.normal(size=count), np.full(count, np.inf)):
        np.testing.assert_array_equal(stable_order(values), np.argsort(values, kind="stable"))
