"""Hot loop: mean shift of points on lines."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import MIN_SIGMA_M


@kernel
def shift_means(places, weight, reach_m, mean, near):
    """Move points repeatedly to the weighted mean of the points within reach, until none moves by more than 1 mm.

    Parameters
    ----------
    places : (N,) float64
        Ascending, metres; at least one.
    weight : (N,) float64
        Weight of each point, above 0.
    reach_m : float
    mean : (N,) float64, output
        Final position of each point.
    near : (N,) float64, output
        Number of points within reach in the last step.
    """
    n = len(places)
    weights, moments = np.zeros(n + 1), np.zeros(n + 1)
    for i in range(n):
        weights[i + 1] = weights[i] + weight[i]
        moments[i + 1] = moments[i] + weight[i] * places[i]
        mean[i] = places[i]
    moved = np.inf
    while moved > MIN_SIGMA_M:
        moved, low, high = 0.0, 0, 0
        for i in range(n):
            # Ascending order is kept: a later point never moves before an earlier one.
            while low < n - 1 and places[low] < mean[i] - reach_m:
                low += 1
            high = max(high, low + 1)  # with one point at each end, rounding may exclude both
            while high < n and places[high] <= mean[i] + reach_m:
                high += 1
            to = (moments[high] - moments[low]) / (weights[high] - weights[low])
            moved = max(moved, abs(to - mean[i]))
            mean[i], near[i] = to, high - low
