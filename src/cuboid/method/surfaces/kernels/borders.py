"""Hot loop over the borders between the segments of a frame: where their surfaces part, and where they continue."""

from __future__ import annotations

import math

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import JUMP_SIGMAS

# Two surfaces that meet in a groove belong to different things, or to different faces of a concave one: a groove is an
# inner angle that is smaller than 180 degrees by this, radians (20 degrees), and by more than the noise.
GROOVE_RAD, GROOVE_SIGMAS = 0.35, 2.0
# The direction of a surface is measured over this distance, metres, and at least this many pixels.
REACH_M, DIRECTION_REACH_PX = 0.012, 3
# Where so many pixels cover more than this, metres, they are too coarse to show a shape.
MAX_REACH_M = 0.03


@kernel
def borders(depth, claim, focal, noise, jump, shared, parting, continuing, coarse):
    """Count the pixels at which two segments touch, and those at which their surfaces part or continue.

    Surfaces part at a depth jump and at a groove; they continue where they are one surface, or meet in a convex edge.
    A pixel near the end of a segment counts as neither. In the inverse of depth a plane is linear in the image, and
    the noise is equal everywhere.

    Parameters
    ----------
    depth : (h, w) float32
        Depth with holes filled, metres, 0: none.
    claim : (h, w) int32
        Segment of each pixel, -1: none.
    focal : float
        Pixels.
    noise : float
        The standard deviation of depth is this value times z squared.
    jump : float
        Metres.
    shared, parting, continuing, coarse : (count, count) int64, output
        [i, j], i < j: number of pixels; `coarse` ones are too far for a shape.
    """
    height, width = depth.shape
    shared[:], parting[:], continuing[:], coarse[:] = 0, 0, 0, 0
    for v in range(height):
        for u in range(width):
            a = claim[v, u]
            if a < 0:
                continue
            for k in range(2):
                dv, du = 1 - k, k
                v1, u1 = v + dv, u + du
                if v1 >= height or u1 >= width or claim[v1, u1] < 0 or claim[v1, u1] == a:
                    continue
                b, z0, z1 = claim[v1, u1], np.float64(depth[v, u]), np.float64(depth[v1, u1])
                if z0 <= 0.0 or z1 <= 0.0:
                    continue
                i, j, z = min(a, b), max(a, b), min(z0, z1)
                shared[i, j] += 1
                if abs(z0 - z1) > jump + JUMP_SIGMAS * noise * z * z:
                    parting[i, j] += 1
                    continue
                if DIRECTION_REACH_PX * z > MAX_REACH_M * focal:
                    coarse[i, j] += 1
                    continue
                reach = max(DIRECTION_REACH_PX, int(REACH_M * focal / z))
                va, ua, vb, ub = v - reach * dv, u - reach * du, v1 + reach * dv, u1 + reach * du
                if va < 0 or ua < 0 or vb >= height or ub >= width or claim[va, ua] != a or claim[vb, ub] != b:
                    continue
                za, zb = np.float64(depth[va, ua]), np.float64(depth[vb, ub])
                if za <= 0.0 or zb <= 0.0:
                    continue
                first, second = z * focal / reach * (1.0 / z0 - 1.0 / za), z * focal / reach * (1.0 / zb - 1.0 / z1)
                turn = math.atan(second) - math.atan(first)
                mean = 0.5 * (first + second)
                sigma = 2.0 * noise / reach * z * focal / (1.0 + mean * mean)
                if turn > GROOVE_RAD and turn > GROOVE_SIGMAS * sigma:
                    parting[i, j] += 1
                else:
                    continuing[i, j] += 1
