"""How long an object waits for its label: as long as it may be noise, or a part of something else."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cuboid.frame import Float64Array
from cuboid.geometry.overlap import overlap_min_matrix, pack
from cuboid.objects.entry import MapObject
from cuboid.objects.ownership import bends_around, gap_m
from cuboid.objects.parts import FRAGMENT_GAP_M, PART_REACH, PART_REACH_M
from cuboid.objects.validity import rests

# What shows fewer voxels than this (of 1 cm: a side of 8 cm) is often a part, or the noise of an edge.
SMALL_VOXELS, SMALL_PATIENCE = 64, 4
# What floats above its plane, or lies beside an object, may be a part whose link is not seen yet: it is proposed so
# many times as often before it gets a label of its own.
FLOATING_PATIENCE, BESIDE_PATIENCE = 6, 4
# Two whose boxes have this share of the smaller one in common cannot both be whole.
SHARED = 0.3
# So many proposals at least must show it whole: of what the picture's border always cuts nobody knows where it ends.
WHOLE_PROPOSALS = 2


def is_ready(entry: MapObject) -> bool:
    """Tell whether an object without a label may have one: its patience is known and over, and it was seen whole."""
    return not entry.confirmed and 0 < entry.patience <= entry.proposed and entry.whole >= WHOLE_PROPOSALS


def beside(entry: MapObject, alive: Iterable[MapObject]) -> MapObject | None:
    """Return the object that this one may be a part of: a labelled or larger one nearby."""
    for other in alive:
        if other is entry or not (other.confirmed or len(other.points) > len(entry.points)):
            continue
        near = max(FRAGMENT_GAP_M, min(PART_REACH * float(other.box.size.max()), PART_REACH_M))
        reach = 0.5 * float(np.linalg.norm(other.box.size) + np.linalg.norm(entry.box.size))
        if float(np.linalg.norm(other.box.center - entry.box.center)) > reach + near:
            continue
        if gap_m(entry.points, other.points, near) <= near:
            return other
    return None


def patience(
    entry: MapObject, other: MapObject | None, verdict: bool | None, plane: tuple[Float64Array, float] | None
) -> int:
    """Return how many times as many proposals as usual an object takes before it has a label.

    Parameters
    ----------
    entry : MapObject
    other : MapObject or None
        The one that it may be a part of.
    verdict : bool or None
        Whether most frames say that the two are one; None while that is not sure.
    plane : ((3,) float64, float) or None
        Normal and offset of what it stands on.
    """
    times = times_alone(entry, plane)
    if other is not None and (_share_room(entry, other) or (verdict is None and _may_be_one(entry, other))):
        times = max(times, BESIDE_PATIENCE)
    return times


def times_alone(entry: MapObject, plane: tuple[Float64Array, float] | None) -> int:
    """Return how many times as many proposals as usual an object takes that nothing lies beside; see `patience`."""
    times = FLOATING_PATIENCE if not rests(entry.box, plane) else 1
    return max(times, SMALL_PATIENCE) if len(entry.points) < SMALL_VOXELS else times


def _may_be_one(entry: MapObject, other: MapObject) -> bool:
    """Tell whether two near each other may prove to be one: they all but touch, or one bends around the other."""
    near = gap_m(entry.points, other.points, FRAGMENT_GAP_M) <= FRAGMENT_GAP_M
    return near or bends_around(entry.points, other.points, entry.box.up)[0]


def _share_room(entry: MapObject, other: MapObject) -> bool:
    """Tell whether two boxes reach into each other: few frames say that the two walls of a bowl are two things."""
    return float(overlap_min_matrix(pack([entry.box]), pack([other.box]))[0, 0]) >= SHARED
