"""Whose voxel is it: clusters of the map are given to objects, contested ones shared out, twins merged, parts split."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from cuboid.heatmap.voxel_map import Rows, VoxelMap
from cuboid.objects.entry import MapObject

# An object has a say in a cluster when it owns this many of its voxels, and this share of the cluster or of its own.
SAY_VOXELS, SAY_SHARE = 5, 0.05
# Two objects touch as one when this share of the smaller one's voxels lies at the other.
CONTACT_SHARE = 0.12


@dataclass(frozen=True, slots=True)
class Piece:
    """Voxels of one cluster that belong to one object; `owner` is 0 for an object yet to be."""

    owner: int
    rows: Rows
    plane: int


def owners_of(rows: Rows, voxels: VoxelMap, objects: dict[int, MapObject]) -> list[int]:
    """Return the objects that have a say in a cluster, the one with the most voxels first."""
    owner = voxels.owner[rows]
    numbers, counts = np.unique(owner[owner > 0], return_counts=True)
    has_say = [
        (-int(count), int(number))
        for number, count in zip(numbers, counts, strict=True)
        if count >= SAY_VOXELS
        and count >= SAY_SHARE * min(len(rows), len(objects[int(number)].rows))
    ]
    return [number for _, number in sorted(has_say)]


def share_out(rows: Rows, owners: list[int], voxels: VoxelMap) -> list[Rows]:
    """Divide a contested cluster: every voxel goes to the owner of the nearest owned one."""
    held = voxels.owner[rows]
    known = np.isin(held, owners)
    points = voxels.xyz(rows)
    if not known.all():
        _, nearest = cKDTree(points[known]).query(points[~known])
        held = held.copy()
        held[~known] = held[known][nearest]
    return [rows[held == number] for number in owners]


def contact(a: npt.NDArray[np.float32], b: npt.NDArray[np.float32], voxel_m: float) -> float:
    """Return the share of the smaller point set (N, 3) that lies within a voxel's diagonal of the other."""
    small, large = (a, b) if len(a) <= len(b) else (b, a)
    distance, _ = cKDTree(large).query(small, distance_upper_bound=1.75 * voxel_m)
    return float(np.count_nonzero(np.isfinite(distance))) / max(1, len(small))


def gap_m(a: npt.NDArray[np.float32], b: npt.NDArray[np.float32]) -> float:
    """Return the least distance between two point sets (N, 3), metres."""
    distance, _ = cKDTree(b).query(a)
    return float(distance.min())
