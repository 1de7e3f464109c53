"""The axis of a body of revolution in plain NumPy: what `kernels.bodies` is compared with."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.tolerances import (
    DRIFT_M,
    JUMP_M,
    JUMP_SIGMAS,
    MIN_READINGS,
    MIN_SIGMA_M,
    SIGMAS,
)
from cuboid.method.boxes.kernels import revolve as kernel
from cuboid.method.boxes.kernels.bodies import (
    KEPT_LAYER_FRACTION,
    MIN_ARC,
    MIN_BODY,
    RIM_FRACTION,
    ROUND_TOLERANCE,
    SECTORS,
    STEPS,
    TORN_FRACTION,
)
from cuboid.method.boxes.kernels.extents import side_spread
from cuboid.method.boxes.kernels.resting import ROUND_RADIUS

Layers = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis, and how the points that it was fitted to lie about it.

    Attributes
    ----------
    center : (2,) float64
        Where it is in plan, metres.
    radius : (L,) float64
        Of each layer, metres; 0 of one that is not round.
    distance, residual : (N,) float64
        Of each point from the axis, and less its layer's radius, metres.
    weights : (N,) float64
        0 for what is not near the body's surface.
    sector : (N,) int64
        Part of the turn, 0..12: the last one holds no more than a limit.
    spread_m : float
        Standard deviation of the points around the surface, metres.
    """

    center: Float64Array
    radius: Float64Array
    distance: Float64Array
    residual: Float64Array
    weights: Float64Array
    sector: Layers
    spread_m: float

    @property
    def noise_m(self) -> float:
        """How far points of the surface lie off it at most, metres."""
        return max(JUMP_SIGMAS * MIN_SIGMA_M, SIGMAS * self.spread_m)

    def appendage(self, layer: Layers, trust: Float64Array) -> npt.NDArray[np.bool_]:
        """Tell which points (N,) are no part of the body: what sticks out in a part of the turn, and its whole layers.

        What sticks out all round is the rim of a layer that is filled, as a pot is with soil.
        """
        layers = len(self.radius)
        # Of layers that the fit left out the radius is not known.
        mean = by(layer, trust * self.distance, layers) / np.maximum(by(layer, trust, layers), 1e-12)
        radius = np.where(by(layer, self.weights, layers) > 0.0, self.radius, mean)
        out = self.distance - radius[layer] > self.noise_m
        cell, cells = layer * (SECTORS + 1) + self.sector, layers * (SECTORS + 1)
        seen = by(cell, trust, cells).reshape(layers, -1)
        beyond = by(cell, trust * out, cells).reshape(layers, -1) > TORN_FRACTION * seen
        part = out & (beyond.sum(1) <= RIM_FRACTION * (seen > 0.0).sum(1))[layer]
        torn = by(layer, trust * part, layers) > TORN_FRACTION * by(layer, trust, layers)
        return np.asarray(part | torn[layer])


def fit_axis(plan: Float64Array, layer: Layers, trust: Float64Array, noise_m: float, trim: bool) -> Axis | None:
    """Fit an axis to points of a surface.

    Parameters
    ----------
    plan : (N, 2) float64
        Points of a side seen along the axis, metres.
    layer : (N,) int64
        Which layer each belongs to, from 0.
    trust : (N,) float64
    noise_m : float
        Standard deviation of the points of a surface, metres.
    trim : bool
        Leave out what departs from the axis, with layers of which some does, and fit again.

    Returns
    -------
    Axis or None
        None where the points tell of none.
    """
    center, radius, residual = np.empty(2), np.empty(int(layer.max()) + 1), np.empty(len(plan))
    if not kernel.fit_axis(plan, layer, trust, STEPS, center, radius, residual):
        return None
    weights = trust
    for _ in range(3 if trim else 0):
        away = np.abs(residual)
        near = away < SIGMAS * max(1.48 * _median(away, weights), noise_m, MIN_SIGMA_M)
        # A layer of which some departs is not round: that of a brim, or of a handle.
        whole = by(layer, trust * near, len(radius)) >= KEPT_LAYER_FRACTION * by(layer, trust, len(radius))
        before, weights = weights, np.where(near & whole[layer], trust, 0.0)
        if np.array_equal(before, weights):
            break
        if np.count_nonzero(weights) < MIN_READINGS:
            return None
        if not kernel.fit_axis(plan, layer, weights, STEPS, center, radius, residual):
            return None
    angle = np.arctan2(*(plan - center).T[::-1])
    sector = np.floor(angle * (SECTORS / (2.0 * math.pi))).astype(np.int64) + SECTORS // 2
    square = np.minimum(np.abs(residual), DRIFT_M) ** 2
    spread_m = float(np.sqrt(np.average(square, weights=weights)))
    return Axis(center, radius, residual + radius[layer], residual, weights, sector, spread_m)


def by(group: Layers, values: Float64Array, groups: int) -> Float64Array:
    """Return the sums of values (N,) over those of each group 0..groups - 1."""
    return np.asarray(np.bincount(group, values, groups), dtype=np.float64)


def _median(values: Float64Array, weights: Float64Array) -> float:
    """Return below which of values (N,) half of the weight lies."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(total, 0.5 * total[-1])]])


def numpy_body(
    plan: Float64Array, layer: Layers, trust: Float64Array, rectangle: Float64Array, noise_m: float, trim: bool
) -> Axis | None:
    """The axis of the body of whose side points (N, 2) were seen; None where there is none, or it is unsure."""
    axis = fit_axis(plan, layer, trust, noise_m, trim)
    if axis is None or axis.weights.sum() < MIN_BODY * trust.sum():
        return None
    usual = float(np.average(axis.radius[layer], weights=axis.weights))
    along, half = rectangle[2:4], rectangle[4:] / 2.0
    sides = np.array([along, [-along[1], along[0]]])
    against = side_spread(plan - rectangle[:2], axis.weights, sides, -half, half, 0)
    if max(axis.spread_m, noise_m) >= against or usual > ROUND_RADIUS * float(rectangle[4:].max()) + JUMP_M:
        return None
    sums = by(axis.sector, axis.weights * axis.residual, SECTORS + 1), by(axis.sector, axis.weights, SECTORS + 1)
    readings = np.bincount(axis.sector[axis.weights > 0.0], minlength=SECTORS + 1)
    known = (readings >= MIN_READINGS) & (sums[1] > 0.0)
    if known.sum() < MIN_ARC * SECTORS or np.ptp(sums[0][known] / sums[1][known]) > ROUND_TOLERANCE * usual:
        return None
    return axis
