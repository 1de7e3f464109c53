"""What is furniture: the lids of boxes are no supporting planes, and what holds a plane up is no object."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cuboid.frame import Float64Array
from cuboid.surfaces.plane import Plane

# The top of a box: smaller than this, square metres, at most so high above the plane that the box stands on, metres,
# and that plane so many times as large; it is above that plane from so far on. Seats, shelves and stools are larger or
# higher.
LID_AREA_M2, LID_HEIGHT_M, LID_RATIO, LID_ABOVE_M = 0.2, 0.3, 3.0, 0.02
# A cluster that comes this close below another plane, metres, is what holds that plane up: its rim, its legs.
RIM_DEPTH_M = 0.035
# Under a plane this far above theirs, metres, things that reach this share of the way up are legs or panels, and so
# are those at most so wide, metres, that are so many times as high.
TABLE_CLEARANCE_M, LEG_REACH, LEG_WIDTH_M, LEG_SLENDER = 0.4, 0.6, 0.13, 2.5
# Under a board less high above: what reaches this share of the way up and is as long as a square of the board's area;
# and what reaches this share and is at least so wide, metres.
SPAN_REACH, BACK_REACH, BACK_WIDTH_M = 0.5, 0.75, 0.25
# What lies under a board does so with this share of its points.
UNDER_SHARE = 0.8


def is_lid(plane: Plane, area_m2: float, others: Iterable[Plane]) -> bool:
    """Tell whether a plane of this area is the top of an object: small, and not high above a far larger plane."""
    if area_m2 >= LID_AREA_M2:
        return False
    center = plane.mean[None]
    return any(
        other.in_use
        and LID_ABOVE_M < float(other.height(center)[0]) <= LID_HEIGHT_M
        and other.plan.area_m2() >= LID_RATIO * area_m2
        and bool(other.plan.covers(center)[0])
        for other in others
        if other is not plane
    )


def holds_up(
    plan_points: Float64Array, plane: Plane, others: Iterable[Plane], clearance_m: float = RIM_DEPTH_M
) -> bool:
    """Tell whether a cluster of points (N, 3) of the plan frame holds up another plane than the one it stands on.

    It does when one in 25 of its points, or twenty, lie just below a plane at least so far above and under it or at its
    rim; and when it stands under a table and reaches most of the way up, or is slender as a leg whose top is hidden;
    and when it fills a shelf from side to side, or is wide and reaches almost to the next board: the shelf's back.
    """
    foot = plane.height(plan_points)
    middle = plan_points.mean(0)[None]
    for other in others:
        clearance = float(plane.height(middle)[0] - other.height(middle)[0])
        if other is plane or not other.in_use or clearance < clearance_m:
            continue
        height = other.height(plan_points)
        beside = (height > -RIM_DEPTH_M) & (height < 0.5 * RIM_DEPTH_M)
        enough = min(20, max(4, len(plan_points) // 25))
        # What a plane covers is asked only of points that matter: it takes the most time here.
        if np.count_nonzero(beside) >= enough and other.plan.covers(plan_points[beside]).sum() >= enough:
            return True
        wide, high = float(np.ptp(plan_points[:, :2], axis=0).max()), float(foot.max())
        if clearance >= TABLE_CLEARANCE_M:
            fits = high >= LEG_REACH * clearance or (wide <= LEG_WIDTH_M and high >= LEG_SLENDER * wide)
        else:
            spans = high >= SPAN_REACH * clearance and wide**2 >= other.plan.area_m2()
            fits = spans or (high >= BACK_REACH * clearance and wide >= BACK_WIDTH_M)
        if fits and other.plan.covers(plan_points).mean() >= 0.5:
            return True
    return False


def under_board(plan_points: Float64Array, plane: Plane, others: Iterable[Plane]) -> bool:
    """Tell whether most points (N, 3) of the plan frame above a plane lie under another one, as low as a shelf's."""
    middle = plan_points.mean(0)[None]
    for other in others:
        clearance = float(plane.height(middle)[0] - other.height(middle)[0])
        if other is plane or not other.in_use or not RIM_DEPTH_M < clearance < TABLE_CLEARANCE_M:
            continue
        if other.plan.covers(plan_points).mean() >= UNDER_SHARE:
            return True
    return False
