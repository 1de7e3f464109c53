"""Where a plane begins: a connected component of level cells at one height."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float64Array
from cuboid.surfaces.grid import CELL_M, LIMIT_CELLS, cells_of
from cuboid.surfaces.plane import ON_PLANE_M


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
