"""Criteria for confirming a candidate."""

from __future__ import annotations

from cuboid.ground.core.config import TrackerConfig
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS
from cuboid.method.objects.entry import MapObject, ObjectWithoutDepth
from cuboid.method.objects.validity import fits_object

# From this fraction of readings in its rectangle on, an object counts as seen by depth.
READ_FRACTION = 0.5
# Hits required for the label of an object without depth: two may come from a reflection.
MIN_HITS = 3


def is_confirmable(entry: MapObject, config: TrackerConfig) -> bool:
    """Return whether a candidate is probably one whole thing and has the size of an object.

    Parameters
    ----------
    entry : MapObject
    config : TrackerConfig
        Sizes of objects, and the smallest probability of an object with a label.
    """
    return len(entry.points) > 0 and entry.probability >= config.min_probability and fits_object(entry.box, config)


def is_repeated(entry: ObjectWithoutDepth, config: TrackerConfig) -> bool:
    """Return whether regions of several views agree that an object without voxels is one whole thing."""
    return entry.hits >= MIN_HITS and entry.score >= max(config.region_probability, config.min_probability)


def is_certain(entry: ObjectWithoutDepth) -> bool:
    """Return whether an object without depth certainly exists, and depth does not show it."""
    return entry.log_odds >= CERTAIN_LOG_ODDS and entry.hits >= MIN_HITS and entry.read < READ_FRACTION
