"""Duplicate planes: a table that was seen from two sides first."""

from __future__ import annotations

from heapq import heappop, heappush

from cuboid.core.tolerances import DRIFT_M
from cuboid.surfaces.plane import Plane
from cuboid.surfaces.windows import Windows


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
