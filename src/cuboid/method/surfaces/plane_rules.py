"""Rules for supporting planes: where a plane begins, which planes are lids of boxes, and which are duplicates."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from heapq import heappop, heappush

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.tolerances import DRIFT_M
from cuboid.method.surfaces.grid import CELL_M, LIMIT_CELLS, cells_of
from cuboid.method.surfaces.plane import ON_PLANE_M, Plane
from cuboid.method.surfaces.windows import Windows

# A lid, i.e. the top of an object, is at most this high above the plane on which the object stands, metres. Seats,
# shelves and stools are higher, or stand beside that plane.
LID_HEIGHT_M = 0.3
# A lid has at most LID_AREA_FRACTION of the area of the plane below, and at least LID_OVER_FRACTION of it is above it.
LID_AREA_FRACTION, LID_OVER_FRACTION = 0.5, 0.5


def largest_level(
    centers: Float64Array, area_m2: Float64Array, free: npt.NDArray[np.int64], gap_m: float
) -> npt.NDArray[np.int64]:
    """Return the free cells that form the largest connected level area, at the height with most level area.

    Objects hide a stretch of a plane no longer than themselves. Parts that are farther apart are two planes, such as
    the board of a shelf and the top of a book on a table.

    Parameters
    ----------
    centers : (N, 3) float64
        Centres of level cells, in the plan frame.
    area_m2 : (N,) float64
    free : (M,) int64
        Indices of cells that belong to no plane, at least one.
    gap_m : float
        Largest gap between parts of one plane.
    """
    order = free[np.argsort(centers[free, 2], kind="stable")]
    heights = centers[order, 2]
    total = np.concatenate([[0.0], np.cumsum(area_m2[order])])
    end = np.searchsorted(heights, heights + 2 * ON_PLANE_M, side="right")
    first = int(np.argmax(total[end] - total[:-1]))
    members = order[first : end[first]]
    group = connected_groups(centers[members], gap_m)
    return np.asarray(members[group == np.argmax(np.bincount(group, area_m2[members]))])


def connected_groups(points: Float64Array, gap_m: float) -> npt.NDArray[np.int32]:
    """Return the connected component (N,) of plan coordinates (N, 2 or 3); gaps up to `gap_m` connect points.

    Gaps are measured along the axes of the plan. Points spread wider than the largest ground plan form one group.
    """
    cells = cells_of(points)
    cells -= cells.min(0)
    if cells.max() >= LIMIT_CELLS:
        return np.zeros(len(cells), np.int32)
    half = round(gap_m / CELL_M) // 2
    i, j = cells.T + half
    layer = np.zeros((i.max() + half + 1, j.max() + half + 1), np.uint8)
    layer[i, j] = 1
    _, groups = cv2.connectedComponents(cv2.dilate(layer, np.ones((2 * half + 1,) * 2, np.uint8)))
    return np.asarray(groups[i, j], dtype=np.int32)


def is_lid(plane: Plane, largest_m2: float, others: Callable[[], Iterable[Plane]]) -> bool:
    """Return whether a plane is the top of objects: mostly close above a far larger plane that continues beneath.

    Planes of `largest_m2` or more, square metres, are never lids.
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


def merge_duplicates(planes: list[Plane], windows: Windows, changed: set[Plane]) -> tuple[list[int], set[Plane]]:
    """Let each plane absorb its duplicates, if either of them has changed.

    Returns
    -------
    list of int
        Indices of the planes that were absorbed.
    set of Plane
        The planes that absorbed one.
    """
    queue = sorted({(min(p.index, k), max(p.index, k)) for p in changed for k in _level_with(p, windows)})
    gone: list[int] = []
    grown: set[Plane] = set()
    while queue:
        k, j = heappop(queue)
        first, second = planes[k], planes[j]
        if k in gone or j in gone or not _are_duplicates(first, second):
            continue
        first.absorb(second)
        windows.update(first)
        grown.add(first)
        gone.append(j)
        for other in _level_with(first, windows):
            if other > j and (k, other) not in queue:
                heappush(queue, (k, other))
    return gone, grown


def _level_with(plane: Plane, windows: Windows) -> list[int]:
    return windows.level_with(plane, DRIFT_M + 1e-6)


def _are_duplicates(first: Plane, second: Plane) -> bool:
    """Return whether two planes overlap in plan and differ in height at their means by no more than pose drift."""
    distance = max(abs(float(first.height(second.mean[None])[0])), abs(float(second.height(first.mean[None])[0])))
    return distance <= DRIFT_M and first.plan.overlaps(second.plan)
