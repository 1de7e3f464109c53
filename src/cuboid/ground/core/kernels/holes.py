"""Hot loop that fills the holes of a depth image from the reading nearest in position and color."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.kernels.regions import BACKGROUND
from cuboid.ground.core.kernels.segments import FAR, NONE, PLANE


@kernel
def fill_holes(kind, on, color, step, edge, reach, focal, labels, inverse):
    """Give pixels without a reading the label and depth of their nearest pixel with a reading; see `nearest`.

    Parameters
    ----------
    kind : (H, W) uint8
    on : (H, W) int8
        Index of the plane of each pixel, -1: none.
    color : (step H, step W, 3) uint8
    step : int
    edge, reach, focal : float
    labels : (H, W) int16, in and out
        Pixels on planes and far pixels get the labels of these.
    inverse : (H, W) float32, in and out
    """
    height, width = kind.shape
    valid = np.empty(kind.shape, np.bool_)
    for v in range(height):
        label, kinds, plane = labels[v], kind[v], on[v]
        # No branches, so that the compiler can vectorise the loop.
        for u in range(width):
            is_background = (kinds[u] == PLANE) | (kinds[u] == FAR)
            label[u] = BACKGROUND - 1 - plane[u] if is_background else (label[u] if kinds[u] != NONE else 0)
            valid[v, u] = kinds[u] != NONE
            inverse[v, u] = inverse[v, u] if kinds[u] != NONE else np.float32(0.0)
    holes, source = nearest(valid, inverse, color, step, edge, reach, focal)
    flat, near = labels.reshape(-1), inverse.reshape(-1)
    for i in range(holes.size):
        if source[i] >= 0:
            flat[holes[i]], near[holes[i]] = flat[source[i]], near[source[i]]


@kernel(error_model="numpy")
def fill_depth(depth, color, edge, reach, focal, out):
    """Copy depth and fill its holes with the depth of the nearest reading; see `nearest`.

    Parameters
    ----------
    depth : (H, W) float32
        Metres, 0 none.
    color : (H, W, 3) uint8
    edge, reach, focal : float
    out : (H, W) float32, output
    """
    one = np.float32(1.0)
    valid, inverse = np.empty(depth.shape, np.bool_), np.empty(depth.shape, np.float32)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            out[v, u] = z
            valid[v, u] = z > 0.0
            inverse[v, u] = one / z if z > 0.0 else np.float32(0.0)
    holes, source = nearest(valid, inverse, color, 1, edge, reach, focal)
    flat, near = out.reshape(-1), inverse.reshape(-1)
    for i in range(holes.size):
        if source[i] >= 0:
            flat[holes[i]] = one / near[source[i]]


@kernel
def nearest(valid, inverse, color, step, edge, reach, focal):
    """Find the nearest valid pixel of each hole pixel, where crossing a color edge counts as a long distance.

    A step to a neighbour costs its length (1, or 1.4 diagonally) plus its color difference over `edge`. One forward and
    one backward sweep find the cheapest path to good approximation (two more sweeps changed no recall and doubled the
    time). A pixel stays a hole if its cost exceeds `reach` at the depth that it would get.

    Parameters
    ----------
    valid : (H, W) bool
    inverse : (H, W) float32
        1/z of valid pixels.
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
        Flat indices of the pixels that are not valid, and of the nearest valid pixel of each, -1: none.
    """
    height, width = valid.shape
    # A margin of empty pixels surrounds the image, so that neighbours need no bounds check.
    wide = width + 2
    shape, reach_px, none = (height + 2) * wide, np.float32(reach) * np.float32(focal), np.float32(0.0)
    # For each pixel: its cost, the largest cost allowed at its depth, and the pixel that its depth comes from.
    cost, limit, source = np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.int32)
    shade = np.empty((3, shape), np.uint8)
    clear_margin(wide, height, cost, limit, source, shade)
    # Begin and end of each run of hole pixels in a row; a run has about thirty pixels.
    runs, count = np.empty((height * (width // 2 + 1), 2), np.int32), 0
    for v in range(height):
        first, valid_row, inverse_row, color_row = (v + 1) * wide + 1, valid[v], inverse[v], color[v * step]
        row = slice(first, first + width)
        costs, limits, sources = cost[row], limit[row], source[row]
        red, green, blue = shade[0, row], shade[1, row], shade[2, row]
        for u in range(width):
            costs[u] = none if valid_row[u] else np.float32(np.inf)
            limits[u] = reach_px * inverse_row[u] if valid_row[u] else none
        for u in range(width):
            sources[u] = v * width + u if valid_row[u] else -1
        for u in range(width):
            red[u], green[u], blue[u] = color_row[u * step, 0], color_row[u * step, 1], color_row[u * step, 2]
        u = 0
        while u < width:
            if valid_row[u]:
                u += 1
                continue
            runs[count, 0] = first + u
            while u < width and not valid_row[u]:
                u += 1
            runs[count, 1] = first + u
            count += 1
    runs = runs[:count]
    per_level, change = np.float32(1.0 / edge), changes(shade, wide)
    for ahead in (-1, 1):
        sweep(runs, ahead, wide, change, per_level, cost, limit, source)
    holes, sources, count = np.empty(valid.size, np.int32), np.empty(valid.size, np.int32), 0
    for begin, end in runs:
        # Offset between flat indices in the image with the margin and in the image without it.
        margin_offset = width + 3 + 2 * (begin // wide - 1)
        for place in range(begin, end):
            holes[count], sources[count] = place - margin_offset, source[place]
            count += 1
    return holes[:count], sources[:count]


@kernel
def changes(shade, wide):
    """Return the color differences (4, N) from each pixel to its right neighbour and to the three in the next row.

    `shade` (3, N) uint8 holds the color channels of an image with its margin, `wide` pixels per row.
    """
    red, green, blue = shade[0], shade[1], shade[2]
    size = red.size
    change = np.empty((4, size), np.uint16)
    for k in range(4):
        on = 1 if k == 0 else wide + k - 2
        out, r, g, b = change[k], red[on:], green[on:], blue[on:]
        # No branches, so that the compiler can vectorise the loop.
        for i in range(size - on):
            # Maximum minus minimum stays in unsigned 16 bits; a signed difference would not.
            total = (max(red[i], r[i]) - min(red[i], r[i])) + (max(green[i], g[i]) - min(green[i], g[i]))
            out[i] = total + (max(blue[i], b[i]) - min(blue[i], b[i]))
    return change


@kernel
def clear_margin(wide, height, cost, limit, source, shade):
    """Clear the margin around an image of `height` rows, `wide` pixels per row with the margin; see `nearest`."""
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
    """Update each pixel in runs (N, 2) of the image with its margin from the neighbours that come before it.

    `ahead` is -1 for the forward sweep, where these neighbours have lower indices, and 1 for the backward sweep. See
    `nearest`.
    """
    change_across, change_back, change_up, change_forth = change[0], change[1], change[2], change[3]
    for i in range(len(runs)):
        begin, end = runs[i if ahead < 0 else len(runs) - 1 - i]
        start = np.int64(begin if ahead < 0 else end - 1)
        left = np.uintp(start + ahead)
        last_cost, last_limit, last_source = cost[left], limit[left], source[left]
        for j in range(end - begin):
            place = start - ahead * j
            # Unsigned: numba then skips the handling of negative indices.
            pixel, over = np.uintp(place), np.uintp(place + ahead * wide)
            over_before, over_after = np.uintp(place + ahead * wide - 1), np.uintp(place + ahead * wide + 1)
            old_cost = cost[pixel]
            # A color difference is stored at the pixel with the lower index.
            a, b, c = (
                (change_forth[over_before], change_up[over], change_back[over_after])
                if ahead < 0
                else (change_back[pixel], change_up[pixel], change_forth[pixel])
            )
            side = change_across[np.uintp(place - 1)] if ahead < 0 else change_across[pixel]
            best, via = old_cost, pixel
            total = by_way_of(cost[over_before], np.float32(1.4), a, per_level, limit[over_before])
            best, via = (total, over_before) if total < best else (best, via)
            total = by_way_of(cost[over], np.float32(1.0), b, per_level, limit[over])
            best, via = (total, over) if total < best else (best, via)
            total = by_way_of(cost[over_after], np.float32(1.4), c, per_level, limit[over_after])
            best, via = (total, over_after) if total < best else (best, via)
            # The neighbour in the row is compared last, because its cost is known last, but it wins a tie.
            total = by_way_of(last_cost, np.float32(1.0), side, per_level, last_limit)
            closer = (total < old_cost) & (total <= best)
            last_cost = total if closer else best
            last_limit, last_source = last_limit if closer else limit[via], last_source if closer else source[via]
            cost[pixel], limit[pixel], source[pixel] = last_cost, last_limit, last_source


@kernel(inline="always")
def by_way_of(cost, step, change, per_level, limit):
    """Return the cost of a pixel by way of a neighbour at distance `step`; infinity beyond `limit`. See `sweep`."""
    total = cost + (step + np.float32(change) * per_level)
    return total if total <= limit else np.float32(np.inf)
