"""What is furniture, and what is a thing: the lids of boxes are no supporting planes."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from cuboid.surfaces.plane import ON_PLANE_M, Plane
from cuboid.tolerances import FACE_M2, MOST

# The top of a box is a face of a thing, and at most so high above the plane that the box stands on, metres; it is not
# the most of that plane, and above it, not on it. Seats, shelves and stools are larger or higher.
LID_HEIGHT_M = 0.3


def is_lid(plane: Plane, area_m2: float, others: Callable[[], Iterable[Plane]]) -> bool:
    """Tell whether a plane of this area is the top of an object: small, and not high above a far larger plane."""
    if area_m2 >= FACE_M2:
        return False
    center = plane.mean[None]
    return any(
        other.in_use
        and ON_PLANE_M < float(other.height(center)[0]) <= LID_HEIGHT_M
        and area_m2 <= MOST * other.plan.area_m2()
        and bool(other.plan.covers(center)[0])
        for other in others()
        if other is not plane
    )
