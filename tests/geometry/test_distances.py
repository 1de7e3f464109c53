"""How many points have another set near them, beside what SciPy's tree finds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cuboid.method.objects.distances import points_near, touch


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("away", [0.0, 0.3, 0.97, 1.05])
def test_as_many_points_are_near_as_a_tree_finds(dimensions: int, away: float) -> None:
    rng = np.random.default_rng(int(100 * away) + dimensions)
    a = rng.random((700, dimensions)).astype(np.float32)
    b = (rng.random((900, dimensions)) + np.eye(dimensions)[0] * away).astype(np.float32)
    for limit_m in (0.003, 0.02, 0.1, 2.0):
        found = int((cKDTree(b).query(a)[0] < limit_m).sum())
        assert points_near(a, b, limit_m) == found
        assert points_near(a, b, limit_m, enough=5) == min(5, found)
        assert touch(a, b, limit_m) == (found > 0)


def test_every_other_point_of_a_set_and_a_set_without_points_are_sets_too() -> None:
    a = np.arange(30, dtype=np.float32).reshape(10, 3)
    assert points_near(a[::2], a[1::2], 5.2) == 5
    assert points_near(a, a[:0], 1.0) == points_near(a[:0], a, 1.0) == 0
