"""Hot loop: how far a weighted point set reaches in many directions, strays left out."""

from __future__ import annotations

import numpy as np
from numba import njit

BINS = 256


@njit(cache=True, nogil=True)
def reach(points, weights, directions, share, low, high):
    """Find for each direction the interval that holds all weight but `share` at either end.

    The weight is collected in 256 bins over the whole range; within a bin it is taken as spread evenly.

    Parameters
    ----------
    points : (N, 2) float64
    weights : (N,) float64
        Positive.
    directions : (D, 2) float64
        Unit.
    share : float
        Share of the weight left out at each end, 0..0.5.
    low, high : (D,) float64, output
    """
    total = 0.0
    for i in range(points.shape[0]):
        total += weights[i]
    cut = share * total
    bins = np.empty(BINS)
    along = np.empty(points.shape[0])
    for d in range(directions.shape[0]):
        first, last = np.inf, -np.inf
        for i in range(points.shape[0]):
            a = points[i, 0] * directions[d, 0] + points[i, 1] * directions[d, 1]
            along[i] = a
            first, last = min(first, a), max(last, a)
        low[d], high[d] = first, last
        if share <= 0.0 or last <= first:
            continue
        bins[:] = 0.0
        scale = BINS / (last - first)
        for i in range(points.shape[0]):
            bins[min(BINS - 1, int((along[i] - first) * scale))] += weights[i]
        left, k = 0.0, 0
        while left + bins[k] < cut:
            left += bins[k]
            k += 1
        low[d] = first + (k + (cut - left) / bins[k]) / scale
        left, k = 0.0, BINS - 1
        while left + bins[k] < cut:
            left += bins[k]
            k -= 1
        high[d] = first + (k + 1 - (cut - left) / bins[k]) / scale
