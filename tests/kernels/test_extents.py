from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cuboid.method.boxes.kernels.extents import BINS, beyond_sides, ends_at, reach

# How far beyond its sides places are put, metres.
STEPS = np.array([0.02, 0.03, 0.04])


def numpy_reach(points: np.ndarray, weights: np.ndarray, direction: np.ndarray, fraction: float) -> tuple[float, float]:
    along = points @ direction
    order = np.argsort(along)
    mass = np.cumsum(weights[order])
    cut = fraction * mass[-1]
    low = along[order][np.searchsorted(mass, cut)]
    high = along[order][len(mass) - 1 - np.searchsorted(np.cumsum(weights[order][::-1]), cut)]
    return float(low), float(high)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 0.1), st.integers(5, 400))
def test_reach_is_the_weighted_quantile_to_a_bin(seed: int, fraction: float, n: int) -> None:
    rng = np.random.default_rng(seed)
    points, weights = rng.normal(size=(n, 2)), rng.uniform(0.1, 2.0, n)
    angles = rng.uniform(0, np.pi, 5)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    low, high = np.empty(5), np.empty(5)
    reach(points, weights, directions, fraction, low, high)
    for k in range(5):
        bin_m = np.ptp(points @ directions[k]) / BINS
        expected = numpy_reach(points, weights, directions[k], fraction)
        assert abs(low[k] - expected[0]) <= 1.01 * bin_m
        assert abs(high[k] - expected[1]) <= 1.01 * bin_m


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.001, 0.3), st.integers(2, 400))
def test_points_that_weigh_the_same_reach_as_far_whatever_each_weighs(seed: int, fraction: float, n: int) -> None:
    """A weight of 2 each goes by all bins, a weight of 1 by the outermost ones alone."""
    rng = np.random.default_rng(seed)
    points = np.round(rng.normal(size=(n, 2)), rng.integers(1, 4))
    angles = rng.uniform(0, np.pi, 5)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    found = np.empty((2, 2, 5))
    for weight in (1, 2):
        reach(points, np.full(n, float(weight)), directions, fraction, *found[weight - 1])
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-12)


def test_nothing_is_left_out_at_share_zero() -> None:
    points = np.array([[0.0, 1.0], [3.0, -2.0], [1.0, 1.0]])
    low, high = np.empty(2), np.empty(2)
    reach(points, np.ones(3), np.eye(2), 0.0, low, high)
    assert (low.tolist(), high.tolist()) == ([0.0, -2.0], [3.0, 1.0])


def test_what_is_evenly_spread_ends_where_it_ends() -> None:
    assert ends_at(np.linspace(10.0, 60.0, 500)) == pytest.approx((10.0, 60.0), abs=0.2)
    assert ends_at(np.full(5, 7.0)) == (7.0, 7.0)
    assert ends_at(np.empty(0)) == (np.inf, -np.inf)


def test_a_few_points_far_out_move_no_edge() -> None:
    spread = np.random.default_rng(3).uniform(10.0, 60.0, 495)
    low, high = ends_at(np.concatenate([spread, [2.0, 80.0, 95.0, -30.0, 70.0]]))
    assert low == pytest.approx(10.0, abs=1.0)
    assert high == pytest.approx(60.0, abs=1.0)


def test_a_single_point_has_no_extent() -> None:
    low, high = np.empty(1), np.empty(1)
    reach(np.array([[0.5, 2.0]]), np.ones(1), np.array([[1.0, 0.0]]), 0.05, low, high)
    assert (low[0], high[0]) == (0.5, 0.5)


def numpy_beyond(points: np.ndarray, center: np.ndarray, R: np.ndarray) -> list[np.ndarray]:
    own = (points - center) @ R
    own = own[own[:, 2] > -0.1]
    sides = []
    for axis, sign in ((2, 1), (0, 1), (0, -1), (1, 1), (1, -1)):
        edge = own[:, axis].max() - own[:, axis] if sign > 0 else own[:, axis] - own[:, axis].min()
        steps = sign * STEPS[:, None] * np.eye(3)[axis]
        sides.append(((own[edge <= 0.03][:, None] + steps) @ R.T + center).reshape(-1, 3))
    return sides


def test_what_lies_beyond_the_sides_is_what_array_operations_put_there() -> None:
    rng = np.random.default_rng(4)
    points, center = rng.uniform(-0.3, 0.3, (80, 3)).astype(np.float32), np.array([0.02, -0.05, 0.01])
    R = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    places, counts = np.empty((5 * len(STEPS) * len(points), 3)), np.empty(5, np.int64)
    found = beyond_sides(points, center, R, -0.1, 0.03, STEPS, places, counts)
    expected = numpy_beyond(points.astype(float), center, R)
    assert counts.tolist() == [len(side) // len(STEPS) for side in expected]
    np.testing.assert_allclose(places[:found], np.concatenate(expected), atol=1e-12)
    assert beyond_sides(points, center, R, 1.0, 0.03, STEPS, places, counts) == counts.sum() == 0
