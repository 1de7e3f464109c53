"""Structure: an object that continues beyond its box into a surface outside all objects is a part of that surface."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float32Array, UInt8Array
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.tolerances import DRIFT_M
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.kernels.extents import beyond_sides
from cuboid.method.heatmap.voxel_map import VoxelMap

# Points within SIDE_VOXELS of a side of the box belong to that side; the side continues if there are points at one of
# the distances BEYOND_VOXELS beyond it (unit: voxels).
SIDE_VOXELS = 2.0
BEYOND_VOXELS = SIDE_VOXELS + np.arange(3)


def continues(box: Box, points: Float32Array, voxels: VoxelMap, owned: UInt8Array) -> tuple[bool, int]:
    """Return whether an object's top continues into structure, and how many of its four other sides do.

    Parameters
    ----------
    box : Box
    points : (N, 3) float32
        Points of the object.
    voxels : VoxelMap
    owned : (M,) uint8
        1 for each object number whose voxels are not structure.
    """
    points = np.ascontiguousarray(points[:: 1 + len(points) // SAMPLE_POINTS])
    beyond_m = BEYOND_VOXELS * voxels.voxel_m
    places, counts = np.empty((5 * len(beyond_m) * len(points), 3)), np.empty(5, np.int64)
    # Lower points lie beside the surface on which the object stands.
    bottom_m, side_m = DRIFT_M - box.size[2] / 2, SIDE_VOXELS * voxels.voxel_m
    rotation = np.ascontiguousarray(box.rotation)
    found = beyond_sides(points, box.center, rotation, bottom_m, side_m, beyond_m, places, counts)
    if found == 0:
        return False, 0
    owner = voxels.owner_at(places[:found])
    foreign = (owner >= 0) & ~owned[np.maximum(owner, 0)].astype(bool)
    goes_on = foreign.reshape(-1, len(beyond_m)).any(1)
    # A side continues if at least half of its points have surface beyond it.
    top, *sides = np.add.reduceat(goes_on, np.cumsum(counts) - counts, dtype=np.int64) >= 0.5 * counts
    return bool(top), int(sum(sides))
