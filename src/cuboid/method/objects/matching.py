"""One-to-one assignment."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.method.objects.kernels.pairing import lowest_cost


def assign(score: Float64Array, minimum: float) -> list[tuple[int, int]]:
    """Pair rows with columns one to one so that the summed score is largest.

    Parameters
    ----------
    score : (N, M) float64
        0 or more.
    minimum : float
        Smallest accepted score, above 0.

    Returns
    -------
    list of (int, int)
        Row and column, by row.
    """
    # Keep only rows and columns with an accepted score: there may be thousands of columns.
    worth = score >= minimum
    rows, columns = np.flatnonzero(worth.any(1)), np.flatnonzero(worth.any(0))
    if len(rows) == 0:
        return []
    part = np.where(worth, score, 0.0)[np.ix_(rows, columns)]
    upright = len(rows) <= len(columns)
    cost = np.ascontiguousarray(-(part if upright else part.T), np.float64)
    chosen = np.empty(len(cost), np.int64)
    lowest_cost(cost, chosen)
    pairs = enumerate(chosen.tolist()) if upright else sorted((i, j) for j, i in enumerate(chosen.tolist()))
    return [(int(rows[i]), int(columns[j])) for i, j in pairs if part[i, j] >= minimum]
