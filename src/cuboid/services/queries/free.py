"""The nearest free place on a surface for a footprint of a given size."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.results import SupportPlane
from cuboid.ground.geometry.box import Box
from cuboid.method.relations.footprints import Footprints
from cuboid.services.queries.answers import FreePlace, Vector
from cuboid.services.queries.looking import vector

# Side of a cell of the plan, metres; larger on surfaces that would have more than `MAX_CELLS` along a side.
PLAN_CELL_M, MAX_CELLS = 0.01, 400
# Minimum distance of a place from objects and from the edge, metres: the typical error of boxes.
CLEARANCE_M = 0.01
# Number of tested directions of the length, over half a turn.
DIRECTIONS = 12
# An object whose top is at most this high above the surface, metres, does not stand on it.
FLAT_OBJECT_M = 0.005
# Places whose distances differ by less than this, metres, count as equally near; the first direction is taken.
EQUALLY_NEAR_M = 0.005


def free_place(
    surface: str, plane: SupportPlane, boxes: Sequence[Box], size_m: Vector, near: Float64Array | None
) -> FreePlace | None:
    """Return the nearest free place on a surface; None if there is none.

    Parameters
    ----------
    surface : str
        Name of the surface.
    plane : SupportPlane
    boxes : sequence of Box
        Boxes of all objects of the place.
    size_m : (3,)
        Length and width of the footprint, and height of the free space above it, metres.
    near : (3,) float64 or None
        Wanted position in the world (default: the centre of the surface).

    Raises
    ------
    InputError
        A size is not a positive finite number.
    """
    length, width, height = size_m
    if not all(0.0 < side < np.inf for side in size_m):
        raise InputError(f"expected a length, a width and a height above 0 metres, got {shown(list(size_m))}")
    if len(plane.extent) < 3:
        return None
    up = plane.normal
    feet = Footprints.of(boxes, up)
    outline = plane.extent @ feet.ground
    low = outline.min(0)
    cell_m = max(PLAN_CELL_M, float(np.ptp(outline, axis=0).max()) / MAX_CELLS)
    free = _plan(outline, feet, -plane.offset, height, low, cell_m)
    wanted = (plane.extent.mean(0) if near is None else near) @ feet.ground
    found = _nearest(free, (wanted - low) / cell_m, length / cell_m, width / cell_m)
    if found is None:
        return None
    (x, y), turn = found
    place = np.array([x, y]) * cell_m + low
    center = feet.ground @ place - plane.offset * up
    along = feet.ground @ np.array([np.cos(turn), np.sin(turn)])
    distance = float(np.linalg.norm(place - wanted))
    return FreePlace(surface, vector(center), vector(along), length, width, round(distance, 4))


def _plan(
    outline: Float64Array, feet: Footprints, level_m: float, height_m: float, low: Float64Array, cell_m: float
) -> UInt8Array:
    """Return the plan of a surface, (rows, columns): 1 in seen cells with free space above, else 0."""
    columns, rows = np.ceil(np.ptp(outline, axis=0) / cell_m).astype(int) + 3
    plan = np.zeros((int(rows), int(columns)), np.uint8)
    cv2.fillPoly(plan, [_cells(outline, low, cell_m)], 1)
    blocks = (feet.high > level_m + FLAT_OBJECT_M) & (feet.low < level_m + height_m)
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for k in np.flatnonzero(blocks):
        local = corners * (feet.half[k] + CLEARANCE_M)
        cv2.fillPoly(plan, [_cells(feet.center[k] + local @ feet.axes[k].T, low, cell_m)], 0)
    return plan


def _cells(points: Float64Array, low: Float64Array, cell_m: float) -> npt.NDArray[np.int32]:
    return np.round((points - low) / cell_m).astype(np.int32)


def _nearest(
    free: UInt8Array, wanted: Float64Array, length: float, width: float
) -> tuple[tuple[int, int], float] | None:
    """Return cell (column, row) and rotation, radians, of the nearest footprint in the free part; lengths in cells."""
    best: tuple[float, tuple[int, int], float] | None = None
    for turn in np.arange(DIRECTIONS) * np.pi / DIRECTIONS:
        fits = cv2.erode(free, _footprint(length, width, turn), borderType=cv2.BORDER_CONSTANT, borderValue=0)
        rows, columns = np.nonzero(fits)
        if not len(rows):
            continue
        away = np.hypot(columns - wanted[0], rows - wanted[1])
        k = int(np.argmin(away))
        if best is None or away[k] < best[0] - EQUALLY_NEAR_M / PLAN_CELL_M:
            best = float(away[k]), (int(columns[k]), int(rows[k])), float(turn)
    return None if best is None else best[1:]


def _footprint(length: float, width: float, turn: float) -> UInt8Array:
    """Return the cells of a rotated rectangle as a mask with an odd number of rows and columns."""
    reach = int(np.ceil(np.hypot(length, width) / 2.0))
    x, y = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    along, across = x * np.cos(turn) + y * np.sin(turn), -x * np.sin(turn) + y * np.cos(turn)
    return np.asarray((np.abs(along) <= length / 2.0) & (np.abs(across) <= width / 2.0), np.uint8)
