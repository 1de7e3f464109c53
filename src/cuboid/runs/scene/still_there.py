"""Whether an old object is still in its place, whichever objects its points belong to now."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.runs.scene.before import OldObject

# An object is still there if at least SAME_PLACE of its points are seen again, and less than CHANGED of them are
# carved. In synthetic visits, nine tenths of the points of unmoved objects are seen again, and less than a tenth is
# carved.
SAME_PLACE, CHANGED = 0.6, 0.15
# A point is seen again if a frame saw a surface in its voxel or in a neighbouring one; its own voxel comes first.
NEIGHBOURS = np.array(sorted(np.ndindex(3, 3, 3), key=lambda k: (np.abs(np.array(k) - 1).sum(), k))) - 1


@dataclass(frozen=True, slots=True)
class StillThere:
    """The result of looking for an old object's points at a later visit.

    Attributes
    ----------
    still : bool
        Whether the object is still in its place.
    owners : (N,) int32
        Number of the object that each point belongs to now, 0 for none.
    """

    still: bool
    owners: npt.NDArray[np.int32]


def still_there(voxels: VoxelMap, old: OldObject, first_frame: int) -> StillThere:
    """Return whether an object is still there, and the present owners of its points.

    Parameters
    ----------
    voxels : VoxelMap
    old : OldObject
    first_frame : int
        Only surfaces seen in this frame or a later one count as seen again.
    """
    places = old.points.astype(np.float64) + voxels.voxel_m * NEIGHBOURS[:, None]
    rows = voxels.rows_at(places.reshape(-1, 3)).reshape(len(NEIGHBOURS), -1)
    again = (rows >= 0) & voxels.stored.seen_since(rows, first_frame)
    owner = np.where(again, voxels.stored.owner[rows], 0)
    first = np.argmax(owner > 0, axis=0)
    carved = float((rows[0] < 0).mean())
    still = float(again.any(0).mean()) >= SAME_PLACE and carved < CHANGED
    return StillThere(still, owner[first, np.arange(owner.shape[1])])


def fraction_near(points: Float32Array, others: Float32Array, within_m: float) -> float:
    """Return the fraction of points (N, 3) with another point (M, 3) within a distance, metres."""
    from scipy.spatial import cKDTree

    if len(points) == 0 or len(others) == 0:
        return 0.0
    distance, _ = cKDTree(others).query(points, distance_upper_bound=within_m)
    return float(np.isfinite(distance).mean())
