"""The connected parts of points, against SciPy's."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from cuboid.method.relations.kernels.links import number_parts


def test_the_parts_are_those_of_the_pairs_within_the_limit() -> None:
    rng = np.random.default_rng(3)
    for count, limit in ((1, 0.1), (300, 0.05), (300, 0.12), (300, 0.5)):
        points = rng.uniform(-1.0, 1.0, (count, 3)) * (1.0, 0.5, 0.2)
        i, j = cKDTree(points).query_pairs(limit, output_type="ndarray").T
        links = coo_array((np.ones(len(i), bool), (i, j)), shape=(count, count))
        number, expected = connected_components(links, directed=False)
        part = np.empty(count, np.int32)
        assert number_parts(points, limit, part) == number
        assert len({*zip(part.tolist(), expected.tolist(), strict=True)}) == number
        assert np.array_equal(np.sort(np.unique(part, return_index=True)[1]), np.unique(part, return_index=True)[1])


def test_no_points_have_no_part() -> None:
    assert number_parts(np.zeros((0, 3)), 0.1, np.empty(0, np.int32)) == 0
