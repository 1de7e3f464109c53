"""The outline of a body seen from above: convex hull, smallest rectangle, gap to another outline."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array

# Maximum ratio of widest to narrowest extent of a round outline: a ten-sided prism has 1.052, a square 1.41.
ROUND_EXTENT = 1.06


def hull(points: npt.ArrayLike) -> Float64Array:
    """Return the convex hull of points (N, 2), (K, 2) counter-clockwise."""
    from scipy.spatial import ConvexHull

    cloud = np.asarray(points, np.float64)
    outline: Float64Array = cloud[ConvexHull(cloud).vertices]
    return outline


def smallest_rectangle(outline: Float64Array) -> tuple[Float64Array, Float64Array, float]:
    """Return centre (2,), size (2,) and angle of the rectangle of least area around a convex outline (K, 2).

    One of its sides lies on a side of the outline (Freeman and Shapira, 1975), so only these directions are tried. The
    first size is the larger one; the angle (radians) is that of its axis.
    """
    sides = np.roll(outline, -1, axis=0) - outline
    angles = np.arctan2(sides[:, 1], sides[:, 0])
    along = np.column_stack([np.cos(angles), np.sin(angles)])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    u, v = outline @ along.T, outline @ across.T
    extent = np.column_stack([np.ptp(u, axis=0), np.ptp(v, axis=0)])
    best = int(np.argmin(extent[:, 0] * extent[:, 1]))
    middle = (u[:, best].min() + u[:, best].max()) / 2, (v[:, best].min() + v[:, best].max()) / 2
    center = middle[0] * along[best] + middle[1] * across[best]
    if extent[best, 0] >= extent[best, 1]:
        return center, extent[best], float(angles[best])
    return center, extent[best, ::-1].copy(), float(angles[best] + np.pi / 2)


def is_round(outline: Float64Array) -> bool:
    """Tell whether a convex outline (K, 2) has about the same width in all directions."""
    angles = np.radians(np.arange(0.0, 180.0, 3.0))
    extent = np.ptp(outline @ np.array([np.cos(angles), np.sin(angles)]), axis=0)
    return bool(extent.max() <= ROUND_EXTENT * extent.min())


def gap_m(first: Float64Array, second: Float64Array) -> float:
    """Return the distance between two convex outlines (K, 2), (L, 2) in metres, 0 where they overlap."""
    if _overlap(first, second):
        return 0.0
    return min(_corner_to_side(first, second), _corner_to_side(second, first))


def _overlap(first: Float64Array, second: Float64Array) -> bool:
    """Tell whether two convex outlines overlap, by the separating axis theorem."""
    for outline in (first, second):
        sides = np.roll(outline, -1, axis=0) - outline
        normals = np.column_stack([sides[:, 1], -sides[:, 0]])
        a, b = first @ normals.T, second @ normals.T
        if ((a.max(axis=0) < b.min(axis=0)) | (b.max(axis=0) < a.min(axis=0))).any():
            return False
    return True


def _corner_to_side(corners: Float64Array, outline: Float64Array) -> float:
    sides = np.roll(outline, -1, axis=0) - outline
    from_start = corners[:, None] - outline
    length2 = np.einsum("kj,kj->k", sides, sides)
    along = np.clip(np.einsum("nkj,kj->nk", from_start, sides) / np.maximum(length2, 1e-18), 0, 1)
    return float(np.linalg.norm(from_start - along[..., None] * sides, axis=2).min())
