"""Criteria for retiring an object: no evidence for it is left."""

from __future__ import annotations

from math import ceil

from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS
from cuboid.method.objects.entry import MapObject, ObjectWithoutDepth

# A candidate is retired after this number of frames in a row that show it and have no proposal of it.
MAX_MISSED = 8
# Log-odds below which a candidate without depth is retired: a false detection seldom repeats.
UNLIKELY_LOG_ODDS_WITHOUT_DEPTH = -1.0
# A visible object was taken away if at most this fraction of its points is left. Some points at its foot remain: a ray
# that passes close to a table is like one that hits an object on it.
REMAINING_FRACTION = 0.1


def is_abandoned(entry: MapObject, voxels: VoxelMap) -> bool:
    """Return whether proposals do not show a candidate any more, or others have taken its points."""
    return not entry.label and (entry.missed >= MAX_MISSED or not voxels.stored.has_rows(entry.number, MIN_READINGS))


def is_unlikely(entry: ObjectWithoutDepth) -> bool:
    """Return whether the evidence against an object without depth is certain, or for a candidate, strong."""
    return entry.log_odds <= (-CERTAIN_LOG_ODDS if entry.label else UNLIKELY_LOG_ODDS_WITHOUT_DEPTH)


def is_carved(entry: MapObject, voxels: VoxelMap) -> bool:
    """Return whether free-space carving removed most points of a visible object."""
    return not voxels.stored.has_rows(entry.number, ceil(REMAINING_FRACTION * len(entry.points)))
