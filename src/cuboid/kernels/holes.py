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
                limit = min(best, reach * focal * inverse[vv, uu])
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
