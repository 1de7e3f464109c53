"""Criteria for confirming a candidate: its sides end, its size fits, and it is no part of another object."""

from __future__ import annotations

import numpy as np

from cuboid.boxes.quantiles import quantile
from cuboid.core.config import TrackerConfig
from cuboid.core.limits import SAMPLE_POINTS
from cuboid.core.tolerances import DRIFT_M, OUTLIER_FRACTION
from cuboid.objects.affinity import CERTAIN_LOG_ODDS
from cuboid.objects.distances import touch
from cuboid.objects.entry import MapObject
from cuboid.objects.outline import OWN_FRACTION, enclosed, ends_above, ends_beside
from cuboid.objects.store import ObjectStore
from cuboid.objects.validity import fits_object
from cuboid.objects.visibility import ALIKE
from cuboid.surfaces.kernels.outlines import BOTTOM, CONTACT, FREE, LEFT, RIGHT, SUPPORT, TOP
from cuboid.surfaces.planes import PlaneTracker

# An object whose top was seen to end is the foot of another one only if it has at most this fraction of its height.
FOOT_FRACTION = 0.5
# A side of the outline ends in free space when more than this fraction of it does.
FREE_SIDE_FRACTION = 0.5
# Frames do not agree on two objects that touch while the log-odds that they are two are below this.
UNSURE = 1.1


def is_confirmable(entry: MapObject, store: ObjectStore, planes: PlaneTracker, config: TrackerConfig) -> bool:
    """Tell whether a candidate has a box and is a complete object, of the size of one, and no part of another.

    Parameters
    ----------
    entry : MapObject
    store : ObjectStore
        Where it is one of many.
    planes : PlaneTracker
        What it may stand on.
    config : TrackerConfig
        Sizes of objects.
    """
    return (
        len(entry.points) > 0
        and not entry.holder
        and not entry.supports_plane
        # The part beyond the border of the picture may be as large again, as of the rim of a table.
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


def _is_beside(entry: MapObject, store: ObjectStore) -> bool:
    """Tell whether frames have shown an object beside a labelled one, and likely separate from it."""
    return any(
        other.confirmed for other in store.all_of(store.affinity.partners(entry.number, most=-CERTAIN_LOG_ODDS / 2.0))
    )


def _floats(entry: MapObject, planes: PlaneTracker) -> bool:
    """Tell whether an object hangs in the air: higher above its plane than it is long, air beneath."""
    plane = planes.find(entry.plane)
    if plane is None:
        return False
    beneath = entry.outline[BOTTOM]
    return bool(
        entry.box.foot_m(*planes.in_world(plane)) > entry.box.size.max()
        and beneath[FREE] > beneath[SUPPORT] + beneath[CONTACT]
    )


def _may_be_foot(entry: MapObject, store: ObjectStore, planes: PlaneTracker) -> bool:
    """Tell whether an object always ends above at another object, or goes on behind it, and touches one that is higher.

    It may be the foot of that object: the pot of a plant, whose top ends at the plant, or the brim of a cap, with one
    side behind the cap. An object whose top ends by itself, and that is more than half as high, is no such foot.
    """
    plane = planes.find(entry.plane)
    above = ends_above(entry.outline)
    if plane is None or (above and ends_beside(entry.outline)):
        return False
    normal, offset = planes.in_world(plane)
    top = quantile(entry.points @ normal, 1.0 - 2.0 * OUTLIER_FRACTION) + offset
    least = max(top + DRIFT_M, top / FOOT_FRACTION if above else 0.0)
    some = entry.points[:: 1 + len(entry.points) // SAMPLE_POINTS]
    return any(
        len(other.points) > 0
        and quantile(other.points @ normal, 1.0 - 2.0 * OUTLIER_FRACTION) + offset > least
        and (touch(entry.points, other.points, DRIFT_M) or other.box.contains(some, DRIFT_M).any())
        for other in store.neighbours(entry)
    )


def _may_be_end(entry: MapObject, store: ObjectStore, planes: PlaneTracker) -> bool:
    """Tell whether nothing of an object's foot shows, little of its height, and a larger one beside it has its color.

    It may be the end of that object, as the spout of a teapot. Grey is the color of too many things to be evidence.
    """
    plane, color = planes.find(entry.plane), entry.mean_color
    if plane is None or np.ptp(color) <= ALIKE:
        return False
    normal, offset = planes.in_world(plane)
    height = entry.points @ normal + offset
    low, high = quantile(height, 2.0 * OUTLIER_FRACTION), quantile(height, 1.0 - 2.0 * OUTLIER_FRACTION)
    if low <= DRIFT_M or high - low > OWN_FRACTION * high:
        return False
    return any(
        other.log_odds > 0.0
        and other.box.size.prod() > entry.box.size.prod()
        # An object without a box yet may have any color.
        and (not len(other.points) or np.abs(other.mean_color - color).max() <= ALIKE)
        for other in store.all_of(store.affinity.partners(entry.number))
    )


def _may_be_part(entry: MapObject, store: ObjectStore) -> bool:
    """Tell whether an object may be a part of a labelled one: frames do not agree yet that two which touch are two.

    Two solids do not overlap in space either.
    """
    labelled = [other for other in store.neighbours(entry) if other.confirmed]
    if not labelled:
        return False
    unsure = set(store.affinity.partners(entry.number, least=-UNSURE))
    if any(other.number in unsure and touch(entry.points, other.points, DRIFT_M) for other in labelled):
        return True
    return bool(store.overlapping([entry], labelled).any())


def _may_be_rim(entry: MapObject, planes: PlaneTracker) -> bool:
    """Tell whether an object is no higher than drift, and ends where its plane does on more than one of three sides.

    It may be the raised rim of the plane, as the lip of a shelf. Beyond any other object as low the plane goes on.
    """
    if planes.find(entry.plane) is None or entry.box.size[2] > DRIFT_M:
        return False
    sides = entry.outline[[TOP, LEFT, RIGHT]]
    return bool(np.count_nonzero(sides[:, FREE] > FREE_SIDE_FRACTION * sides.sum(1)) > 1)
