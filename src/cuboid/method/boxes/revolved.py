"""Bodies of revolution: a can, a jar, a bottle, a ball, a bowl, a plant in its pot.

The camera sees only the near side of such a body, and noise thickens that side: its box is too near and too shallow.
But the points of the side determine the axis to a few millimetres, and the axis determines the far side.

A mug, a teapot or a cap is such a body with a part that sticks out: a handle, a spout, a brim.
"""

from __future__ import annotations

import math

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.tolerances import JUMP_M, MIN_READINGS, OUTLIER_FRACTION
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.fit import DIRECTIONS, box_within, fit_box, plane_axes, reach_of
from cuboid.method.boxes.kernels.bodies import MIN_BODY, find_body
from cuboid.method.boxes.kernels.revolve import widest_layer
from cuboid.method.boxes.quantiles import quantile

# This fraction of a body's radius is reached by the rim points of its widest layer; see `widest_layer`.
FULL_LAYER_FRACTION = 0.9
# Points of one wall lie within this of it, layers: a circle that is less exact also fits two things side by side.
MAX_WALL_OFF = 0.5
# Points that stick out belong to the object if less than this fraction of them are outliers.
MAX_STRAYS = 0.5


def revolved(
    box: Box,
    points: Float64Array,
    trust: Float64Array,
    plane: tuple[Float64Array, float],
    noise_m: float,
    layer_m: float,
    fraction: float,
) -> Box | None:
    """Return the box of a partly seen body of revolution; None if the object is not one, or if it is uncertain.

    Parameters
    ----------
    box : Box
        Box around the seen part.
    points : (N, 3) float64
        World, metres.
    trust : (N,) float64
    plane : ((3,) float64, float)
        Unit normal and offset of its supporting plane: normal.p + offset = 0.
    noise_m : float
        Standard deviation of the points of a surface, metres.
    layer_m : float
        Thickness of a layer, metres: one voxel.
    fraction : float
        Fraction of the trust that are outliers, at each side.
    """
    normal, offset = plane
    height = points @ normal + offset
    first, second = plane_axes(normal)
    plan = points @ np.array([first, second]).T
    layer = np.floor((height - height.min()) / layer_m).astype(np.int64)
    side = np.flatnonzero(height < quantile(height, 1.0 - 2.0 * OUTLIER_FRACTION) - JUMP_M)
    if len(side) < MIN_READINGS or not trust[side].sum() > 0.0:
        return None
    center, part = np.empty(2), np.empty(len(side), bool)
    seen = plan[side], layer[side], trust[side], _footprint(box, first, second), noise_m
    # The first try trims points off the axis; a body that is noisy everywhere gets its axis from all points.
    off_m = find_body(*seen, True, center, part) or find_body(*seen, False, center, part)
    if not off_m:
        return None
    body, top = np.zeros(len(points), bool), np.ones(len(points), bool)
    body[side], top[side] = ~part, False
    distance = np.hypot(*(plan - center).T)
    weight = float(trust.sum())
    bounds = int(layer.max()) + 1, 2.0 * OUTLIER_FRACTION * weight, FULL_LAYER_FRACTION
    radius = widest_layer(distance[body], layer[body], trust[body], *bounds)
    # The top, which does not determine the axis, may extend beyond the radius by JUMP_M; points farther out stick out.
    body |= top & (distance <= radius + JUMP_M)
    radius = widest_layer(distance[body], layer[body], trust[body], *bounds)
    along = DIRECTIONS @ center
    low, high, towards = along - radius, along + radius, None
    # Points that stick out by more than noise are a separate part, if few of them are outliers.
    beyond = distance > radius + off_m
    strays = fraction * weight / max(float(trust[beyond].sum()), 1e-12)
    if strays < MAX_STRAYS:
        part_low, part_high = reach_of(plan[beyond], trust[beyond], DIRECTIONS, strays)
        low, high = np.minimum(low, part_low), np.maximum(high, part_high)
        towards = _lengthwise(plan[beyond] - center, trust[beyond])
    middle = float(normal @ box.center)
    return box_within(low, high, middle - box.size[2] / 2.0, middle + box.size[2] / 2.0, normal, towards)


def share_wall(
    first: Float64Array, second: Float64Array, plane: tuple[Float64Array, float], noise_m: float, layer_m: float
) -> bool:
    """Return whether two pieces are parts of the wall of one body of revolution.

    In each layer that both reach, their points lie on one circle around one axis, but for a handle. Two bodies side by
    side do not have one circle, a thing in a bowl is not on its wall, and two that stand on each other share no layers.

    Parameters
    ----------
    first, second : (N, 3) float64
        Points of the pieces, world, metres.
    plane, noise_m, layer_m
        As for `revolved`.
    """
    normal, offset = plane
    points = np.concatenate([first, second])
    height = points @ normal + offset
    side = height < quantile(height, 1.0 - 2.0 * OUTLIER_FRACTION) - JUMP_M
    of_second = (np.arange(len(points)) >= len(first))[side]
    layer = np.floor((height[side] - height.min()) / layer_m).astype(np.int64)
    if np.bincount(of_second, minlength=2).min() < MIN_READINGS:
        return False
    first_axis, second_axis = plane_axes(normal)
    plan = points[side] @ np.array([first_axis, second_axis]).T
    trust, box = np.ones(len(plan)), fit_box(points, normal, offset, 0.0)
    center, part = np.empty(2), np.empty(len(plan), bool)
    off_m = find_body(plan, layer, trust, _footprint(box, first_axis, second_axis), noise_m, True, center, part)
    if not 0.0 < off_m <= MAX_WALL_OFF * layer_m:
        return False
    distance, on_wall = np.hypot(*(plan - center).T), np.zeros(len(plan), bool)
    for k in np.unique(layer):
        of_first, both = (layer == k) & ~of_second, layer == k
        if of_first.any() and (both & of_second).any():
            on_wall |= both & (np.abs(distance - np.median(distance[of_first])) < off_m)
    return bool(min(on_wall[of_second].mean(), on_wall[~of_second].mean()) >= MIN_BODY)


def _lengthwise(away: Float64Array, trust: Float64Array) -> float:
    """Return the direction, radians, from the axis in which the points that stick out (N, 2) lie, on one or both sides.

    An object with a handle, or with a spout and a handle, is symmetric about that direction.
    """
    twice, weight = 2.0 * np.arctan2(away[:, 1], away[:, 0]), trust * np.hypot(*away.T)
    return 0.5 * math.atan2(float(weight @ np.sin(twice)), float(weight @ np.cos(twice)))


def _footprint(box: Box, first: Float64Array, second: Float64Array) -> Float64Array:
    """Return the footprint of a box (6,): its centre, the direction of its length, and its sizes."""
    return np.array(
        [
            first @ box.center,
            second @ box.center,
            first @ box.rotation[:, 0],
            second @ box.rotation[:, 0],
            box.size[0],
            box.size[1],
        ]
    )
