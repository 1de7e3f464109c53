"""Names of supporting planes: the floor, and tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.results import SupportPlane
from cuboid.method.relations.tree import plane_heights_m

SurfaceKind = Literal["floor", "table"]
FLOOR: SurfaceKind = "floor"
TABLE: SurfaceKind = "table"

# The lowest plane is the floor if another one lies this far above it, metres (lower planes are steps, boxes and rugs),
# or if its seen part is larger than table tops are, square metres.
ABOVE_FLOOR_M, FLOOR_AREA_M2 = 0.3, 4.0
# Tops of tables: metres above the floor, from low tables to counters and bars; and the least seen area, square metres,
# below which it may be the seat of a chair.
TABLE_HEIGHT_M, TABLE_AREA_M2 = (0.3, 1.2), 0.2


def surface_kinds(planes: Sequence[SupportPlane], up: Float64Array | None) -> list[SurfaceKind | None]:
    """Return for each supporting plane whether it is the floor or a table; None if it is neither, or unknown.

    If no plane is the floor (a camera above a desk), the planes that are large enough are tables.

    Parameters
    ----------
    planes : sequence of SupportPlane
    up : (3,) float64 or None
        Up in the world; None if it is unknown, and then no plane has a kind.
    """
    if up is None or not planes:
        return [None] * len(planes)
    heights, areas = plane_heights_m(planes, up), [plane_area_m2(plane) for plane in planes]
    lowest = int(np.argmin(heights))
    has_floor = max(heights) >= ABOVE_FLOOR_M or areas[lowest] >= FLOOR_AREA_M2
    low, high = TABLE_HEIGHT_M if has_floor else (0.0, np.inf)

    def kind(k: int) -> SurfaceKind | None:
        if has_floor and k == lowest:
            return FLOOR
        return TABLE if low <= heights[k] <= high and areas[k] >= TABLE_AREA_M2 else None

    return [kind(k) for k in range(len(planes))]


def plane_area_m2(plane: SupportPlane) -> float:
    """Return the area of the seen part of a plane, square metres."""
    if not len(plane.extent):
        return 0.0
    # twice the area of a polygon in space: the sum of the cross products of successive corners, along the normal
    products = np.cross(plane.extent, np.roll(plane.extent, -1, axis=0))
    return 0.5 * abs(float(products.sum(axis=0) @ plane.normal))
