from __future__ import annotations

from itertools import permutations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cuboid.method.objects.matching import assign


@given(st.integers(0, 2**31), st.integers(1, 4), st.integers(1, 4), st.floats(0.05, 0.9))
def test_the_best_of_all_assignments(seed: int, n: int, m: int, minimum: float) -> None:
    score = np.random.default_rng(seed).random((n, m))
    pairs = assign(score, minimum)
    assert len({i for i, _ in pairs}) == len({j for _, j in pairs}) == len(pairs)
    assert all(score[i, j] >= minimum for i, j in pairs)
    allowed = np.where(score >= minimum, score, 0)
    if n > m:
        allowed = allowed.T
    best = max(
        sum(allowed[i, p[i]] for i in range(len(allowed))) for p in permutations(range(allowed.shape[1]), len(allowed))
    )
    assert np.isclose(sum(score[i, j] for i, j in pairs), best)


def test_few_among_thousands() -> None:
    score = np.zeros((10, 10_000))
    score[3, 9_000], score[4, 9_000], score[4, 17] = 0.9, 0.8, 0.3
    assert assign(score, 0.25) == [(3, 9_000), (4, 17)]


def test_nothing_to_assign() -> None:
    assert assign(np.zeros((0, 5)), 0.1) == []
    assert assign(np.zeros((3, 4)), 0.1) == []
