"""Hot loop that fills the holes of a depth image from what lies nearest, in place and in color."""

from __future__ import annotations

import numpy as np
from numba import njit

from cuboid.kernels.regions import BACKGROUND
from cuboid.kernels.segments import COLUMN_MASK, FAR, NONE, PLACE_BITS, PLANE


@njit(cache=True, nogil=True)
def fill_holes(kind, on, color, step, edge, reach, focal, labels, inverse, cost, queue):
    """Give pixels without a reading the label and depth of what they lie nearest to, color edges being far to cross.

    A step to a neighbour costs 1 plus its difference in color over `edge`; a sweep there and one back find the
    cheapest way to good approximation (two more changed no recall and took as long again).
    What costs more than `reach` at the depth that it would get stays a hole.

    Parameters
    ----------
    kind : (H, W) uint8
    on : (H, W) int8
        The plane of each pixel, -1 none.
    color : (step H, step W, 3) uint8
    step : int
    edge : float
        Levels of color difference that count as one pixel.
    reach : float
        Metres.
    focal : float
        Pixels.
    labels : (H, W) int16, in and out
        Planes and far readings get theirs.
    inverse : (H, W) float32, in and out
    cost : (H, W) float32, scratch
    queue : (H * W,) int32, scratch
    """
    per_level = np.float32(1.0 / edge)
    reach = np.float32(reach)
    focal = np.float32(focal)
    height, width = kind.shape
    holes = 0
    for v in range(height):
        for u in range(width):
            if kind[v, u] == NONE:
                cost[v, u] = np.inf
                labels[v, u] = 0
                inverse[v, u] = 0.0
                queue[holes] = (v << PLACE_BITS) | u
                holes += 1
            else:
                cost[v, u] = 0.0
                if kind[v, u] == PLANE or kind[v, u] == FAR:
                    labels[v, u] = BACKGROUND - 1 - on[v, u]
    spread(holes, color, step, per_level, reach * focal, labels, inverse, cost, queue)


@njit(cache=True, nogil=True)
def spread(holes, color, step, per_level, reach_px, labels, inverse, cost, queue):
    """Sweep over the holes, the first of the queue, there and back; see `fill_holes`."""
    height, width = cost.shape
    for sweep in range(2):
        s = -1 if sweep % 2 == 0 else 1
        for i in range(holes):
            here = queue[i if s < 0 else holes - 1 - i]
            v, u = here >> PLACE_BITS, here & COLUMN_MASK
            best = cost[v, u]
            for k in range(4):
                vv = v if k == 0 else v + s
                uu = u + s if k == 0 else u + k - 2
                if vv < 0 or uu < 0 or vv >= height or uu >= width or cost[vv, uu] + 1.0 >= best:
                    continue
                limit = min(best, reach_px * inverse[vv, uu])
                total = cost[vv, uu] + (1.4 if k == 1 or k == 3 else 1.0)
                if total > limit:
                    continue
                change = abs(np.int32(color[v * step, u * step, 0]) - np.int32(color[vv * step, uu * step, 0]))
                change += abs(np.int32(color[v * step, u * step, 1]) - np.int32(color[vv * step, uu * step, 1]))
                change += abs(np.int32(color[v * step, u * step, 2]) - np.int32(color[vv * step, uu * step, 2]))
                total += change * per_level
                if total < best and total <= limit:
                    best = total
                    labels[v, u] = labels[vv, uu]
                    inverse[v, u] = inverse[vv, uu]
            cost[v, u] = best


@njit(cache=True, nogil=True, error_model="numpy")
def fill_depth(depth, color, edge, reach, focal, out):
    """Copy depth, its holes filled with the depth of what they lie nearest to; see `fill_holes`.

    Parameters
    ----------
    depth : (H, W) float32
        Metres, 0 none.
    color : (H, W, 3) uint8
    edge, reach, focal : float
    out : (H, W) float32, output
    """
    height, width = depth.shape
    one = np.float32(1.0)
    cost, inverse = np.empty(depth.shape, np.float32), np.empty(depth.shape, np.float32)
    labels, queue = np.zeros(depth.shape, np.int16), np.empty(depth.size, np.int32)
    holes = 0
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            out[v, u] = z
            read = z > 0.0
            cost[v, u] = np.float32(0.0) if read else np.float32(np.inf)
            inverse[v, u] = one / z if read else np.float32(0.0)
            queue[holes] = (v << PLACE_BITS) | u
            holes += not read
    spread(holes, color, 1, np.float32(one / edge), np.float32(reach) * np.float32(focal), labels, inverse, cost, queue)
    for i in range(holes):
        v, u = queue[i] >> PLACE_BITS, queue[i] & COLUMN_MASK
        if inverse[v, u] > 0.0:
            out[v, u] = one / inverse[v, u]
