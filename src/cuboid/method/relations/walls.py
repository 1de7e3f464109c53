"""Walls: wide vertical planes among the points of a map without an object."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.results import MapPoints, Wall
from cuboid.ground.core.tolerances import BIAS_M, DRIFT_M
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.fit import plane_axes

# Points are thinned to one per cube of this side, metres, so that the number of points of a plane gives its area.
WALL_CELL_M = 0.03
# Minimum seen area of a wall, square metres, and minimum height, metres: the sides of objects are smaller.
MIN_AREA_M2, MIN_HEIGHT_M = 0.3, 0.4
# Step between tested directions of walls, radians: at two metres from the centre, half a step is an error of `DRIFT_M`.
WALL_STEP_RAD = np.radians(1.5)
# Largest number of walls of a map.
MAX_WALLS = 12
# Points within this distance of a wall, metres, belong to it: skirtings, frames, folds of a curtain.
THICK_M = 0.15
# Minimum fraction of seen cells within the outline of a wall: points of several objects that lie in one plane by chance
# fill less.
MIN_FILLED = 0.3
Numbers = npt.NDArray[np.int64]


def find_walls(points: MapPoints, up: Float64Array | None) -> tuple[Wall, ...]:
    """Find the walls of a map, the largest first.

    Parameters
    ----------
    points : MapPoints
    up : (3,) float64 or None
        Up in the world; None if it is unknown, and then no wall is found.
    """
    if up is None:
        return ()
    ground = np.column_stack(plane_axes(up))
    xyz = points.xyz[points.label == 0].astype(np.float64)
    local = thinned(np.column_stack([xyz @ ground, xyz @ up]))
    middle = local.mean(0) if len(local) else np.zeros(3)
    found: list[Wall] = []
    while len(found) < MAX_WALLS and len(local) * WALL_CELL_M**2 >= MIN_AREA_M2:
        across, at = _fullest(local)
        near = np.abs(local[:, :2] @ across - at) <= DRIFT_M
        if near.sum() * WALL_CELL_M**2 < MIN_AREA_M2:
            break
        across, at = _fitted(local[near], across)
        near = np.abs(local[:, :2] @ across - at) <= DRIFT_M
        if _is_wall(local[near], across):
            found.append(_wall(local[near], across, at, np.column_stack([ground, up]), middle))
            near = np.abs(local[:, :2] @ across - at) <= THICK_M
        local = local[~near]
    return tuple(found)


def thinned(local: Float64Array) -> Float64Array:
    """Return one of the points (N, 3) for each cube of side `WALL_CELL_M`."""
    return local[cubes_of(local)[0]]


def cubes_of(local: Float64Array) -> tuple[Numbers, Numbers]:
    """Return the first point of (N, 3) in each cube of side `WALL_CELL_M`, (M,), and the cube of each point, (N,)."""
    cells = np.floor(local / WALL_CELL_M).astype(np.int64)
    cells -= cells.min(axis=0, initial=0)
    numbers = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0, initial=0) + 1))
    _, first, cube = np.unique(numbers, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return first[order], place[cube.ravel()]


def _fullest(local: Float64Array) -> tuple[Float64Array, float]:
    """Return the horizontal direction (2,), and the distance along it, of the slab with the most points."""
    best = 0, np.array([1.0, 0.0]), 0.0
    for angle in np.arange(0.0, np.pi, WALL_STEP_RAD):
        across = np.array([np.cos(angle), np.sin(angle)])
        slab = np.floor(local[:, :2] @ across / DRIFT_M).astype(np.int64)
        counts = np.bincount(slab - slab.min())
        most = int(np.argmax(counts))
        if counts[most] > best[0]:
            best = int(counts[most]), across, (most + slab.min() + 0.5) * DRIFT_M
    return best[1], float(best[2])


def _fitted(local: Float64Array, across: Float64Array) -> tuple[Float64Array, float]:
    """Return the horizontal normal and the distance of the vertical least-squares plane through points."""
    center = local[:, :2].mean(0)
    least = np.linalg.svd(local[:, :2] - center, full_matrices=False)[2][1]
    least = least if least @ across >= 0.0 else -least
    return least, float(center @ least)


def _is_wall(local: Float64Array, across: Float64Array) -> bool:
    """Return whether points of a vertical plane cover enough of it."""
    along = local[:, :2] @ np.array([-across[1], across[0]])
    wide, high = (np.ptp(np.quantile(values, [0.02, 0.98])) for values in (along, local[:, 2]))
    cells = np.unique(np.floor(np.column_stack([along, local[:, 2]]) / WALL_CELL_M).astype(np.int64), axis=0)
    area = len(cells) * WALL_CELL_M**2
    return bool(area >= MIN_AREA_M2 and high >= MIN_HEIGHT_M and area >= MIN_FILLED * wide * high)


def _wall(local: Float64Array, across: Float64Array, at: float, frame: Float64Array, middle: Float64Array) -> Wall:
    """Return the wall of points along the columns of `frame` (3, 3); its normal points to the centre of the map."""
    direction = np.array([-across[1], across[0]])
    along = local[:, :2] @ direction
    (left, right), (low, high) = (np.quantile(values, [0.02, 0.98]) for values in (along, local[:, 2]))
    corners = [[*(at * across + a * direction), h] for a, h in ((left, low), (right, low), (right, high), (left, high))]
    sign = 1.0 if middle[:2] @ across >= at else -1.0
    normal = frame[:, :2] @ across * sign
    return Wall(normal, -sign * at, np.array(corners) @ frame.T)


def depths_of_contact(boxes: Sequence[Box], wall: Wall) -> tuple[Float64Array, Float64Array]:
    """Return the distances of boxes from a wall, and the depths of their centres within its width, metres, (N,)."""
    center = np.array([box.center for box in boxes])
    reach = np.array([np.abs(wall.normal @ box.rotation) @ box.size / 2.0 for box in boxes])
    gap = center @ wall.normal + wall.offset - reach
    # A box in front of the wall reaches behind it by at most the errors of both.
    gap = np.where(gap >= -DRIFT_M - BIAS_M, np.maximum(gap, 0.0), np.inf)
    begin, end = wall.extent[0], wall.extent[1]
    along = (end - begin) / max(float(np.linalg.norm(end - begin)), 1e-9)
    place = (center - begin) @ along
    return gap, np.minimum(place, float(np.linalg.norm(end - begin)) - place)
