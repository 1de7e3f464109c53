"""What carries a thing: its plane, what it stands on top of; or nothing, and then what it touches holds it."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from cuboid.boxes.hidden import ground_seen
from cuboid.boxes.quantiles import quantile
from cuboid.frame import Float64Array
from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.objects.entry import MapObject
from cuboid.tolerances import DRIFT_M, JUMP_M, LEAST_READINGS, MOST, SAMPLE, SOME, STRAYS

# Nothing stands where so many of nine voxels of the ground around were seen: beside what stands, half of them are.
MOST_OF_NINE = math.ceil(9 * MOST)


def holder_of(
    entry: MapObject, normal: Float64Array, offset: float, others: Iterable[MapObject], voxels: VoxelMap
) -> int:
    """Return the number of the object that holds another one, which nothing carries from below; 0 where there is none.

    A solid is carried by its plane, or stands on top of another one. One whose foot is above the plane and lower than
    the top of what it touches does neither: what it touches holds it, as a pot its spout and the plant in it. What is
    beneath has to be known: the plane, seen below it, or the room of the other one. Else its foot may be hidden.

    Parameters
    ----------
    entry : MapObject
        With its points.
    normal : (3,) float64
        Of the plane beneath, unit, up.
    offset : float
        The plane is normal.p + offset = 0.
    others : iterable of MapObject
        Those nearby.
    voxels : VoxelMap
    """
    points = entry.points.astype(np.float64)
    height = points @ normal + offset
    foot = quantile(height, 2.0 * STRAYS)
    if foot <= DRIFT_M:
        return 0
    # What could carry it would be beneath its lowest part.
    low = np.flatnonzero(height <= foot + DRIFT_M)
    low = low[:: 1 + len(low) // SAMPLE]
    points, height, bare = points[low], height[low], None
    best, holder = 0, 0
    for other in others:
        if len(other.points) < LEAST_READINGS:
            continue
        theirs = other.points @ normal + offset
        if quantile(theirs, 2.0 * STRAYS) >= foot or quantile(theirs, 1.0 - 2.0 * STRAYS) <= foot + JUMP_M:
            continue
        touches = _touching(entry.points, other.points, DRIFT_M)
        if touches <= best:
            continue
        if bare is None:
            bare = ground_seen(points - np.outer(height, normal), normal, voxels, MOST_OF_NINE)
        inside = (np.abs((points - other.box.center) @ other.box.rotation) <= other.box.size / 2.0)[:, :2].all(1)
        if (bare | inside).mean() >= 1.0 - SOME:
            best, holder = touches, other.number
    return holder


def _touching(a: npt.NDArray[np.float32], b: npt.NDArray[np.float32], limit_m: float) -> int:
    """Return how many of the points (N, 3) are that near to others (M, 3)."""
    for _ in range(2):
        if len(a) == 0 or len(b) == 0:
            return 0
        a, b = b[((b > a.min(0) - limit_m) & (b < a.max(0) + limit_m)).all(1)], a
    if len(a) == 0:
        return 0
    distance, _ = cKDTree(b).query(a, distance_upper_bound=limit_m)
    return int(np.isfinite(distance).sum())
