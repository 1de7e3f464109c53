"""How far two sets of points are from each other."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from cuboid.frame import Float32Array, Float64Array


def distances_m(a: Float32Array, b: Float32Array, limit_m: float) -> Float64Array:
    """Return how far from the other set those points are that are no farther than a limit.

    Parameters
    ----------
    a, b : (N, 3) and (M, 3) float32
        Metres.
    limit_m : float

    Returns
    -------
    (K,) float64
        From each such point of `a` to the nearest of `b`, metres.
    """
    # Only what lies in the other's surroundings can be that near.
    for _ in range(2):
        if len(a) == 0 or len(b) == 0:
            return np.empty(0)
        a, b = b[((b > a.min(0) - limit_m) & (b < a.max(0) + limit_m)).all(1)], a
    if len(a) == 0 or len(b) == 0:
        return np.empty(0)
    distance = np.asarray(cKDTree(b).query(a, distance_upper_bound=limit_m)[0], dtype=np.float64)
    return distance[np.isfinite(distance)]
