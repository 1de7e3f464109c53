"""The box of `fit_box` in plain NumPy: what its compiled loop is compared with."""

from __future__ import annotations

import numpy as np

from cuboid.ground.core.tolerances import JUMP_M
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.fit import ARC_DESIGNS, ARC_SOLVERS, ARCS, DIRECTIONS, plane_axes
from cuboid.method.boxes.kernels.resting import (
    BETTER_SIDES,
    MISSING_M,
    REST_M,
    RIVAL_AREA,
    ROUND_RADIUS,
    ROUND_RESIDUAL,
    SAME_LENGTH_M,
)

BINS = 256


def numpy_box(
    points: np.ndarray, normal: np.ndarray, offset: float | None, fraction: float, weights: np.ndarray | None = None
) -> Box:
    cloud = np.asarray(points, dtype=np.float64)
    trust = np.ones(len(cloud)) if weights is None else weights
    plan, heights = cloud @ np.array(plane_axes(normal)).T, cloud @ normal
    low, high = np.array([numpy_reach(plan @ direction, trust, fraction) for direction in DIRECTIONS]).T
    disc = numpy_disc(low, high)
    if disc is not None:
        along = DIRECTIONS @ disc[:2]
        low, high = np.minimum(low, along - disc[2]), np.maximum(high, along + disc[2])
    bottom, top = numpy_reach(heights, trust, fraction)
    if offset is not None and bottom + offset < REST_M:
        bottom = -offset
    side = heights < top - JUMP_M
    turn = numpy_turn(low, high, plan[side], trust[side])
    return numpy_around(low, high, bottom, top, normal, turn)


def numpy_turn(low: np.ndarray, high: np.ndarray, side: np.ndarray, trust: np.ndarray) -> int:
    """The direction of the least footprint, or of one hardly larger whose sides fit the points better."""
    quarter = len(DIRECTIONS) // 2
    area = np.round((high - low)[:quarter] * (high - low)[quarter:], 9)
    best = int(area.argmin())
    if len(side) == 0:
        return best
    rival = (np.arange(quarter) != best) & (area <= RIVAL_AREA * area[best])
    rival &= (area <= np.roll(area, 1)) & (area <= np.roll(area, -1))
    chosen, least = best, BETTER_SIDES * numpy_spread(low, high, side, trust, best)
    for k in np.flatnonzero(rival):
        if (spread := numpy_spread(low, high, side, trust, k)) < least:
            chosen, least = int(k), spread
    return chosen


def numpy_spread(low: np.ndarray, high: np.ndarray, side: np.ndarray, trust: np.ndarray, turn: int) -> float:
    """How far points depart from the mean of those of their side."""
    both = [turn, turn + len(DIRECTIONS) // 2]
    along = side @ DIRECTIONS[both].T
    depths = np.stack([high[both] - along, along - low[both]], axis=2).reshape(-1, 4)
    nearest, depth = depths.argmin(1), depths.min(1)
    of_side = [(trust[nearest == k], depth[nearest == k]) for k in range(4)]
    square = sum(float(w @ (d - np.average(d, weights=w)) ** 2) for w, d in of_side if len(d))
    return float(np.sqrt(square / trust.sum()))


def numpy_around(low: np.ndarray, high: np.ndarray, bottom: float, top: float, normal: np.ndarray, turn: int) -> Box:
    first, second = plane_axes(normal)
    extent, middle = high - low, (low + high) / 2.0
    a, b = turn, turn + len(DIRECTIONS) // 2
    u, v = (c * first + s * second for c, s in (DIRECTIONS[a], DIRECTIONS[b]))
    size, center = [extent[a], extent[b]], [middle[a], middle[b]]
    if extent[a] < extent[b] - SAME_LENGTH_M:
        u, v, size, center = v, -u, [extent[b], extent[a]], [middle[b], -middle[a]]
    axes = np.array([u, v, normal]).T
    return Box(axes @ np.array([*center, (top + bottom) / 2.0]), np.array([*size, max(top - bottom, 0.0)]), axes)


def numpy_disc(low: np.ndarray, high: np.ndarray) -> np.ndarray | None:
    extent = high - low
    if extent.min() > extent.max() - MISSING_M:
        return None
    arcs = np.concatenate([high, -low])[ARCS]
    fits = np.einsum("kcl,kl->kc", ARC_SOLVERS, arcs)
    radius = fits[:, 2]
    residual = np.abs(arcs - np.einsum("klc,kc->kl", ARC_DESIGNS, fits)).max(1) / np.where(radius > 0, radius, np.inf)
    fit = (extent.min() < 2.0 * radius - MISSING_M) & (radius <= ROUND_RADIUS * extent.max())
    residual = np.where(fit, residual, np.inf)
    best = int(np.argmin(residual))
    return fits[best] if residual[best] <= ROUND_RESIDUAL else None


def numpy_reach(along: np.ndarray, weights: np.ndarray, fraction: float) -> tuple[float, float]:
    first, last = along.min(), along.max()
    if fraction <= 0.0 or last <= first:
        return first, last
    bin_m = (last - first) / BINS
    of_bin = np.minimum(((along - first) / bin_m).astype(int), BINS - 1)
    bins = np.bincount(of_bin, weights, BINS)

    def cut_off(weight_of_bin: np.ndarray) -> float:
        """Bins, and a part of one, that hold the fraction to be left out."""
        total = np.cumsum(weight_of_bin)
        k = int(np.searchsorted(total, fraction * weights.sum()))
        return k + 1.0 - (total[k] - fraction * weights.sum()) / weight_of_bin[k]

    return first + cut_off(bins) * bin_m, last - cut_off(bins[::-1]) * bin_m
