"""Criteria for retiring an object: the evidence is against it, or free-space carving removed its points."""

from __future__ import annotations

from math import ceil

from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS
from cuboid.method.objects.entry import MapObject, ObjectRecord

# Log-odds below which a candidate is retired: with depth, and without depth, where a false detection seldom repeats.
UNLIKELY_LOG_ODDS, UNLIKELY_LOG_ODDS_WITHOUT_DEPTH = -CERTAIN_LOG_ODDS / 2.0, -1.0
# A visible object was taken away if at most this fraction of its points is left. Some points at its foot remain: a ray
# that passes close to a table is like one that hits an object on it.
REMAINING_FRACTION = 0.1


def is_unlikely(entry: ObjectRecord) -> bool:
    """Return whether the evidence against an object is certain, or for a candidate, strong."""
    if entry.label:
        return entry.log_odds <= -CERTAIN_LOG_ODDS
    with_depth = isinstance(entry, MapObject)
    return entry.log_odds <= (UNLIKELY_LOG_ODDS if with_depth else UNLIKELY_LOG_ODDS_WITHOUT_DEPTH)


def is_carved(entry: MapObject, voxels: VoxelMap) -> bool:
    """Return whether free-space carving removed most points of a visible object."""
    return not voxels.stored.has_rows(entry.number, ceil(REMAINING_FRACTION * len(entry.points)))
