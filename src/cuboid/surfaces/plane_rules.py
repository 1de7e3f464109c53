"""Rules of supporting planes: where one begins, which are lids of boxes, and which are duplicates."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from heapq import heappop, heappush

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float64Array
from cuboid.core.tolerances import DRIFT_M
from cuboid.surfaces.grid import CELL_M, LIMIT_CELLS, cells_of
from cuboid.surfaces.plane import ON_PLANE_M, Plane
from cuboid.surfaces.windows import Windows

# The tops of things are at most so high above the plane that these stand on, metres; they are not the most of it, and
# above it, not on it. Seats, shelves and stools are higher, or stand beside it.
LID_HEIGHT_M = 0.3
# They cover at most the first fraction of the plane below, and at least the second fraction of them is above it.
LID_AREA_FRACTION, LID_OVER_FRACTION = 0.5, 0.5


def largest_level(
    centers: Float64Array, area_m2: Float64Array, free: npt.NDArray[np.int64], gap_m: float
) -> npt.NDArray[np.int64]:
    """Return those of the free cells that make the largest level area, at the height that collects most of it.

    Things hide no more of a plane than they are long: what lies farther apart is two, a shelf's board and the top of a
    book on a table.

    Parameters
    ----------
    centers : (N, 3) float64
        Of level cells, in the plan frame.
    area_m2 : (N,) float64
    free : (M,) int64
        Cells that belong to no plane, one at least.
    gap_m : float
        What one plane has between its parts is no wider.
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
    """Number plan coordinates (N, 2 or 3) by connected component: (N,), connected where gaps are no wider than one.

    Gaps are as wide along each of the plan's axes. What is wider than a ground plan is one group.
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


def merge_duplicates(planes: list[Plane], windows: Windows, changed: set[Plane]) -> tuple[list[int], set[Plane]]:
    """Let each plane absorb its duplicates, where either has changed.

    Returns
    -------
    list of int
        The planes that were absorbed.
    set of Plane
        Those that absorbed one.
    """
    queue = sorted({(min(p.index, k), max(p.index, k)) for p in changed for k in _level_with(p, windows)})
    gone: list[int] = []
    grown: set[Plane] = set()
    while queue:
        k, j = heappop(queue)
        one, two = planes[k], planes[j]
        if k in gone or j in gone or not _are_duplicates(one, two):
            continue
        one.absorb(two)
        windows.update(one)
        grown.add(one)
        gone.append(j)
        for more in _level_with(one, windows):
            if more > j and (k, more) not in queue:
                heappush(queue, (k, more))
    return gone, grown


def _level_with(plane: Plane, windows: Windows) -> list[int]:
    return windows.level_with(plane, DRIFT_M + 1e-6)


def _are_duplicates(one: Plane, two: Plane) -> bool:
    """Tell whether two planes are as near to each other as poses drift, at their means, and overlap in plan."""
    distance = max(abs(float(one.height(two.mean[None])[0])), abs(float(two.height(one.mean[None])[0])))
    return distance <= DRIFT_M and one.plan.overlaps(two.plan)
