"""Hot loop: the slab of an object's points that is the rim of the surface on which it stands."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.kernels.sorting import stable_order
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.method.objects.kernels.nearness import count_near

# Largest width of the part above a rim, as a fraction of the width of the rim.
RIM_WIDTH_FRACTION = 0.5
# At least this fraction of a slab that is not a rim lies beneath the part above it.
BENEATH_FRACTION = 0.5
# Fraction of the points at either end that are ignored when a width is measured.
WIDTH_END_FRACTION = 0.1


@kernel
def highest_rim(points, order, begins, ends, axes, gap):
    """Find the highest slab that, in plan, is twice as wide as the part above it and mostly not beneath that part.

    Parameters
    ----------
    points : (N, 3) float32
    order : (N,) int64
        The points from lowest to highest.
    begins, ends : (S,) int64
        Begin and end of each slab in `order`, ascending.
    axes : (3, 2) float64
        Axes of the plan.
    gap : float
        Points within this distance in plan are above each other.

    Returns
    -------
    int
        Index of the slab, -1 if no slab is a rim.
    """
    for k in range(len(begins) - 1, -1, -1):
        slab = plan_of(points, order[begins[k] : ends[k]], axes)
        if len(slab) < MIN_READINGS:
            continue
        rest = plan_of(points, order[ends[k] :], axes)
        x, y = longest(slab)
        if width(rest, x, y) > RIM_WIDTH_FRACTION * width(slab, x, y):
            continue
        enough = np.int64(np.ceil(BENEATH_FRACTION * len(slab)))
        if count_near(slab, rest, gap, enough) < enough:
            return k
    return -1


@kernel
def plan_of(points, chosen, axes):
    """Return plan coordinates (M, 2) float32 of selected points; of many points only every n-th."""
    chosen = chosen[:: 1 + len(chosen) // SAMPLE_POINTS]
    plan = np.empty((len(chosen), 2), np.float32)
    for i in range(len(chosen)):
        x, y, z = points[chosen[i]]
        for k in range(2):
            plan[i, k] = x * axes[0, k] + y * axes[1, k] + z * axes[2, k]
    return plan


@kernel
def longest(plan):
    """Return the direction in which points (N, 2) vary most."""
    x, y = plan[:, 0].astype(np.float64), plan[:, 1].astype(np.float64)
    x, y = x - x.mean(), y - y.mean()
    angle = 0.5 * np.arctan2(2.0 * (x * y).sum(), (x * x).sum() - (y * y).sum())
    return np.cos(angle), np.sin(angle)


@kernel
def width(plan, x, y):
    """Return the extent of points (N, 2) along a direction, without the outermost ones at either end."""
    along = plan[:, 0] * x + plan[:, 1] * y
    along = along[stable_order(along)]
    return at_fraction(along, 1.0 - WIDTH_END_FRACTION) - at_fraction(along, WIDTH_END_FRACTION)


@kernel
def at_fraction(along, fraction):
    """Return the quantile of sorted values at a fraction, with linear interpolation."""
    place = fraction * (len(along) - 1)
    k = min(np.int64(place), len(along) - 2) if len(along) > 1 else 0
    return along[k] + (along[min(k + 1, len(along) - 1)] - along[k]) * (place - k)
