"""Hot loop: the slab of an object that is the rim of the surface it stands on."""

from __future__ import annotations

import numpy as np

from cuboid.core.compiled import kernel
from cuboid.core.limits import SAMPLE_POINTS
from cuboid.core.tolerances import MIN_READINGS
from cuboid.objects.kernels.nearness import count_near

# The part above a rim is at most this fraction as wide as the rim.
RIM_WIDTH_FRACTION = 0.5
# At least this fraction of a slab that is no rim lies beneath the part above it.
BENEATH_FRACTION = 0.5
# A width is measured without this fraction of the points at either end.
END_FRACTION = 0.1


@kernel
def highest_rim(points, order, begins, ends, axes, gap):
    """Find the highest slab that, in plan, is twice as wide as the part above it and mostly not beneath that part.

    Parameters
    ----------
    points : (N, 3) float32
    order : (N,) int64
        The points from the lowest to the highest.
    begins, ends : (S,) int64
        Places in `order` where each slab begins and ends, ascending.
    axes : (3, 2) float64
        Of the plan.
    gap : float
        Points that near to each other, in plan, are one above the other.

    Returns
    -------
    int
        -1 where no slab is a rim.
    """
    for k in range(len(begins) - 1, -1, -1):
        slab = plan_of(points, order[begins[k] : ends[k]], axes)
        if len(slab) < MIN_READINGS:
            continue
        rest = plan_of(points, order[ends[k] :], axes)
        x, y = longest(slab)
        if width(rest, x, y) > RIM_WIDTH_FRACTION * width(slab, x, y):
            continue
        most = np.int64(np.ceil(BENEATH_FRACTION * len(slab)))
        if count_near(slab, rest, gap, most) < most:
            return k
    return -1


@kernel
def plan_of(points, which, axes):
    """Return where some of points lie in plan, (M, 2) float32: all, or every n-th where these are more."""
    which = which[:: 1 + len(which) // SAMPLE_POINTS]
    plan = np.empty((len(which), 2), np.float32)
    for i in range(len(which)):
        x, y, z = points[which[i]]
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
    """Return how far points (N, 2) reach in a direction, without those few that reach farthest on either side."""
    along = np.sort(plan[:, 0] * x + plan[:, 1] * y)
    return at_fraction(along, 1.0 - END_FRACTION) - at_fraction(along, END_FRACTION)


@kernel
def at_fraction(along, fraction):
    """Return below what a fraction of sorted values lies, linear between two."""
    place = fraction * (len(along) - 1)
    k = min(np.int64(place), len(along) - 2) if len(along) > 1 else 0
    return along[k] + (along[min(k + 1, len(along) - 1)] - along[k]) * (place - k)
