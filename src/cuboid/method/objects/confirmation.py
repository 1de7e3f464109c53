"""Criteria for confirming a candidate."""

from __future__ import annotations

from collections.abc import Iterable

from cuboid.ground.core.config import TrackerConfig
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS
from cuboid.method.objects.entry import MapObject, ObjectWithoutDepth
from cuboid.method.objects.validity import fits_object

# From this fraction of readings in its rectangle on, an object counts as seen by depth.
READ_FRACTION = 0.5
# Hits required for the label of an object without depth: two may come from a reflection.
MIN_HITS = 3
# An object of regions replaces labelled objects whose probabilities are lower by at least this: about the calibration
# error of both.
MIN_LEAD = 0.1


def is_confirmable(entry: MapObject, config: TrackerConfig) -> bool:
    """Return whether a candidate is probably one whole thing and has the size of an object.

    Parameters
    ----------
    entry : MapObject
    config : TrackerConfig
        Sizes of objects, and the smallest probability of an object with a label.
    """
    return len(entry.points) > 0 and entry.probability >= config.min_probability and fits_object(entry.box, config)


def prevails(entry: ObjectWithoutDepth, rivals: Iterable[MapObject], config: TrackerConfig) -> bool:
    """Return whether regions of several views agree that an object is one whole thing, clearly more so than its rivals.

    Parameters
    ----------
    entry : ObjectWithoutDepth
    rivals : iterable of MapObject
        Labelled objects that own its pixels.
    config : TrackerConfig
    """
    least = max(config.region_probability, config.min_probability)
    return entry.hits >= MIN_HITS and entry.score >= least and leads(entry.score, rivals)


def leads(probability: float, rivals: Iterable[MapObject]) -> bool:
    """Return whether a probability is clearly higher than those of all rivals."""
    return all(probability >= rival.score + MIN_LEAD for rival in rivals)


def is_certain(entry: ObjectWithoutDepth) -> bool:
    """Return whether an object without depth certainly exists, and depth does not show it."""
    return entry.log_odds >= CERTAIN_LOG_ODDS and entry.hits >= MIN_HITS and entry.read < READ_FRACTION
