"""Hot loop: how far a weighted point set reaches in many directions, strays left out."""

from __future__ import annotations

import numpy as np

from cuboid.core.compiled import kernel
from cuboid.core.tolerances import OUTLIER_FRACTION

BINS = 256


@kernel
def reach(points, weights, directions, fraction, low, high):
    """Find for each direction the interval that holds all weight but `fraction` at either end.

    The weight is collected in 256 bins over the whole range; within a bin it is taken as spread evenly.

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
    # First the bins of all points, then their weights: so one instruction finds several bins.
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
    """Find for each direction from where to where all points reach; see `reach`."""
    x, y, count = directions[:, 0].copy(), directions[:, 1].copy(), points.shape[0]
    least, most = np.full(x.size, np.inf), np.full(x.size, -np.inf)
    for i in range(0, count, 4):
        # Four points at a time, at the end some of them again: what is written the next ones have to read.
        j, k = min(i + 1, count - 1), min(i + 2, count - 1)
        m = min(k + 1, count - 1)
        xi, yi, xj, yj = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
        xk, yk, xm, ym = points[k, 0], points[k, 1], points[m, 0], points[m, 1]
        # The directions side by side: so one instruction takes several of them.
        for d in range(x.size):
            first, second = xi * x[d] + yi * y[d], xj * x[d] + yj * y[d]
            third, fourth = xk * x[d] + yk * y[d], xm * x[d] + ym * y[d]
            least[d] = min(least[d], min(min(first, second), min(third, fourth)))
            most[d] = max(most[d], max(max(first, second), max(third, fourth)))
    low[:], high[:] = least, most


@kernel
def trimmed(bins, cut, first, scale):
    """Return where all weight but `cut` at either end lies; the bins, `scale` a metre, begin at `first`."""
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
    """Return what `trimmed` does where each point weighs 1, by the bins that they lie in.

    Next to nothing lies beyond the cut: the outermost bins are found sooner one after the other than all are filled.
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
    """Return from where to where values (N,) reach, strays or not; infinite to minus infinite where there are none.

    The outermost ones lie too far out where poses and depth err. So the edge follows from what lies further in: beyond
    it twice the fraction of strays would go on as evenly as this many values more do that lie next to them; no farther
    than there are values.
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
    """Find which of the directions is that of the box: of least footprint, or hardly larger with sides that fit better.

    Parameters
    ----------
    points : (N, 2) float64
        Of the sides, not of the top.
    weights : (N,) float64
    directions : (2 Q, 2) float64
        Evenly over half a turn.
    low, high : (2 Q,) float64
        How far everything reaches along them.
    larger : float
        A footprint this many times the least one may be taken.
    better : float
        Its sides fit this many times as well: the spread of the points around the sides nearest to them.

    Returns
    -------
    int
        0..Q-1.
    """
    quarter = directions.shape[0] // 2
    area = np.empty(quarter)
    best = 0
    for k in range(quarter):
        # All boxes around a round footprint are alike: areas are rounded, so that the first one wins, not noise.
        area[k] = np.round((high[k] - low[k]) * (high[k + quarter] - low[k + quarter]), 9)
        if area[k] < area[best]:
            best = k
    if points.shape[0] == 0:
        return best
    chosen, limit = best, -1.0
    for k in range(quarter):
        if k == best or area[k] > larger * area[best]:
            continue
        # Only the least of those that are turned about alike.
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
    """Return how far points depart from the sides of a box, each side moved to the mean of those nearest to it."""
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
    """Weigh the points of a box that lie in two layers beneath each of its sides, but for the one that it stands on.

    Parameters
    ----------
    points : (N, 3) float64
    weights : (N,) float64
    center, half : (3,) float64
        Of the box: its middle, and half of its size.
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
    """Put points beyond the sides of a cloud, opposite to those that make each side: its top and four upright sides.

    Parameters
    ----------
    points : (N, 3) float32
        World, metres.
    center : (3,) float64
    rotation : (3, 3) float64
        The axes of its box are the columns, the third up.
    bottom : float
        Points lower than this above the centre do not count, metres.
    near : float
        Points make a side that are no farther from the outermost one, metres.
    steps : (K,) float64
        How far beyond each of these places are put, metres.
    places : (5 K N, 3) float64, output
        World, side by side in the order +z, +x, -x, +y, -y, point by point.
    counts : (5,) int64, output
        Points that make each side; all 0 where none counts.

    Returns
    -------
    int
        How many places there are.
    """
    own, n = np.empty((points.shape[0], 3)), 0
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for i in range(points.shape[0]):
        dx, dy, dz = points[i, 0] - center[0], points[i, 1] - center[1], points[i, 2] - center[2]
        for k in range(3):
            own[n, k] = dx * rotation[0, k] + dy * rotation[1, k] + dz * rotation[2, k]
        if own[n, 2] > bottom:
            for k in range(3):
                low[k], high[k] = min(low[k], own[n, k]), max(high[k], own[n, k])
            n += 1
    total = 0
    for side in range(5):
        axis, sign = (2, 1.0) if side == 0 else ((side - 1) // 2, 1.0 if side % 2 == 1 else -1.0)
        counts[side] = 0
        for i in range(n):
            if (high[axis] - own[i, axis] if sign > 0.0 else own[i, axis] - low[axis]) > near:
                continue
            counts[side] += 1
            for step in steps:
                out = places[total]
                for k in range(3):
                    out[k] = center[k] + sign * step * rotation[k, axis]
                    out[k] += own[i, 0] * rotation[k, 0] + own[i, 1] * rotation[k, 1] + own[i, 2] * rotation[k, 2]
                total += 1
    return total
