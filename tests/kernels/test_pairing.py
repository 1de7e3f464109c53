from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from cuboid.method.objects.kernels.pairing import lowest_cost
from cuboid.method.objects.matching import assign


@pytest.mark.parametrize("kinds", [3, 10, 1_000_000])
def test_assignments_are_those_of_scipy_also_where_costs_are_equal(kinds: int) -> None:
    rng = np.random.default_rng(kinds)
    for _ in range(300):
        rows = int(rng.integers(1, 12))
        cost = rng.integers(-kinds, kinds, (rows, rows + int(rng.integers(0, 6)))) / kinds
        column_of = np.empty(rows, np.int64)
        lowest_cost(cost, column_of)
        assert column_of.tolist() == linear_sum_assignment(cost)[1].tolist()


@pytest.mark.parametrize("shape", [(7, 4), (4, 7)])
def test_pairs_are_those_of_scipy(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        score = np.round(rng.random(shape), 1)
        kept = np.where(score >= 0.3, score, 0.0)
        pairs = zip(*linear_sum_assignment(kept, maximize=True), strict=True)
        assert assign(score, 0.3) == [(int(i), int(j)) for i, j in pairs if kept[i, j] >= 0.3]
