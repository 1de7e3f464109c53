"""Hot loop that fills the holes of a depth image from what lies nearest, in place and in color."""

from __future__ import annotations

import numpy as np
from numba import njit

from cuboid.kernels.regions import BACKGROUND
from cuboid.kernels.segments import FAR, NONE, PLANE


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True)
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
    shape = (height + 2) * wide
    cost, near = np.full(shape, np.float32(np.inf)), np.zeros(shape, np.float32)
    shade, source = np.zeros((shape, 4), np.uint8), np.full(shape, np.int32(-1))
    holes, places, count = np.empty(known.size, np.int32), np.empty(known.size, np.int32), 0
    for v in range(height):
        first, read = (v + 1) * wide + 1, known[v]
        row = slice(first, first + width)
        costs, nears, sources, shades = cost[row], near[row], source[row], shade[row]
        given, seen = inverse[v], color[v * step]
        for u in range(width):
            costs[u] = np.float32(0.0) if read[u] else np.float32(np.inf)
            nears[u] = given[u] if read[u] else np.float32(0.0)
            sources[u] = v * width + u if read[u] else -1
        for u in range(width):
            holes[count], places[count] = v * width + u, first + u
            count += not read[u]
        for u in range(width):
            shades[u, 0], shades[u, 1], shades[u, 2] = seen[u * step, 0], seen[u * step, 1], seen[u * step, 2]
    places = places[:count]
    per_level, reach_px = np.float32(1.0 / edge), np.float32(reach) * np.float32(focal)
    for ahead in (-1, 1):
        sweep(places, ahead, wide, shade, per_level, reach_px, cost, near, source)
    return holes[:count], source[places]


@njit(cache=True, nogil=True)
def sweep(places, ahead, wide, shade, per_level, reach_px, cost, near, source):
    """Let each place (N,) of the image with its margin learn from the neighbours that come before it.

    `ahead` is -1 where these have the lower places, and 1 where all goes the other way; `reach_px` is the reach in
    pixels at a metre. See `nearest`.
    """
    for i in range(places.size):
        place = np.int64(places[i if ahead < 0 else places.size - 1 - i])
        # Unsigned: no index from the end.
        here, left, above = np.uintp(place), np.uintp(place + ahead), np.uintp(place + ahead * wide)
        own = np.float64(cost[here])
        best, found = own, here
        # The one beside last, though it goes before the others where both cost the same: it was known last, and what
        # the others cost is found out meanwhile.
        for k in range(3):
            there = np.uintp(np.int64(above) + k - 1)
            total = by_way_of(there, 1.0 if k == 1 else 1.4, here, shade, per_level, reach_px, cost, near)
            found, best = (there, total) if total < best else (found, best)
        total = by_way_of(left, 1.0, here, shade, per_level, reach_px, cost, near)
        beside = (total < own) & (total <= best)
        found, best = (left, total) if beside else (found, best)
        cost[here], near[here], source[here] = best, near[found], source[found]


@njit(cache=True, nogil=True, inline="always")
def by_way_of(there, step, here, shade, per_level, reach_px, cost, near):
    """Return what a place costs by way of a neighbour, a step away; infinity beyond the reach. See `sweep`."""
    change = abs(np.int32(shade[here, 0]) - np.int32(shade[there, 0]))
    change += abs(np.int32(shade[here, 1]) - np.int32(shade[there, 1]))
    change += abs(np.int32(shade[here, 2]) - np.int32(shade[there, 2]))
    total = cost[there] + step + change * per_level
    return total if total <= reach_px * near[there] else np.inf
