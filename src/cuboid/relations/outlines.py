"""How deep points lie inside the outlines of planes."""

from __future__ import annotations

import numpy as np

from cuboid.core.frame import Float64Array


def depths_inside_m(points: Float64Array, outline: Float64Array) -> Float64Array:
    """Return the distance of points (N, 2) from the edge of a polygon (K, 2), metres: negative outside, (N,).

    Outside of everything, -inf, where the polygon has fewer than three corners.
    """
    if len(outline) < 3:
        return np.full(len(points), -np.inf)
    start, end = outline, np.roll(outline, -1, axis=0)
    side = end - start
    from_start = points[:, None] - start
    along = np.einsum("nkj,kj->nk", from_start, side) / np.maximum((side**2).sum(1), 1e-18)
    nearest = np.linalg.norm(from_start - np.clip(along, 0.0, 1.0)[..., None] * side, axis=2).min(1)
    # Even-odd rule: each side that a ray along +x crosses takes the point in or out.
    crossed = (start[:, 1] > points[:, 1:]) != (end[:, 1] > points[:, 1:])
    at = (points[:, 1:] - start[:, 1]) / np.where(side[:, 1] == 0.0, 1.0, side[:, 1])
    inside = (crossed & (points[:, :1] < start[:, 0] + at * side[:, 0])).sum(1) % 2 == 1
    return np.asarray(np.where(inside, nearest, -nearest))
