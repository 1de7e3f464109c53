"""Planes that turn out to be one: what was seen of a table from two sides."""

from __future__ import annotations

from heapq import heappop, heappush

from cuboid.surfaces.plane import Plane
from cuboid.surfaces.windows import Windows
from cuboid.tolerances import DRIFT_M


def merge_twins(planes: list[Plane], windows: Windows, changed: set[Plane]) -> tuple[list[int], set[Plane]]:
    """Let each plane take in those that are one with it, where either has changed.

    Returns
    -------
    list of int
        The planes that went.
    set of Plane
        Those that took one in.
    """
    queue = sorted({(min(p.index, k), max(p.index, k)) for p in changed for k in _level_with(p, windows)})
    gone: list[int] = []
    grown: set[Plane] = set()
    while queue:
        k, j = heappop(queue)
        one, two = planes[k], planes[j]
        if k in gone or j in gone or not _are_twins(one, two):
            continue
        one.absorb(two)
        windows.note(one)
        grown.add(one)
        gone.append(j)
        for more in _level_with(one, windows):
            if more > j and (k, more) not in queue:
                heappush(queue, (k, more))
    return gone, grown


def _level_with(plane: Plane, windows: Windows) -> list[int]:
    return windows.level_with(plane, DRIFT_M + 1e-6)


def _are_twins(one: Plane, two: Plane) -> bool:
    """Tell whether the middle of each of two planes is as near the other as poses drift, and both cover a place."""
    apart = max(abs(float(one.height(two.mean[None])[0])), abs(float(two.height(one.mean[None])[0])))
    return apart <= DRIFT_M and one.plan.shares_ground(two.plan)
