"""Criteria for confirming a candidate: its sides end, its size fits, and it is not a part of another object."""

from __future__ import annotations

import numpy as np

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.tolerances import DRIFT_M, OUTLIER_FRACTION
from cuboid.method.boxes.quantiles import quantile
from cuboid.method.objects.affinity import CERTAIN_LOG_ODDS
from cuboid.method.objects.distances import touch
from cuboid.method.objects.entry import MapObject, ObjectWithoutDepth
from cuboid.method.objects.outline import OWN_FRACTION, enclosed, ends_above, ends_beside
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.validity import fits_object
from cuboid.method.objects.visibility import MAX_COLOR_DIFFERENCE
from cuboid.method.surfaces.kernels.outlines import BOTTOM, CONTACT, FREE, LEFT, RIGHT, SUPPORT, TOP
from cuboid.method.surfaces.planes import PlaneTracker

# An object with a free top may be the foot of another one only if it has at most this fraction of the other's height.
FOOT_FRACTION = 0.5
# A side of the outline ends in free space if more than this fraction of it is free.
FREE_SIDE_FRACTION = 0.5
# Whether two touching objects are separate is undecided while the log-odds that they are two are below this.
UNSURE = 1.1
# From this fraction of readings in its rectangle on, an object counts as seen by depth.
READ_FRACTION = 0.5
# Hits required for the label of an object without depth: two may come from a reflection.
MIN_HITS = 3


def is_confirmable(entry: MapObject, store: ObjectStore, planes: PlaneTracker, config: TrackerConfig) -> bool:
    """Return whether a candidate is complete, has a box of the size of an object, and is not a part of another object.

    Parameters
    ----------
    entry : MapObject
    store : ObjectStore
        The store that contains it.
    planes : PlaneTracker
        The planes on which it may stand.
    config : TrackerConfig
        Sizes of objects.
    """
    return (
        len(entry.points) > 0
        and not entry.holder
        and not entry.supports_plane
        # The part beyond the image border may be as large again, as at the rim of a table.
        and enclosed(
            entry.outline, cut_off=2.0 * entry.box.size.max() <= config.max_size_m, beside=_is_beside(entry, store)
        )
        and not _floats(entry, planes)
        and not planes.has_plane_on_top(entry.box)
        and fits_object(entry.box, config)
        and not _may_be_foot(entry, store, planes)
        and not _may_be_end(entry, store, planes)
        and not _may_be_part(entry, store)
        and not _may_be_rim(entry, planes)
    )


def is_certain(entry: ObjectWithoutDepth) -> bool:
    """Return whether an object without depth certainly exists, and depth does not show it."""
    return entry.log_odds >= CERTAIN_LOG_ODDS and entry.hits >= MIN_HITS and entry.read < READ_FRACTION


def _is_beside(entry: MapObject, store: ObjectStore) -> bool:
    """Return whether frames have shown an object beside a labelled one and probably separate from it."""
    return any(
        other.confirmed
        for other in store.all_of(store.affinity.partners(entry.number, max_log_odds=-CERTAIN_LOG_ODDS / 2.0))
    )


def _floats(entry: MapObject, planes: PlaneTracker) -> bool:
    """Return whether an object hangs in the air: higher above its plane than its longest side, with air beneath."""
    plane = planes.find(entry.plane)
    if plane is None:
        return False
    beneath = entry.outline[BOTTOM]
    return bool(
        entry.box.foot_m(*planes.in_world(plane)) > entry.box.size.max()
        and beneath[FREE] > beneath[SUPPORT] + beneath[CONTACT]
    )


def _may_be_foot(entry: MapObject, store: ObjectStore, planes: PlaneTracker) -> bool:
    """Return whether an object may be the foot of a higher object that it touches.

    Its top then always ends at another object, or one side continues behind one: the pot of a plant ends above at the
    plant; the brim of a cap has one side behind the cap. An object with a free top that is more than half as high as
    the other one is not a foot.
    """
    plane = planes.find(entry.plane)
    above = ends_above(entry.outline)
    if plane is None or (above and ends_beside(entry.outline)):
        return False
    normal, offset = planes.in_world(plane)
    top = quantile(entry.points @ normal, 1.0 - 2.0 * OUTLIER_FRACTION) + offset
    min_top = max(top + DRIFT_M, top / FOOT_FRACTION if above else 0.0)
    sampled = entry.points[:: 1 + len(entry.points) // SAMPLE_POINTS]
    return any(
        len(other.points) > 0
        and quantile(other.points @ normal, 1.0 - 2.0 * OUTLIER_FRACTION) + offset > min_top
        and (touch(entry.points, other.points, DRIFT_M) or other.box.contains(sampled, DRIFT_M).any())
        for other in store.neighbours(entry)
    )


def _may_be_end(entry: MapObject, store: ObjectStore, planes: PlaneTracker) -> bool:
    """Return whether an object may be the end of a larger object, such as the spout of a teapot.

    Its foot does not show, it has little height of its own, and a larger object beside it has its color. Grey is the
    color of too many objects to be evidence.
    """
    plane, color = planes.find(entry.plane), entry.mean_color
    if plane is None or np.ptp(color) <= MAX_COLOR_DIFFERENCE:
        return False
    normal, offset = planes.in_world(plane)
    height = entry.points @ normal + offset
    low, high = quantile(height, 2.0 * OUTLIER_FRACTION), quantile(height, 1.0 - 2.0 * OUTLIER_FRACTION)
    if low <= DRIFT_M or high - low > OWN_FRACTION * high:
        return False
    return any(
        other.log_odds > 0.0
        and other.box.size.prod() > entry.box.size.prod()
        # An object that has no box yet may have any color.
        and (not len(other.points) or np.abs(other.mean_color - color).max() <= MAX_COLOR_DIFFERENCE)
        for other in store.all_of(store.affinity.partners(entry.number))
    )


def _may_be_part(entry: MapObject, store: ObjectStore) -> bool:
    """Return whether an object may be a part of a labelled one: frames do not agree yet that two touching ones are two.

    Objects that overlap in space may be one, too: two solids cannot overlap.
    """
    labelled = [other for other in store.neighbours(entry) if other.confirmed]
    if not labelled:
        return False
    unsure = set(store.affinity.partners(entry.number, min_log_odds=-UNSURE))
    if any(other.number in unsure and touch(entry.points, other.points, DRIFT_M) for other in labelled):
        return True
    return bool(store.overlapping([entry], labelled).any())


def _may_be_rim(entry: MapObject, planes: PlaneTracker) -> bool:
    """Return whether an object may be the raised rim of its plane, as the lip of a shelf.

    It is then no higher than drift, and ends where its plane ends on more than one of three sides. Around any other
    object of this height the plane continues.
    """
    if planes.find(entry.plane) is None or entry.box.size[2] > DRIFT_M:
        return False
    sides = entry.outline[[TOP, LEFT, RIGHT]]
    return bool(np.count_nonzero(sides[:, FREE] > FREE_SIDE_FRACTION * sides.sum(1)) > 1)
