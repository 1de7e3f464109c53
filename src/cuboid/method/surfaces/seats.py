"""Seats: level patches beside an object, about as long as it, that are a part of it and do not support it."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import cv2
import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.method.surfaces.grid import CELL_M, GroundPlan, Places, cells_of, window_intersection
from cuboid.method.surfaces.plane import REACH_M, Plane

# Largest length of a seat, as a multiple of the length of the object.
LONGEST_SEAT = 1.5


def supporting_plane(
    points: Float64Array, plane: Plane, others: Callable[[], Iterable[Plane]], least_m2: float
) -> Plane:
    """Return the plane that supports an object: the one above which it was seen, or a lower one if that is its seat.

    Of the lower planes, it is the highest that may continue beneath the middle of the object. The object's foot may be
    above it by at most the object's largest extent: otherwise the object would hang in the air.

    Parameters
    ----------
    points : (N, 3) float64
        Points of the object, in the plan frame.
    plane : Plane
    others : callable
        Returns the planes that may be beneath; called only if the object has a seat, which is rare.
    least_m2 : float
        Smallest area of a seat, square metres.
    """
    low, high = points.min(0), points.max(0)
    middle = (low + high)[None] / 2.0
    if plane.plan.covers(middle)[0] or not len(seat_cells(plane.plan, points, least_m2)):
        return plane
    foot = np.append(middle[0, :2], low[2])[None]
    above = float(plane.height(foot)[0]) + REACH_M
    lower = [(float(p.height(foot)[0]), p.index, p) for p in others() if p.in_use and p.plan.near(middle)[0]]
    return min([p for p in lower if above < p[0] <= (high - low).max()], default=(0.0, 0, plane))[2]


def seat_of(points: Float64Array, plane: Plane, others: Iterable[Plane], least_m2: float) -> Float64Array:
    """Return points (N, 3) of the seats of an object that floats above its plane, all in the plan frame.

    See `supporting_plane` for the parameters; `others` are the planes themselves.
    """
    low, high = points.min(0), points.max(0)
    found = [np.zeros((0, 3))]
    for other in others:
        x, y = (seat_cells(other.plan, points, least_m2).T + 0.5) * CELL_M
        z = -(x * other.normal[0] + y * other.normal[1] + other.offset) / other.normal[2]
        places = np.column_stack([x, y, z])
        within = (z > low[2] - REACH_M) & (z < high[2] + REACH_M)
        if other is not plane and within.all() and (plane.height(places) > REACH_M).all():
            found.append(places)
    return np.concatenate(found)


def seat_cells(plan: GroundPlan, points: Float64Array, least_m2: float) -> Places:
    """Return the cells (N, 2) of the pieces of a plane that touch an object in plan and are not much longer than it.

    A piece of `LONGEST_SEAT` times the length or more supports the object, or the object is attached to it.
    """
    cells = cells_of(points)
    low, high = cells.min(0), cells.max(0) + 1
    longest = int(LONGEST_SEAT * (high - low).max())
    window = np.concatenate([low - longest - 1, high + longest + 1])
    plan_part, window_part = window_intersection(plan.window, window)
    measured, occupied = np.zeros((2, *(window[2:] - window[:2])), np.uint8)
    measured[window_part] = plan.seen[plan_part] >= MIN_READINGS
    if np.count_nonzero(measured) * CELL_M**2 < least_m2:
        return np.zeros((0, 2), np.int64)
    occupied[tuple((cells - window[:2]).T)] = 1
    touching = (cv2.dilate(occupied, np.ones((3, 3), np.uint8)) > 0) & (measured > 0)
    if not touching.any():
        return np.zeros((0, 2), np.int64)
    _, labels = cv2.connectedComponents(measured)
    pieces = [np.argwhere(labels == k) for k in np.unique(labels[touching]).tolist()]
    pieces = [p for p in pieces if len(p) * CELL_M**2 >= least_m2 and np.ptp(p, axis=0).max() < longest]
    return np.asarray(window[:2] + np.concatenate([np.zeros((0, 2), np.int64), *pieces]))
