from __future__ import annotations

import numpy as np
import pytest

from cuboid.lab.evaluation.average_precision import average_precision


def ap(score: list[float], right: list[int], wanted: int) -> float | None:
    return average_precision(np.array(score, float), np.array(right, bool), wanted)


def test_average_precision_computed_by_hand() -> None:
    # By score: right, false, right, and two of four objects never found: 1/4 * 1 + 1/4 * 2/3.
    assert ap([0.5, 0.7, 0.9], [1, 0, 1], 4) == pytest.approx(0.25 * (1 + 2 / 3))
    # False ones last cost nothing.
    assert ap([0.1, 0.8, 0.9, 0.2], [0, 1, 1, 0], 2) == 1.0
    # A false one first: its precision is raised to the best one at a higher recall, 2/3.
    assert ap([0.9, 0.8, 0.7], [0, 1, 1], 2) == pytest.approx(2 / 3)
    assert ap([], [], 3) == 0.0
    assert ap([0.4], [0], 0) is None


def test_equal_scores_are_one_point_of_the_curve() -> None:
    # All at once: recall 2/4 at precision 2/3, in any order.
    for right in ([1, 1, 0], [0, 1, 1], [1, 0, 1]):
        assert ap([1.0, 1.0, 1.0], right, 4) == pytest.approx(0.5 * 2 / 3)


def test_without_a_probability_a_box_ranks_last() -> None:
    assert ap([float("nan"), 0.1], [0, 1], 1) == 1.0
    assert ap([float("nan"), 0.1], [1, 0], 1) == 0.5


def test_it_agrees_with_the_definition_on_random_rankings() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        count, wanted = int(rng.integers(1, 30)), int(rng.integers(1, 20))
        right = np.zeros(count, bool)
        right[rng.permutation(count)[: rng.integers(0, min(count, wanted) + 1)]] = True
        score = rng.integers(0, 8, count) / 8  # many equal ones
        assert average_precision(score, right, wanted) == pytest.approx(by_definition(score, right, wanted))


def by_definition(score: np.ndarray, right: np.ndarray, wanted: int) -> float:
    """Return the sum over recall steps of the largest precision at the step's recall or a higher one."""
    curve = [(right[score >= t].sum() / wanted, right[score >= t].mean()) for t in np.unique(score)]
    steps = [k / wanted for k in range(1, wanted + 1)]
    best = [max((p for r, p in curve if r >= step - 1e-9), default=0.0) for step in steps]
    return float(np.mean(best))
