"""Polygons in a plane."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array


def lie_inside(points: Float64Array, polygon: Float64Array) -> npt.NDArray[np.bool_]:
    """Return which points (N, 2) lie inside a polygon with corners (K, 2) in order, (N,)."""
    inside = np.zeros(len(points), bool)
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        # Even-odd rule: each edge that a ray from the point along +x crosses toggles inside and outside.
        crossed = np.flatnonzero((y0 > points[:, 1]) != (y1 > points[:, 1]))
        along = (points[crossed, 1] - y0) / (y1 - y0)  # 0..1
        inside[crossed] ^= points[crossed, 0] < x0 + (x1 - x0) * along
    return inside
