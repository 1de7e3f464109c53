"""Bodies of revolution: a can, a jar, a bottle, a ball, a bowl, a plant in its pot.

Of such a body the camera sees the near side, and of that the noise thickens; its box is then too near, and too
shallow. But all its side tells where its axis is, to a few millimetres, and the axis tells the far side.

A mug, a teapot or a cap is such a body too, and something that sticks out of it: a handle, a spout, a brim.
"""

from __future__ import annotations

import math

import numpy as np

from cuboid.boxes.axis import SECTORS, Axis, Layers, by, fit_axis
from cuboid.boxes.fit import DIRECTIONS, box_within, plane_axes, reach_of
from cuboid.boxes.quantiles import quantile
from cuboid.frame import Float64Array
from cuboid.geometry.box import Box
from cuboid.kernels import revolve as kernel
from cuboid.kernels.extents import side_spread
from cuboid.kernels.resting import ROUND_RADIUS
from cuboid.tolerances import JUMP_M, LEAST_READINGS, LITTLE, MOST, STRAYS

# Half of the turn is seen from one place, a little less of it in depth: what covers less fixes no axis in noise.
LEAST_ARC = MOST - LITTLE
# Of a side so much is its body's: a cap's brim has nearly as many points as its dome.
LEAST_BODY = MOST - LITTLE


def revolved(
    box: Box,
    points: Float64Array,
    trust: Float64Array,
    normal: Float64Array,
    offset: float,
    noise_m: float,
    layer_m: float,
    share: float,
) -> Box | None:
    """Return the box of a body of revolution of which a part was seen; None where it is none, or that is not sure.

    Parameters
    ----------
    box : Box
        Around what was seen.
    points : (N, 3) float64
        World, metres.
    trust : (N,) float64
    normal : (3,) float64
        Of the plane it stands on, unit.
    offset : float
        The plane is normal.p + offset = 0.
    noise_m : float
        Standard deviation of the points of a surface, metres.
    layer_m : float
        Thickness of a layer, metres: a voxel.
    share : float
        Share of the trust that are strays, at each side.
    """
    height = points @ normal + offset
    first, second = plane_axes(normal)
    plan = points @ np.array([first, second]).T
    layer = np.floor((height - height.min()) / layer_m).astype(np.int64)
    side = np.flatnonzero(height < quantile(height, 1.0 - 2.0 * STRAYS) - JUMP_M)
    if len(side) < LEAST_READINGS or not trust[side].sum() > 0.0:
        return None
    rectangle = _footprint(box, first, second)
    seen = plan[side], layer[side], trust[side], rectangle, noise_m
    # What is noisy all over has its axis from all of it.
    axis = _axis(*seen, trim=True) or _axis(*seen, trim=False)
    if axis is None:
        return None
    body = np.ones(len(points), bool)
    body[side] = ~axis.appendage(layer[side], trust[side])
    distance = np.hypot(*(plan - axis.center).T)
    weight = float(trust.sum())
    layers, least_weight = int(layer.max()) + 1, 2.0 * STRAYS * weight
    radius = kernel.widest_layer(distance[body], layer[body], trust[body], layers, least_weight, 1.0 - LITTLE)
    along = DIRECTIONS @ axis.center
    low, high, towards = along - radius, along + radius, None
    # What sticks out by more than noise is a part of its own, where most of it is no strays.
    part = distance > radius + axis.noise_m
    strays = share * weight / max(float(trust[part].sum()), 1e-12)
    if strays < MOST:
        least, most = reach_of(plan[part], trust[part], DIRECTIONS, strays)
        low, high = np.minimum(low, least), np.maximum(high, most)
        towards = _lengthwise(plan[part] - axis.center, trust[part])
    middle = float(normal @ box.center)
    return box_within(low, high, middle - box.size[2] / 2.0, middle + box.size[2] / 2.0, normal, towards)


def _axis(
    plan: Float64Array, layer: Layers, trust: Float64Array, rectangle: Float64Array, noise_m: float, trim: bool
) -> Axis | None:
    """Return the axis of the body of whose side points (N, 2) were seen; None where there is none, or it is unsure."""
    axis = fit_axis(plan, layer, trust, noise_m, trim)
    if axis is None or axis.weights.sum() < LEAST_BODY * trust.sum():
        return None
    usual = float(np.average(axis.radius[layer], weights=axis.weights))
    along, half = rectangle[2:4], rectangle[4:] / 2.0
    sides = np.array([along, [-along[1], along[0]]])
    against = side_spread(plan - rectangle[:2], axis.weights, sides, -half, half, 0)
    # It fits better than the best rectangle.
    if max(axis.spread_m, noise_m) >= against:
        return None
    # A nearly straight side has its axis far away.
    if usual > ROUND_RADIUS * float(rectangle[4:].max()) + JUMP_M:
        return None
    sums = by(axis.sector, axis.weights * axis.residual, SECTORS + 1), by(axis.sector, axis.weights, SECTORS + 1)
    readings = np.bincount(axis.sector[axis.weights > 0.0], minlength=SECTORS + 1)
    known = (readings >= LEAST_READINGS) & (sums[1] > 0.0)
    # It departs from itself from sector to sector by little of its radius.
    if known.sum() < LEAST_ARC * SECTORS or np.ptp(sums[0][known] / sums[1][known]) > LITTLE * usual:
        return None
    return axis


def _lengthwise(away: Float64Array, trust: Float64Array) -> float:
    """Return the direction, radians, in which what sticks out (N, 2) lies from the axis, or lies on both its sides.

    A thing with a handle, or with a spout and a handle, is its own mirror image about that direction.
    """
    twice, weight = 2.0 * np.arctan2(away[:, 1], away[:, 0]), trust * np.hypot(*away.T)
    return 0.5 * math.atan2(float(weight @ np.sin(twice)), float(weight @ np.cos(twice)))


def _footprint(box: Box, first: Float64Array, second: Float64Array) -> Float64Array:
    """Return a box's footprint: (6,) its middle, sizes, and the direction of its length."""
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
