"""Images become smaller: blocks of pixels become one, or one of each is taken."""

from __future__ import annotations

import numpy as np
from numba import njit

from cuboid.frame import Float32Array, UInt8Array


@njit(cache=True, nogil=True)
def halve_depth(depth_m: Float32Array, same_surface: float, out_m: Float32Array) -> None:
    """Give each 2 x 2 block one reading, and none between two surfaces.

    Of the block's readings in order of depth, the middle two are averaged where they differ by no more than
    `same_surface` times the depth; else the nearer of them stands. One reading alone stands as it is.

    Parameters
    ----------
    depth_m : (>= 2 H, >= 2 W) float32
        Metres, 0 is no reading.
    same_surface : float
    out_m : (H, W) float32
        Written.
    """
    inf = np.float32(np.inf)
    for v in range(out_m.shape[0]):
        for u in range(out_m.shape[1]):
            a, b = depth_m[2 * v, 2 * u], depth_m[2 * v, 2 * u + 1]
            c, d = depth_m[2 * v + 1, 2 * u], depth_m[2 * v + 1, 2 * u + 1]
            a = a if a > 0 else inf
            b = b if b > 0 else inf
            c = c if c > 0 else inf
            d = d if d > 0 else inf
            low, other_low = min(a, b), min(c, d)
            high, other_high = max(a, b), max(c, d)
            p, q = max(low, other_low), min(high, other_high)
            near, far = min(p, q), max(p, q)
            if far == inf:  # two readings or fewer: the middle two are the first and the second
                near, far = min(low, other_low), near
            if near == inf:
                out_m[v, u] = 0.0
            elif far <= near * (1.0 + same_surface):
                out_m[v, u] = (near + far) * 0.5
            else:
                out_m[v, u] = near


@njit(cache=True, nogil=True)
def take_one(color: UInt8Array, step: int, x: int, y: int, out: UInt8Array) -> None:
    """Take one pixel of each block of a color image; NumPy takes ten times as long over slices of three bytes.

    Parameters
    ----------
    color : (>= step H, >= step W, 3) uint8
    step : int
        Edge of a block.
    x, y : int
        Which pixel of a block, 0..step - 1.
    out : (H, W, 3) uint8
        Written.
    """
    for v in range(out.shape[0]):
        for u in range(out.shape[1]):
            for c in range(3):
                out[v, u, c] = color[y + step * v, x + step * u, c]
