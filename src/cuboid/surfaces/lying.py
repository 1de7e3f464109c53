"""Which of the map's points lie on which planes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float32Array, Float64Array
from cuboid.kernels import carrying as kernel
from cuboid.surfaces.grid import CELL_M
from cuboid.surfaces.plane import Plane


def points_on(
    planes: Sequence[Plane], points: Float32Array, T_plan_world: Float64Array, off_m: float
) -> list[npt.NDArray[np.int32]]:
    """Return for each plane which points are so close to it, where it covers the ground, ascending.

    Parameters
    ----------
    planes : sequence of Plane
    points : (N, 3) float32
        In the world; those that come one after another lie close together.
    T_plan_world : (4, 4) float64
    off_m : float
    """
    if not planes:
        return []
    covered = [plane.plan.covered for plane in planes]
    first = np.cumsum([0, *(cells.size for cells in covered)])
    asked = (
        points,
        np.ascontiguousarray(T_plan_world[:3, :3]),
        np.array([plane.normal for plane in planes]),
        np.array([plane.offset for plane in planes]),
        np.array([plane.plan.window for plane in planes]),
        first,
        np.concatenate([cells.ravel() for cells in covered]),
        off_m,
        CELL_M,
    )
    room = 2 * len(points)
    while True:
        plane, point = np.empty(room, np.int32), np.empty(room, np.int32)
        count = kernel.on_planes(*asked, plane, point)
        if count <= room:
            break
        room = count
    order = np.argsort(plane[:count], kind="stable")
    ends = np.searchsorted(plane[:count], np.arange(len(planes) + 1), sorter=order)
    return [point[order[a:b]] for a, b in pairwise(ends)]
