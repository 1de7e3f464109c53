"""Criteria for retiring an object: no evidence for it is left."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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


def abandoned(objects: Iterable[MapObject], voxels: VoxelMap) -> list[MapObject]:
    """Return the candidates among some objects that proposals do not show any more, or whose points others took."""
    candidates = [o for o in objects if not o.label]
    has_points = voxels.stored.have_rows([o.number for o in candidates], [MIN_READINGS] * len(candidates))
    return [o for o, has in zip(candidates, has_points, strict=True) if o.missed >= MAX_MISSED or not has]


def is_unlikely(entry: ObjectWithoutDepth) -> bool:
    """Return whether the evidence against an object without depth is certain, or for a candidate, strong."""
    return entry.log_odds <= (-CERTAIN_LOG_ODDS if entry.label else UNLIKELY_LOG_ODDS_WITHOUT_DEPTH)


def carved(objects: Sequence[MapObject], voxels: VoxelMap) -> list[MapObject]:
    """Return the objects among visible ones of which free-space carving removed most points."""
    min_rows = [ceil(REMAINING_FRACTION * len(o.points)) for o in objects]
    has_points = voxels.stored.have_rows([o.number for o in objects], min_rows)
    return [o for o, has in zip(objects, has_points, strict=True) if not has]
