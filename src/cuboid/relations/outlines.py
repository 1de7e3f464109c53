"""Depth of points inside the outlines of planes."""

from __future__ import annotations

import numpy as np

from cuboid.core.frame import Float64Array
from cuboid.geometry.polygons import lie_inside


def depths_inside_m(points: Float64Array, outline: Float64Array) -> Float64Array:
    """Return the distance of points (N, 2) from the edge of a polygon (K, 2), metres: negative outside, (N,).

    If the polygon has fewer than three corners, all distances are -inf.
    """
    if len(outline) < 3:
        return np.full(len(points), -np.inf)
    side = np.roll(outline, -1, axis=0) - outline
    from_start = points[:, None] - outline
    along = np.einsum("nkj,kj->nk", from_start, side) / np.maximum((side**2).sum(1), 1e-18)
    nearest = np.linalg.norm(from_start - np.clip(along, 0.0, 1.0)[..., None] * side, axis=2).min(1)
    return np.asarray(np.where(lie_inside(points, outline), nearest, -nearest))
