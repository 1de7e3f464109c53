"""Bodies of revolution: a can, a jar, a bottle, a ball, a bowl, a plant in its pot.

Of such a body the camera sees the near side, and of that the noise thickens; its box is then too near, and too
shallow. But all its side tells where its axis is, to a few millimetres, and the axis tells the far side.

A mug, a teapot or a cap is such a body too, and something that sticks out of it: a handle, a spout, a brim.
"""

from __future__ import annotations

import math

import numpy as np

from cuboid.boxes.fit import DIRECTIONS, box_within, plane_axes, reach_of
from cuboid.boxes.kernels.bodies import find_body
from cuboid.boxes.kernels.revolve import widest_layer
from cuboid.boxes.quantiles import quantile
from cuboid.core.frame import Float64Array
from cuboid.core.tolerances import JUMP_M, MIN_READINGS, OUTLIER_FRACTION
from cuboid.geometry.box import Box

# The widest layer of a body is reached by this fraction of its points.
FULL_LAYER_FRACTION = 0.9
# Points that stick out are a part of the object where less than this fraction of them are outliers.
MAX_STRAYS = 0.5


def revolved(
    box: Box,
    points: Float64Array,
    trust: Float64Array,
    normal: Float64Array,
    offset: float,
    noise_m: float,
    layer_m: float,
    fraction: float,
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
    fraction : float
        Fraction of the trust that are strays, at each side.
    """
    height = points @ normal + offset
    first, second = plane_axes(normal)
    plan = points @ np.array([first, second]).T
    layer = np.floor((height - height.min()) / layer_m).astype(np.int64)
    side = np.flatnonzero(height < quantile(height, 1.0 - 2.0 * OUTLIER_FRACTION) - JUMP_M)
    if len(side) < MIN_READINGS or not trust[side].sum() > 0.0:
        return None
    center, part = np.empty(2), np.empty(len(side), bool)
    seen = plan[side], layer[side], trust[side], _footprint(box, first, second), noise_m
    # A body that is noisy all over gets its axis from all its points.
    off_m = find_body(*seen, True, center, part) or find_body(*seen, False, center, part)
    if not off_m:
        return None
    body, top = np.zeros(len(points), bool), np.ones(len(points), bool)
    body[side], top[side] = ~part, False
    distance = np.hypot(*(plan - center).T)
    weight = float(trust.sum())
    bounds = int(layer.max()) + 1, 2.0 * OUTLIER_FRACTION * weight, FULL_LAYER_FRACTION
    radius = widest_layer(distance[body], layer[body], trust[body], *bounds)
    # Its top, which tells no axis, may be wider by as much as it is thick: what lies farther out sticks out, too.
    body |= top & (distance <= radius + JUMP_M)
    radius = widest_layer(distance[body], layer[body], trust[body], *bounds)
    along = DIRECTIONS @ center
    low, high, towards = along - radius, along + radius, None
    # Points that stick out by more than noise are a part of their own, where few of them are outliers.
    beyond = distance > radius + off_m
    strays = fraction * weight / max(float(trust[beyond].sum()), 1e-12)
    if strays < MAX_STRAYS:
        least, most = reach_of(plan[beyond], trust[beyond], DIRECTIONS, strays)
        low, high = np.minimum(low, least), np.maximum(high, most)
        towards = _lengthwise(plan[beyond] - center, trust[beyond])
    middle = float(normal @ box.center)
    return box_within(low, high, middle - box.size[2] / 2.0, middle + box.size[2] / 2.0, normal, towards)


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
