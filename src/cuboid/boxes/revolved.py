"""Bodies of revolution: a can, a jar, a bottle, a ball, a bowl, a plant in its pot.

Of such a body the camera sees the near side, and of that the noise thickens; its box is then too near, and too
shallow. But all its side tells where its axis is, to a few millimetres, and the axis tells the far side.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cuboid.boxes.fit import DIRECTIONS, box_within, plane_axes, reach_of
from cuboid.boxes.quantiles import quantile
from cuboid.frame import Float64Array
from cuboid.geometry.box import Box
from cuboid.kernels import revolve as kernel
from cuboid.kernels.extents import side_spread
from cuboid.kernels.resting import ROUND_RADIUS
from cuboid.tolerances import DRIFT_M, JUMP_M, JUMP_SIGMAS, LEAST_READINGS, LEAST_SIGMA_M, LITTLE, MOST, SIGMAS, STRAYS

# The fit takes so many steps.
STEPS = 6
# A side is looked at in so many sectors of the turn. Half of the turn is seen from one place, a little less of it in
# depth: what covers less fixes no axis in noise.
SECTORS, LEAST_ARC = 12, MOST - LITTLE


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
    axis = _axis(plan[side], layer[side], trust[side], _footprint(box, first, second), noise_m)
    if axis is None:
        return None
    center, spread_m = axis
    distance = np.hypot(*(plan - center).T)
    weight = float(trust.sum())
    radius = kernel.widest_layer(distance, layer, trust, int(layer.max()) + 1, 2.0 * STRAYS * weight, 1.0 - LITTLE)
    along = DIRECTIONS @ center
    low, high = along - radius, along + radius
    # What sticks out by more than noise is a part of its own, where most of it is no strays.
    part = distance > radius + max(JUMP_SIGMAS * LEAST_SIGMA_M, SIGMAS * spread_m)
    strays = share * weight / max(float(trust[part].sum()), 1e-12)
    if strays < MOST:
        least, most = reach_of(plan[part], trust[part], DIRECTIONS, strays)
        low, high = np.minimum(low, least), np.maximum(high, most)
    middle = float(normal @ box.center)
    return box_within(low, high, middle - box.size[2] / 2.0, middle + box.size[2] / 2.0, normal)


def _axis(
    plan: Float64Array, layer: npt.NDArray[np.int64], trust: Float64Array, rectangle: Float64Array, noise_m: float
) -> tuple[Float64Array, float] | None:
    """Return the place of the axis (2,) and the spread of the points around their surface, metres; None if unsure."""
    center, radius, residual = np.empty(2), np.empty(int(layer.max()) + 1), np.empty(len(plan))
    if not kernel.fit_axis(plan, layer, trust, STEPS, center, radius, residual):
        return None
    usual = float(np.average(radius[layer], weights=trust))
    spread_m = _spread(residual, trust)
    along, half = rectangle[2:4], rectangle[4:] / 2.0
    sides = np.array([along, [-along[1], along[0]]])
    against = side_spread(plan - rectangle[:2], trust, sides, -half, half, 0)
    # It fits better than the best rectangle.
    if max(spread_m, noise_m) >= against:
        return None
    # A nearly straight side has its axis far away.
    if usual > ROUND_RADIUS * float(rectangle[4:].max()) + JUMP_M:
        return None
    angle = np.arctan2(*(plan - center).T[::-1])
    sector = np.floor(angle * (SECTORS / (2.0 * math.pi))).astype(np.int64) + SECTORS // 2
    sums = np.bincount(sector, trust * residual, SECTORS + 1), np.bincount(sector, trust, SECTORS + 1)
    known = (np.bincount(sector, minlength=SECTORS + 1) >= LEAST_READINGS) & (sums[1] > 0.0)
    # It departs from itself from sector to sector by little of its radius: a mug's handle or a cap's brim does by more.
    if known.sum() < LEAST_ARC * SECTORS or np.ptp(sums[0][known] / sums[1][known]) > LITTLE * usual:
        return None
    return center, spread_m


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


def _spread(residual: Float64Array, trust: Float64Array) -> float:
    return float(np.sqrt(np.average(np.minimum(np.abs(residual), DRIFT_M) ** 2, weights=trust)))
