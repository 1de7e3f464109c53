"""Is a candidate a whole object: its sides were seen to end, it has the size of one, and is no part of another."""

from __future__ import annotations

from cuboid.boxes.quantiles import quantile
from cuboid.config import TrackerConfig
from cuboid.geometry.distances import touch
from cuboid.kernels.outlines import BOTTOM, CONTACT, FREE, SUPPORT
from cuboid.objects.entry import MapObject
from cuboid.objects.outline import enclosed, ends_above
from cuboid.objects.store import ObjectStore
from cuboid.objects.validity import fits_object
from cuboid.surfaces.planes import PlaneTracker
from cuboid.tolerances import DRIFT_M, STRAYS

# Frames do not agree on two objects that touch while the log-odds that they are two are below this.
UNSURE = 1.1


def is_whole(entry: MapObject, store: ObjectStore, planes: PlaneTracker, config: TrackerConfig) -> bool:
    """Tell whether a candidate has a box, and is a whole object: all of it, of the size of one, no part of another.

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
        and enclosed(entry.outline)
        and not _floats(entry, planes)
        and not planes.lies_on(entry.box)
        and fits_object(entry.box, config)
        and not _may_be_foot(entry, store, planes)
        and not _may_be_part(entry, store)
    )


def _floats(entry: MapObject, planes: PlaneTracker) -> bool:
    """Tell whether an object hangs in the air: higher above its plane than it is long, air beneath."""
    plane = None if entry.plane is None else planes.find(entry.plane)
    if plane is None:
        return False
    beneath = entry.outline[BOTTOM]
    return bool(
        entry.box.foot_m(*planes.in_world(plane)) > entry.box.size.max()
        and beneath[FREE] > beneath[SUPPORT] + beneath[CONTACT]
    )


def _may_be_foot(entry: MapObject, store: ObjectStore, planes: PlaneTracker) -> bool:
    """Tell whether an object always ends above at another thing of its depth, and touches one that goes up higher.

    It may be the foot of that: the brim of a cap, the pot of a plant.
    """
    plane = None if entry.plane is None else planes.find(entry.plane)
    if plane is None or ends_above(entry.outline):
        return False
    normal, _ = planes.in_world(plane)
    top = quantile(entry.points @ normal, 1.0 - 2.0 * STRAYS) + DRIFT_M
    return any(
        len(other.points) > 0
        and quantile(other.points @ normal, 1.0 - 2.0 * STRAYS) > top
        and touch(entry.points, other.points, DRIFT_M)
        for other in store.neighbours(entry)
    )


def _may_be_part(entry: MapObject, store: ObjectStore) -> bool:
    """Tell whether an object may be a part of a labelled one: frames do not agree yet that two which touch are two.

    Or they share room, which no two solids do.
    """
    labelled = [other for other in store.neighbours(entry) if other.confirmed]
    if not labelled:
        return False
    unsure = set(store.affinity.partners(entry.number, least=-UNSURE))
    if any(other.number in unsure and touch(entry.points, other.points, DRIFT_M) for other in labelled):
        return True
    return bool(store.share_room([entry], labelled).any())
