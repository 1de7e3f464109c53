"""Criteria for retiring an object: no evidence for it is left."""

from __future__ import annotations

from collections.abc import Iterable

from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS
from cuboid.method.objects.entry import MapObject, ObjectWithoutDepth

# A candidate is retired after frames in a row of this weight that show it and have no proposal of it: two viewpoints, or
# two thirds of a second from one.
MAX_MISSED = 2.0
# Log-odds below which a candidate without depth is retired: a false detection seldom repeats.
UNLIKELY_LOG_ODDS_WITHOUT_DEPTH = -1.0


def abandoned(objects: Iterable[MapObject], voxels: VoxelMap) -> list[MapObject]:
    """Return the candidates among some objects that proposals do not show any more, or whose points others took."""
    candidates = [o for o in objects if not o.label]
    has_points = voxels.stored.have_rows([o.number for o in candidates], [MIN_READINGS] * len(candidates))
    return [o for o, has in zip(candidates, has_points, strict=True) if o.missed >= MAX_MISSED or not has]


def is_unlikely(entry: ObjectWithoutDepth) -> bool:
    """Return whether the evidence against an object without depth is certain, or for a candidate, strong."""
    return entry.log_odds <= (-CERTAIN_LOG_ODDS if entry.label else UNLIKELY_LOG_ODDS_WITHOUT_DEPTH)
