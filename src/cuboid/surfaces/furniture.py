"""Lids of boxes, which are parts of objects and no supporting planes."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from cuboid.surfaces.plane import ON_PLANE_M, Plane

# The tops of things are at most so high above the plane that these stand on, metres; they are not the most of it, and
# above it, not on it. Seats, shelves and stools are higher, or stand beside it.
LID_HEIGHT_M = 0.3
# They cover at most the first fraction of the plane below, and at least the second fraction of them is above it.
LID_AREA_FRACTION, LID_OVER_FRACTION = 0.5, 0.5


def is_lid(plane: Plane, largest_m2: float, others: Callable[[], Iterable[Plane]]) -> bool:
    """Tell whether a plane is the top of things: most of it close above a far larger plane, which goes on beneath it.

    No thing has a top of `largest_m2` and more, square metres.
    """
    area_m2 = plane.plan.area_m2()
    if area_m2 >= largest_m2:
        return False
    center = plane.mean[None]
    return any(
        other.in_use
        and ON_PLANE_M < float(other.height(center)[0]) <= LID_HEIGHT_M
        and area_m2 <= LID_AREA_FRACTION * other.plan.area_m2()
        and plane.plan.fraction_over(other.plan) >= LID_OVER_FRACTION
        for other in others()
        if other is not plane
    )
