"""Hot loops that reduce images: blocks of pixels are merged, or one pixel of each block is taken."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float32Array, UInt8Array
from cuboid.ground.compiling.compiled import kernel


@kernel
def halve_depth(depth_m: Float32Array, same_surface: float, out_m: Float32Array) -> None:
    """Reduce each 2 x 2 block to one reading that never lies between two surfaces.

    The readings of a block are sorted by depth. The middle two are averaged if they differ by at most
    `same_surface` times the depth; otherwise the nearer one is taken. A single reading is kept.

    Parameters
    ----------
    depth_m : (>= 2 H, >= 2 W) float32
        Metres, 0 is no reading.
    same_surface : float
    out_m : (H, W) float32
        Written.
    """
    inf, none, half = np.float32(np.inf), np.float32(0.0), np.float32(0.5)
    wide = 2 * out_m.shape[1]
    for v in range(out_m.shape[0]):
        above, below, out = depth_m[2 * v, :wide], depth_m[2 * v + 1, :wide], out_m[v]
        # No branches, so that the compiler can vectorise the loop.
        for u in range(out.size):
            a, b, c, d = above[2 * u], above[2 * u + 1], below[2 * u], below[2 * u + 1]
            a, b = a if a > none else inf, b if b > none else inf
            c, d = c if c > none else inf, d if d > none else inf
            low, other_low = min(a, b), min(c, d)
            high, other_high = max(a, b), max(c, d)
            p, q = max(low, other_low), min(high, other_high)
            near, far = min(p, q), max(p, q)
            # With two readings or fewer, the middle two are the first and the second.
            few = far == inf
            near, far = min(low, other_low) if few else near, near if few else far
            mean = (near + far) * half if far <= near * (1.0 + same_surface) else near
            out[u] = none if near == inf else mean


@kernel
def take_one(color: UInt8Array, step: int, x: int, y: int, out: UInt8Array) -> None:
    """Take one pixel of each block of a color image; NumPy needs ten times as long for slices of three bytes.

    Parameters
    ----------
    color : (>= step H, >= step W, 3) uint8
    step : int
        Edge of a block.
    x, y : int
        Position of the pixel in its block, 0..step - 1.
    out : (H, W, 3) uint8
        Written.
    """
    for v in range(out.shape[0]):
        for u in range(out.shape[1]):
            for c in range(3):
                out[v, u, c] = color[y + step * v, x + step * u, c]
