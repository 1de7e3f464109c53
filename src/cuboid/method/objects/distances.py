"""Distances between two sets of points."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float32Array
from cuboid.method.objects.kernels.nearness import count_near


def points_near(a: Float32Array, b: Float32Array, limit_m: float, enough: int | None = None) -> int:
    """Return the number of points in `a` that are nearer than a limit to a point in `b`; counting stops at `enough`.

    Parameters
    ----------
    a, b : (N, D) and (M, D) float32
        Metres; D is 2 or 3.
    limit_m : float
    enough : int, optional
    """
    return int(
        count_near(np.ascontiguousarray(a), np.ascontiguousarray(b), limit_m, len(a) if enough is None else enough)
    )


def touch(a: Float32Array, b: Float32Array, limit_m: float) -> bool:
    """Return whether two sets of points, (N, D) and (M, D) float32, come nearer to each other than a limit."""
    return points_near(a, b, limit_m, enough=1) > 0
