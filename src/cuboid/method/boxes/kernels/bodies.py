"""Hot loops that recognise bodies of revolution and the parts that stick out of them; see `boxes.revolved`."""

from __future__ import annotations

import math

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import DRIFT_M, JUMP_M, JUMP_SIGMAS, MIN_READINGS, MIN_SIGMA_M, SIGMAS
from cuboid.method.boxes.kernels.extents import side_spread
from cuboid.method.boxes.kernels.resting import ROUND_RADIUS
from cuboid.method.boxes.kernels.revolve import fit_axis

# Number of iterations of the fit.
STEPS = 6
# Number of sectors of a turn in which a side is examined.
SECTORS = 12
# Smallest visible fraction of a turn: one viewpoint shows half, depth slightly less; less gives no axis in noise.
MIN_ARC = 0.4
# Smallest fraction of the side points that belong to the body: the brim of a cap has nearly as many as its dome.
MIN_BODY = 0.4
# The radius of a round body varies between sectors by less than this fraction.
ROUND_TOLERANCE = 0.1
# A layer with a smaller fraction of points near the circle is not round: it contains a brim or a handle.
KEPT_LAYER_FRACTION = 0.8
# A layer, or a sector of it, belongs to a part that sticks out if more than this fraction of it does.
TORN_FRACTION = 0.2
# A part that sticks out in more than this fraction of the sectors is a rim all around.
RIM_FRACTION = 0.5


@kernel
def find_body(plan, layer, trust, rectangle, noise, trim, center, part):
    """Find the upright axis of a body of revolution from points of its side, and the points that are not of the body.

    Parameters
    ----------
    plan : (N, 2) float64
        Points of the side projected along the axis, metres.
    layer : (N,) int64
        Layer of each point, from 0.
    trust : (N,) float64
    rectangle : (6,) float64
        Footprint of all points: middle (2), direction of its length (2), sizes (2), metres.
    noise : float
        Standard deviation of the points of a surface, metres.
    trim : bool
        Remove points that deviate from the axis, and layers with many such points, and fit again.
    center : (2,) float64, output
    part : (N,) bool, output
        Points that stick out in a part of the turn, and the whole layers of such points.

    Returns
    -------
    float
        Largest distance of surface points from the body, metres; 0 if there is no such body, or it is uncertain.
    """
    n, radius = len(layer), np.empty(layer.max() + 1)
    residual, weights = np.empty(n), trust.copy()
    if not fit_trimmed(plan, layer, trust, noise, trim, center, radius, residual, weights):
        return 0.0
    whole = total = weighted_radius = square = 0.0
    for i in range(n):
        whole, total = whole + weights[i], total + trust[i]
        weighted_radius += weights[i] * radius[layer[i]]
        square += weights[i] * min(abs(residual[i]), DRIFT_M) ** 2
    if not whole > 0.0 or whole < MIN_BODY * total:
        return 0.0
    usual, spread = weighted_radius / whole, np.sqrt(square / whole)
    # A nearly straight side has a distant axis.
    if usual > ROUND_RADIUS * max(rectangle[4], rectangle[5]) + JUMP_M:
        return 0.0
    # The body must fit better than the best rectangle.
    if spread >= off_rectangle(plan, weights, rectangle):
        return 0.0
    sector = np.empty(n, np.int64)
    for i in range(n):
        angle = math.atan2(plan[i, 1] - center[1], plan[i, 0] - center[0])
        # The extra last sector only holds points at exactly pi.
        sector[i] = np.int64(np.floor(angle * (SECTORS / (2.0 * math.pi)))) + SECTORS // 2
    if not is_round(sector, weights, residual, ROUND_TOLERANCE * usual):
        return 0.0
    off = max(JUMP_SIGMAS * MIN_SIGMA_M, SIGMAS * spread)
    appendage(layer, trust, sector, weights, radius, residual, off, part)
    return off


@kernel
def fit_trimmed(plan, layer, trust, noise, trim, center, radius, residual, weights):
    """Fit an axis, and again without deviating points (their `weights` (N,) become 0); return whether there is one."""
    if not fit_axis(plan, layer, trust, STEPS, center, radius, residual):
        return False
    n, layers = len(layer), len(radius)
    layer_trust, layer_near, away = np.zeros(layers), np.empty(layers), np.empty(n)
    for i in range(n):
        layer_trust[layer[i]] += trust[i]
    for _ in range(3 if trim else 0):
        for i in range(n):
            away[i] = abs(residual[i])
        limit = SIGMAS * max(1.48 * weighted_median(away, weights), noise, MIN_SIGMA_M)
        layer_near[:] = 0.0
        for i in range(n):
            layer_near[layer[i]] += trust[i] if away[i] < limit else 0.0
        # A layer with many deviating points is not round: it contains a brim or a handle.
        changed, left = False, 0
        for i in range(n):
            k = layer[i]
            kept = trust[i] if away[i] < limit and layer_near[k] >= KEPT_LAYER_FRACTION * layer_trust[k] else 0.0
            changed |= kept != weights[i]
            left += kept != 0.0
            weights[i] = kept
        if not changed:
            return True
        if left < MIN_READINGS or not fit_axis(plan, layer, weights, STEPS, center, radius, residual):
            return False
    return True


@kernel
def weighted_median(values, weights):
    """Return the weighted median of values (N,), by repeated partitioning."""
    part, heavy = values.copy(), weights.copy()
    begin, end, before = 0, len(part), 0.0
    half = 0.5 * heavy.sum()
    while end - begin > 1:
        pivot = part[(begin + end) // 2]
        # Partition into values below, equal to, and above the pivot.
        low, k, high, below, same = begin, begin, end, 0.0, 0.0
        while k < high:
            value, weight = part[k], heavy[k]
            if value < pivot:
                part[k], heavy[k], part[low], heavy[low] = part[low], heavy[low], value, weight
                low, k, below = low + 1, k + 1, below + weight
            elif value > pivot:
                high -= 1
                part[k], heavy[k], part[high], heavy[high] = part[high], heavy[high], value, weight
            else:
                k, same = k + 1, same + weight
        if before + below >= half and low > begin:
            end = low
        elif before + below + same >= half or high == end:
            return pivot
        else:
            begin, before = high, before + below + same
    return part[begin]


@kernel
def off_rectangle(plan, weights, rectangle):
    """Return the spread of points around the sides of a rectangle; see `find_body`."""
    away = np.empty((len(plan), 2))
    for i in range(len(plan)):
        away[i, 0], away[i, 1] = plan[i, 0] - rectangle[0], plan[i, 1] - rectangle[1]
    sides, half = np.empty((2, 2)), np.empty(2)
    sides[0, 0], sides[0, 1] = rectangle[2], rectangle[3]
    sides[1, 0], sides[1, 1] = -rectangle[3], rectangle[2]
    half[0], half[1] = rectangle[4] / 2.0, rectangle[5] / 2.0
    return side_spread(away, weights, sides, -half, half, 0)


@kernel
def is_round(sector, weights, residual, limit):
    """Return whether enough sectors were seen and their mean residuals differ by no more than a limit."""
    readings, sums = np.zeros(SECTORS + 1, np.int64), np.zeros((SECTORS + 1, 2))
    for i in range(len(sector)):
        k = sector[i]
        readings[k] += weights[i] > 0.0
        sums[k, 0] += weights[i] * residual[i]
        sums[k, 1] += weights[i]
    sectors_read, low, high = 0, np.inf, -np.inf
    for k in range(SECTORS + 1):
        if readings[k] >= MIN_READINGS and sums[k, 1] > 0.0:
            mean = sums[k, 0] / sums[k, 1]
            sectors_read, low, high = sectors_read + 1, min(low, mean), max(high, mean)
    return sectors_read >= MIN_ARC * SECTORS and not high - low > limit


@kernel
def appendage(layer, trust, sector, weights, radius, residual, off, part):
    """Mark the points that stick out of a body by more than `off` in a part of the turn, and the layers full of them.

    Points that stick out all around are the rim of a filled layer, such as a pot with soil.
    """
    n, layers = len(layer), len(radius)
    fitted, sums, layer_radius = np.zeros(layers), np.zeros((layers, 2)), radius.copy()
    for i in range(n):
        k = layer[i]
        fitted[k] += weights[i]
        sums[k, 0] += trust[i] * (residual[i] + radius[k])
        sums[k, 1] += trust[i]
    for k in range(layers):
        # The fit does not give the radius of layers without weight: use their mean distance.
        if not fitted[k] > 0.0:
            layer_radius[k] = sums[k, 0] / max(sums[k, 1], 1e-12)
    seen, beyond = np.zeros((layers, SECTORS + 1)), np.zeros((layers, SECTORS + 1))
    for i in range(n):
        k = layer[i]
        part[i] = residual[i] + radius[k] - layer_radius[k] > off
        seen[k, sector[i]] += trust[i]
        beyond[k, sector[i]] += trust[i] if part[i] else 0.0
    rim, torn = np.empty(layers, np.bool_), np.zeros(layers)
    for k in range(layers):
        sectors_seen = out = 0
        for s in range(SECTORS + 1):
            sectors_seen += seen[k, s] > 0.0
            out += beyond[k, s] > TORN_FRACTION * seen[k, s]
        rim[k] = out > RIM_FRACTION * sectors_seen
    for i in range(n):
        k = layer[i]
        part[i] = part[i] and not rim[k]
        torn[k] += trust[i] if part[i] else 0.0
    for i in range(n):
        k = layer[i]
        part[i] = part[i] or torn[k] > TORN_FRACTION * sums[k, 1]
