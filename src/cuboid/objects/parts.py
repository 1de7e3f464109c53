"""Parts of objects: a handle, a far wall, a brim that was taken for an object of its own."""

from __future__ import annotations

from collections.abc import Callable

from cuboid.objects.entry import MapObject
from cuboid.objects.ownership import bends_around, gap_m

# A part farther from its object than this, metres, is no part of it.
FRAGMENT_GAP_M = 0.04
# A part that bends around its object may be so far from it, as a share of the object's longest side, and in metres.
PART_REACH, PART_REACH_M = 0.5, 0.12
# A part smaller than this share of what it touches (across a seam of two voxels) is no object of its own: a handle.
PART_SHARE, TOUCH_M = 0.2, 0.022
# What bends around an object is its part when it is so small a share of it (a brim's tip), or is this hollow, metres.
STUB_SHARE, HOLLOW_M = 0.08, 0.004


def is_part(entry: MapObject, other: MapObject, verdict: bool | None, stands: Callable[[], bool]) -> bool:
    """Tell whether an object beside another one is a part of it.

    It is when it bends around the other and is hollow or a stub; so much is plain up close, whatever the frames
    say. Else it is none where most frames say that they are two. It is when it floats nearby, when it is small
    and touches, and when it bends or is small and most frames say that they are one. What stands on its own
    foot beside another thing is no part of it, whatever one view of the two takes them for.

    Parameters
    ----------
    entry, other : MapObject
    verdict : bool or None
        Whether most frames say that they are one; None while that is not sure.
    stands : callable
        Tells whether the entry stands on its plane, or may.
    """
    share = len(entry.points) / len(other.points)
    bends, sag_m = bends_around(entry.points, other.points, entry.box.up)
    gap = gap_m(entry.points, other.points, FRAGMENT_GAP_M)
    hollow = sag_m < -HOLLOW_M and (verdict is not False or gap <= FRAGMENT_GAP_M)
    if bends and (hollow or share < STUB_SHARE):
        return True
    if verdict is False:
        return False
    if not stands():
        return bool(verdict) or gap <= FRAGMENT_GAP_M
    if verdict:
        return bends or share < PART_SHARE
    return share < PART_SHARE and gap <= TOUCH_M
