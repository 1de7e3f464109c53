"""Hot loops: the extents of a weighted point set in many directions, without outliers."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import OUTLIER_FRACTION

BINS = 256


@kernel
def reach(points, weights, directions, fraction, low, high):
    """Find for each direction the interval that holds all weight except `fraction` at either end.

    The weight is collected in 256 bins over the whole range and assumed to be uniform within a bin.

    Parameters
    ----------
    points : (N, 2) float64
    weights : (N,) float64
        Positive.
    directions : (D, 2) float64
        Unit.
    fraction : float
        Fraction of the weight left out at each end, 0..0.5.
    low, high : (D,) float64, output
    """
    spans(points, directions, low, high)
    if fraction <= 0.0:
        return
    total, alike = 0.0, True
    for i in range(points.shape[0]):
        total += weights[i]
        alike &= weights[i] == 1.0
    # Compute the bins of all points first, then add the weights, so that the compiler can vectorise the first loop.
    across, along = points[:, 0].copy(), points[:, 1].copy()
    bins, place = np.empty(BINS), np.empty(points.shape[0], np.int32)
    for d in range(directions.shape[0]):
        first, last = low[d], high[d]
        if last <= first:
            continue
        scale, x, y = BINS / (last - first), directions[d, 0], directions[d, 1]
        for i in range(points.shape[0]):
            place[i] = min(np.int32((across[i] * x + along[i] * y - first) * scale), np.int32(BINS - 1))
        if alike:
            low[d], high[d] = counted(place, fraction * total, first, scale)
            continue
        bins[:] = 0.0
        for i in range(points.shape[0]):
            bins[place[i]] += weights[i]
        low[d], high[d] = trimmed(bins, fraction * total, first, scale)


@kernel
def spans(points, directions, low, high):
    """Find the smallest and largest coordinate of all points along each direction; see `reach`."""
    x, y, count = directions[:, 0].copy(), directions[:, 1].copy(), points.shape[0]
    smallest, largest = np.full(x.size, np.inf), np.full(x.size, -np.inf)
    for i in range(0, count, 4):
        # Four points at a time (the last ones may repeat), to reduce memory traffic between iterations.
        j, k = min(i + 1, count - 1), min(i + 2, count - 1)
        m = min(k + 1, count - 1)
        xi, yi, xj, yj = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
        xk, yk, xm, ym = points[k, 0], points[k, 1], points[m, 0], points[m, 1]
        # The inner loop runs over directions, so that the compiler can vectorise it.
        for d in range(x.size):
            first, second = xi * x[d] + yi * y[d], xj * x[d] + yj * y[d]
            third, fourth = xk * x[d] + yk * y[d], xm * x[d] + ym * y[d]
            smallest[d] = min(smallest[d], min(min(first, second), min(third, fourth)))
            largest[d] = max(largest[d], max(max(first, second), max(third, fourth)))
    for d in range(x.size):
        low[d], high[d] = smallest[d], largest[d]


@kernel
def trimmed(bins, cut, first, scale):
    """Return the interval without `cut` of the weight at either end; the bins, `scale` per metre, begin at `first`."""
    left, k = 0.0, 0
    while left + bins[k] < cut:
        left += bins[k]
        k += 1
    low = first + (k + (cut - left) / bins[k]) / scale
    left, k = 0.0, bins.size - 1
    while left + bins[k] < cut:
        left += bins[k]
        k -= 1
    return low, first + (k + 1 - (cut - left) / bins[k]) / scale


@kernel
def counted(place, cut, first, scale):
    """Return the result of `trimmed` for points of weight 1, given the bin of each point.

    Very few points lie beyond the cut: searching the outermost bins one by one is faster than filling all bins.
    """
    bottom, top, beneath, above = np.int32(0), np.int32(BINS - 1), np.int32(0), np.int32(0)
    while True:
        held, borne = np.int32(0), np.int32(0)
        for i in range(place.size):
            held += np.int32(place[i] == bottom)
            borne += np.int32(place[i] == top)
        if beneath + held >= cut and above + borne >= cut:
            break
        higher, lower = np.int32(BINS), np.int32(-1)
        for i in range(place.size):
            higher = min(higher, place[i] if place[i] > bottom else np.int32(BINS))
            lower = max(lower, place[i] if place[i] < top else np.int32(-1))
        if beneath + held < cut:
            beneath, bottom = np.int32(beneath + held), higher
        if above + borne < cut:
            above, top = np.int32(above + borne), lower
    return first + (bottom + (cut - beneath) / held) / scale, first + (top + 1 - (cut - above) / borne) / scale


@kernel
def ends_at(values):
    """Return the robust range of values (N,); infinity and minus infinity if there are none.

    Errors of poses and depth put the outermost values too far out. The ends are therefore extrapolated from quantiles:
    from the value at twice the outlier fraction, continue outwards by its distance to the value at four times that
    fraction, but not beyond the outermost value.
    """
    low, high = np.inf, -np.inf
    for value in values:
        low, high = min(low, value), max(high, value)
    if high <= low or values.size == 0:
        return low, high
    bins, scale = np.zeros(BINS), BINS / (high - low)
    for value in values:
        bins[min(BINS - 1, int((value - low) * scale))] += 1.0
    cut = 2.0 * OUTLIER_FRACTION * values.size
    near, far = trimmed(bins, cut, low, scale), trimmed(bins, 2.0 * cut, low, scale)
    return max(low, 2.0 * near[0] - far[0]), min(high, 2.0 * near[1] - far[1])


@kernel
def best_turn(points, weights, directions, low, high, larger, better):
    """Return the direction of the box: the smallest footprint, or a slightly larger one whose sides fit better.

    Parameters
    ----------
    points : (N, 2) float64
        Points of the sides, not of the top.
    weights : (N,) float64
    directions : (2 Q, 2) float64
        Uniformly over half a turn.
    low, high : (2 Q,) float64
        Extents of all points along the directions.
    larger : float
        Largest accepted footprint, as a multiple of the smallest one.
    better : float
        Required ratio of its side spread (see `side_spread`) to that of the smallest footprint.

    Returns
    -------
    int
        0..Q-1.
    """
    quarter = directions.shape[0] // 2
    area = np.empty(quarter)
    best = 0
    for k in range(quarter):
        # All boxes around a round footprint are equivalent: rounding makes the first one win instead of noise.
        area[k] = np.round((high[k] - low[k]) * (high[k + quarter] - low[k + quarter]), 9)
        if area[k] < area[best]:
            best = k
    if points.shape[0] == 0:
        return best
    chosen, limit = best, -1.0
    for k in range(quarter):
        if k == best or area[k] > larger * area[best]:
            continue
        # Only local minima over the direction.
        if area[k] > area[k - 1] or area[k] > area[(k + 1) % quarter]:
            continue
        if limit < 0.0:
            limit = better * side_spread(points, weights, directions, low, high, best)
        spread = side_spread(points, weights, directions, low, high, k)
        if spread < limit:
            chosen, limit = k, spread
    return chosen


@kernel
def side_spread(points, weights, directions, low, high, turn):
    """Return the spread of points around the sides of a box, each side moved to the mean of its nearest points."""
    quarter = directions.shape[0] // 2
    sums = np.zeros((4, 3))
    other = turn + quarter
    for i in range(points.shape[0]):
        a = points[i, 0] * directions[turn, 0] + points[i, 1] * directions[turn, 1]
        b = points[i, 0] * directions[other, 0] + points[i, 1] * directions[other, 1]
        side, depth = 0, high[turn] - a
        if a - low[turn] < depth:
            side, depth = 1, a - low[turn]
        if high[other] - b < depth:
            side, depth = 2, high[other] - b
        if b - low[other] < depth:
            side, depth = 3, b - low[other]
        w = weights[i]
        sums[side, 0] += w
        sums[side, 1] += w * depth
        sums[side, 2] += w * depth * depth
    total = square = 0.0
    for k in range(4):
        if sums[k, 0] > 0.0:
            total += sums[k, 0]
            square += sums[k, 2] - sums[k, 1] * sums[k, 1] / sums[k, 0]
    return np.sqrt(max(square, 0.0) / total) if total > 0.0 else 0.0


@kernel
def side_layers(points, weights, center, rotation, half, band, out):
    """Sum the weights of points in two layers inside each side of a box, except for the bottom.

    Parameters
    ----------
    points : (N, 3) float64
    weights : (N,) float64
    center, half : (3,) float64
        Centre of the box, and half of its size.
    rotation : (3, 3) float64
    band : float
        Thickness of a layer, metres.
    out : (5, 3) float64, output
        For the sides +x, -x, +y, -y, +z: weight in the outer layer, summed weight times depth there, weight in the
        next layer.
    """
    out[:] = 0.0
    for i in range(points.shape[0]):
        w = weights[i]
        dx, dy, dz = points[i, 0] - center[0], points[i, 1] - center[1], points[i, 2] - center[2]
        for k in range(5):
            axis = k // 2
            along = dx * rotation[0, axis] + dy * rotation[1, axis] + dz * rotation[2, axis]
            depth = half[axis] - along if k % 2 == 0 else half[axis] + along
            if depth < band:
                out[k, 0] += w
                out[k, 1] += w * max(depth, 0.0)
            elif depth < 2.0 * band:
                out[k, 2] += w


@kernel
def beyond_sides(points, center, rotation, bottom, near, steps, places, counts):
    """Place points outside the top and the four upright sides of a cloud, opposite the points that form each side.

    Parameters
    ----------
    points : (N, 3) float32
        World, metres.
    center : (3,) float64
    rotation : (3, 3) float64
        The axes of its box as columns, the third is up.
    bottom : float
        Points lower than this relative to the centre are ignored, metres.
    near : float
        Points within this distance of the outermost one form a side, metres.
    steps : (K,) float64
        Distances from each of these points at which places are put, metres.
    places : (5 K N, 3) float64, output
        World, sides in the order +z, +x, -x, +y, -y, point by point.
    counts : (5,) int64, output
        Number of points that form each side; all 0 if no point counts.

    Returns
    -------
    int
        Number of places.
    """
    local, n = np.empty((points.shape[0], 3)), 0
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for i in range(points.shape[0]):
        dx, dy, dz = points[i, 0] - center[0], points[i, 1] - center[1], points[i, 2] - center[2]
        for k in range(3):
            local[n, k] = dx * rotation[0, k] + dy * rotation[1, k] + dz * rotation[2, k]
        if local[n, 2] > bottom:
            for k in range(3):
                low[k], high[k] = min(low[k], local[n, k]), max(high[k], local[n, k])
            n += 1
    total = 0
    for side in range(5):
        axis, sign = (2, 1.0) if side == 0 else ((side - 1) // 2, 1.0 if side % 2 == 1 else -1.0)
        counts[side] = 0
        for i in range(n):
            if (high[axis] - local[i, axis] if sign > 0.0 else local[i, axis] - low[axis]) > near:
                continue
            counts[side] += 1
            for step in steps:
                out = places[total]
                for k in range(3):
                    out[k] = center[k] + sign * step * rotation[k, axis]
                    out[k] += local[i, 0] * rotation[k, 0] + local[i, 1] * rotation[k, 1] + local[i, 2] * rotation[k, 2]
                total += 1
    return total
