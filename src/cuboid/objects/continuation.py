"""What goes on beyond its box into a surface that is no object's is a part of that surface: structure."""

from __future__ import annotations

import numpy as np

from cuboid.frame import UInt8Array
from cuboid.geometry.box import Box
from cuboid.heatmap.stored_points import Rows
from cuboid.heatmap.voxel_map import VoxelMap
from cuboid.tolerances import DRIFT_M, MOST, SAMPLE

# What lies this near a side of the box, voxels, makes that side; it goes on where there are points so far beyond it,
# voxels.
SIDE_VOXELS = 2.0
BEYOND_VOXELS = SIDE_VOXELS + np.arange(3)


def continues(box: Box, rows: Rows, voxels: VoxelMap, owned: UInt8Array) -> tuple[bool, int]:
    """Tell whether an object's top goes on into structure, and how many of its four other sides do.

    Parameters
    ----------
    box : Box
    rows : (N,) int64
        Its voxels.
    voxels : VoxelMap
    owned : (M,) uint8
        1 for each object, by number, that is no structure.
    """
    rows = rows[:: 1 + len(rows) // SAMPLE]
    own = (voxels.xyz(rows).astype(np.float64) - box.center) @ box.rotation
    # What is lower is beside what it stands on.
    own = own[own[:, 2] > DRIFT_M - box.size[2] / 2]
    if len(own) == 0:
        return False, 0
    low, high = own.min(0), own.max(0)
    beyond = []
    for axis, sign in ((2, 1), (0, 1), (0, -1), (1, 1), (1, -1)):
        edge = high[axis] - own[:, axis] if sign > 0 else own[:, axis] - low[axis]
        side = own[edge <= SIDE_VOXELS * voxels.voxel_m]
        step = np.zeros(3)
        step[axis] = sign * voxels.voxel_m
        beyond.append((side[:, None] + BEYOND_VOXELS[:, None] * step).reshape(-1, 3))
    owner = voxels.owner_at(np.concatenate(beyond) @ box.rotation.T + box.center)
    foreign = (owner >= 0) & ~owned[np.maximum(owner, 0)].astype(bool)
    goes_on = foreign.reshape(-1, len(BEYOND_VOXELS)).any(1).astype(np.float64)
    ends = np.cumsum([len(places) // len(BEYOND_VOXELS) for places in beyond])
    top, *sides = (float(side.mean()) >= MOST for side in np.split(goes_on, ends[:-1]))
    return top, sum(sides)


def is_structure(box: Box, rows: Rows, voxels: VoxelMap, owned: UInt8Array) -> bool:
    """Tell whether an object is a part of structure: its top goes on, or more than one of its sides does."""
    top, sides = continues(box, rows, voxels, owned)
    return top or sides > 1
