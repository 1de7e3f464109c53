"""Hot loop that fills the holes of a depth image from what lies nearest, in place and in color."""

from __future__ import annotations

import numpy as np

from cuboid.core.compiled import kernel
from cuboid.core.kernels.regions import BACKGROUND
from cuboid.core.kernels.segments import FAR, NONE, PLANE


@kernel
def fill_holes(kind, on, color, step, edge, reach, focal, labels, inverse):
    """Give pixels without a reading the label and depth of what they lie nearest to; see `nearest`.

    Parameters
    ----------
    kind : (H, W) uint8
    on : (H, W) int8
        The plane of each pixel, -1 none.
    color : (step H, step W, 3) uint8
    step : int
    edge, reach, focal : float
    labels : (H, W) int16, in and out
        Planes and far readings get theirs.
    inverse : (H, W) float32, in and out
    """
    height, width = kind.shape
    known = np.empty(kind.shape, np.bool_)
    for v in range(height):
        label, what, plane = labels[v], kind[v], on[v]
        # Without a branch: so one instruction takes several pixels.
        for u in range(width):
            apart = (what[u] == PLANE) | (what[u] == FAR)
            label[u] = BACKGROUND - 1 - plane[u] if apart else (label[u] if what[u] != NONE else 0)
            known[v, u] = what[u] != NONE
            inverse[v, u] = inverse[v, u] if what[u] != NONE else np.float32(0.0)
    holes, source = nearest(known, inverse, color, step, edge, reach, focal)
    flat, near = labels.reshape(-1), inverse.reshape(-1)
    for i in range(holes.size):
        if source[i] >= 0:
            flat[holes[i]], near[holes[i]] = flat[source[i]], near[source[i]]


@kernel(error_model="numpy")
def fill_depth(depth, color, edge, reach, focal, out):
    """Copy depth, its holes filled with the depth of what they lie nearest to; see `nearest`.

    Parameters
    ----------
    depth : (H, W) float32
        Metres, 0 none.
    color : (H, W, 3) uint8
    edge, reach, focal : float
    out : (H, W) float32, output
    """
    one = np.float32(1.0)
    known, inverse = np.empty(depth.shape, np.bool_), np.empty(depth.shape, np.float32)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            out[v, u] = z
            known[v, u] = z > 0.0
            inverse[v, u] = one / z if z > 0.0 else np.float32(0.0)
    holes, source = nearest(known, inverse, color, 1, edge, reach, focal)
    flat, near = out.reshape(-1), inverse.reshape(-1)
    for i in range(holes.size):
        if source[i] >= 0:
            flat[holes[i]] = one / near[source[i]]


@kernel
def nearest(known, inverse, color, step, edge, reach, focal):
    """Find what the holes of an image lie nearest to, color edges being far to cross.

    A step to a neighbour costs 1 plus its difference in color over `edge`; a sweep there and one back find the
    cheapest way to good approximation (two more changed no recall and took as long again).
    What costs more than `reach` at the depth that it would get stays a hole.

    Parameters
    ----------
    known : (H, W) bool
    inverse : (H, W) float32
        1/z where it is known.
    color : (step H, step W, 3) uint8
    step : int
    edge : float
        Levels of color difference that count as one pixel.
    reach : float
        Metres.
    focal : float
        Pixels.

    Returns
    -------
    holes, source : (N,) int32
        Places in the flattened image of the pixels that are not known, and of what each lies nearest to, -1 nothing.
    """
    height, width = known.shape
    # Around the image nothing, so that no neighbour is asked whether it is in it.
    wide = width + 2
    shape, reach_px, none = (height + 2) * wide, np.float32(reach) * np.float32(focal), np.float32(0.0)
    # For each place: its cost, the place that its depth comes from, and the largest cost allowed at that depth.
    cost, limit, source = np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.int32)
    shade = np.empty((3, shape), np.uint8)
    clear_margin(wide, height, cost, limit, source, shade)
    # Holes come in runs along a row, thirty pixels long: where each begins and ends.
    runs, count = np.empty((height * (width // 2 + 1), 2), np.int32), 0
    for v in range(height):
        first, read, given, seen = (v + 1) * wide + 1, known[v], inverse[v], color[v * step]
        row = slice(first, first + width)
        costs, limits, sources = cost[row], limit[row], source[row]
        red, green, blue = shade[0, row], shade[1, row], shade[2, row]
        for u in range(width):
            costs[u] = none if read[u] else np.float32(np.inf)
            limits[u] = reach_px * given[u] if read[u] else none
        for u in range(width):
            sources[u] = v * width + u if read[u] else -1
        for u in range(width):
            red[u], green[u], blue[u] = seen[u * step, 0], seen[u * step, 1], seen[u * step, 2]
        u = 0
        while u < width:
            if read[u]:
                u += 1
                continue
            runs[count, 0] = first + u
            while u < width and not read[u]:
                u += 1
            runs[count, 1] = first + u
            count += 1
    runs = runs[:count]
    per_level, change = np.float32(1.0 / edge), changes(shade, wide)
    for ahead in (-1, 1):
        sweep(runs, ahead, wide, change, per_level, cost, limit, source)
    holes, sources, count = np.empty(known.size, np.int32), np.empty(known.size, np.int32), 0
    for begin, end in runs:
        # Offset between places in an image with a margin and in the image without.
        apart = width + 3 + 2 * (begin // wide - 1)
        for place in range(begin, end):
            holes[count], sources[count] = place - apart, source[place]
            count += 1
    return holes[:count], sources[:count]


@kernel
def changes(shade, wide):
    """Return how much color changes (4, N) from each place to the next one, and to the three in the row after.

    `shade` (3, N) uint8 are the channels of an image with its margin, rows `wide` pixels long.
    """
    red, green, blue = shade[0], shade[1], shade[2]
    size = red.size
    change = np.empty((4, size), np.uint16)
    for k in range(4):
        on = 1 if k == 0 else wide + k - 2
        out, r, g, b = change[k], red[on:], green[on:], blue[on:]
        # Without a branch: so one instruction takes several pixels.
        for i in range(size - on):
            # The larger less the smaller: that keeps to 16 bits, and a difference with its sign does not.
            total = (max(red[i], r[i]) - min(red[i], r[i])) + (max(green[i], g[i]) - min(green[i], g[i]))
            out[i] = total + (max(blue[i], b[i]) - min(blue[i], b[i]))
    return change


@kernel
def clear_margin(wide, height, cost, limit, source, shade):
    """Let nothing be in the margin around an image of this many rows, `wide` pixels long; see `nearest`."""
    for v in range(height + 2):
        inside = 0 < v < height + 1
        first = v * wide
        for at in range(first, first + 1 if inside else first + wide):
            cost[at], limit[at], source[at] = np.float32(np.inf), np.float32(0.0), -1
            shade[0, at] = shade[1, at] = shade[2, at] = 0
        if inside:
            at = first + wide - 1
            cost[at], limit[at], source[at] = np.float32(np.inf), np.float32(0.0), -1
            shade[0, at] = shade[1, at] = shade[2, at] = 0


@kernel
def sweep(runs, ahead, wide, change, per_level, cost, limit, source):
    """Let each place in runs (N, 2) of the image with its margin learn from the neighbours that come before it.

    `ahead` is -1 where these have the lower places, and 1 where all goes the other way. See `nearest`.
    """
    beside, back, up, forth = change[0], change[1], change[2], change[3]
    for i in range(len(runs)):
        begin, end = runs[i if ahead < 0 else len(runs) - 1 - i]
        start = np.int64(begin if ahead < 0 else end - 1)
        left = np.uintp(start + ahead)
        least, most, origin = cost[left], limit[left], source[left]
        for j in range(end - begin):
            place = start - ahead * j
            # Unsigned: no index from the end.
            here, over = np.uintp(place), np.uintp(place + ahead * wide)
            one, other = np.uintp(place + ahead * wide - 1), np.uintp(place + ahead * wide + 1)
            own = cost[here]
            # Where color changes from the one to the other is told at the lower of the two places.
            a, b, c = (forth[one], up[over], back[other]) if ahead < 0 else (back[here], up[here], forth[here])
            side = beside[np.uintp(place - 1)] if ahead < 0 else beside[here]
            best, found = own, here
            total = by_way_of(cost[one], np.float32(1.4), a, per_level, limit[one])
            best, found = (total, one) if total < best else (best, found)
            total = by_way_of(cost[over], np.float32(1.0), b, per_level, limit[over])
            best, found = (total, over) if total < best else (best, found)
            total = by_way_of(cost[other], np.float32(1.4), c, per_level, limit[other])
            best, found = (total, other) if total < best else (best, found)
            # The one beside last, though it goes before the others where both cost the same: it was known last.
            total = by_way_of(least, np.float32(1.0), side, per_level, most)
            closer = (total < own) & (total <= best)
            least = total if closer else best
            most, origin = most if closer else limit[found], origin if closer else source[found]
            cost[here], limit[here], source[here] = least, most, origin


@kernel(inline="always")
def by_way_of(cost, step, change, per_level, limit):
    """Return what a place costs by way of a neighbour, a step away; infinity beyond its limit. See `sweep`."""
    total = cost + (step + np.float32(change) * per_level)
    return total if total <= limit else np.float32(np.inf)
