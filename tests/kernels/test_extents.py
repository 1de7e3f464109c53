from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cuboid.kernels.extents import BINS, reach


def numpy_reach(points: np.ndarray, weights: np.ndarray, direction: np.ndarray, share: float) -> tuple[float, float]:
    along = points @ direction
    order = np.argsort(along)
    mass = np.cumsum(weights[order])
    cut = share * mass[-1]
    low = along[order][np.searchsorted(mass, cut)]
    high = along[order][len(mass) - 1 - np.searchsorted(np.cumsum(weights[order][::-1]), cut)]
    return float(low), float(high)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 0.1), st.integers(5, 400))
def test_reach_is_the_weighted_quantile_to_a_bin(seed: int, share: float, n: int) -> None:
    rng = np.random.default_rng(seed)
    points, weights = rng.normal(size=(n, 2)), rng.uniform(0.1, 2.0, n)
    angles = rng.uniform(0, np.pi, 5)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    low, high = np.empty(5), np.empty(5)
    reach(points, weights, directions, share, low, high)
    for k in range(5):
        bin_m = np.ptp(points @ directions[k]) / BINS
        expected = numpy_reach(points, weights, directions[k], share)
        assert abs(low[k] - expected[0]) <= 1.01 * bin_m
        assert abs(high[k] - expected[1]) <= 1.01 * bin_m


def test_nothing_is_left_out_at_share_zero() -> None:
    points = np.array([[0.0, 1.0], [3.0, -2.0], [1.0, 1.0]])
    low, high = np.empty(2), np.empty(2)
    reach(points, np.ones(3), np.eye(2), 0.0, low, high)
    assert (low.tolist(), high.tolist()) == ([0.0, -2.0], [3.0, 1.0])


def test_a_single_point_has_no_extent() -> None:
    low, high = np.empty(1), np.empty(1)
    reach(np.array([[0.5, 2.0]]), np.ones(1), np.array([[1.0, 0.0]]), 0.05, low, high)
    assert (low[0], high[0]) == (0.5, 0.5)
