"""Depth edges, and the strength of color edges at their moved positions."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.compiling.compiled import kernel


@kernel
def depth_edges(depth_m: Float32Array, jump: float, gap: int, out: Float32Array, across: npt.NDArray[np.bool_]) -> int:
    """Find where a surface ends before another one, along rows and columns.

    Parameters
    ----------
    depth_m : (H, W) float32
        Depth, metres; 0 is no reading.
    jump : float
        Minimum increase of depth to the next reading, as a fraction of the depth.
    gap : int
        Maximum number of pixels without a reading (the shadow of a projector) between the two.
    out : (N, 3) float32
        Written: column, row of the edge, half a pixel beyond the last reading of the nearer surface, and its depth.
    across : (N,) bool
        Written: whether the surface ends along its row, else along its column.

    Returns
    -------
    int
        Number of edges found, at most N.
    """
    height, width = depth_m.shape
    found = 0
    for r in range(1, height - 1):
        for c in range(1, width - 1):
            z = depth_m[r, c]
            if z <= 0:
                continue
            for side in range(4):
                dc = 1 if side == 0 else -1 if side == 1 else 0
                dr = 1 if side == 2 else -1 if side == 3 else 0
                if depth_m[r - dr, c - dc] <= 0 or abs(depth_m[r - dr, c - dc] - z) > jump * z * 0.5:
                    continue  # a single isolated reading is no surface
                row, column, steps = r + dr, c + dc, 0
                while 0 <= row < height and 0 <= column < width and depth_m[row, column] <= 0 and steps < gap:
                    row, column, steps = row + dr, column + dc, steps + 1
                if not (0 <= row < height and 0 <= column < width):
                    continue
                if depth_m[row, column] > z * (1 + jump) and found < out.shape[0]:
                    out[found, 0], out[found, 1], out[found, 2] = c + 0.5 * dc, r + 0.5 * dr, z
                    across[found] = dc != 0
                    found += 1
    return found


@kernel
def edge_agreement(
    places: Float32Array,
    across: npt.NDArray[np.bool_],
    image: npt.NDArray[np.int32],
    strength: Float32Array,
    moves: Float64Array,
    center: Float64Array,
    sums: Float64Array,
    counts: Float64Array,
) -> None:
    """Sum the strength of color edges at the moved positions of depth edges.

    A move (g, du, dv, p, q) puts an edge at (u, v) of depth z to center + g ((u, v) - center) + (du, dv) + (p, q) / z.

    Parameters
    ----------
    places : (N, 3) float32
        Column, row and depth of depth edges.
    across : (N,) bool
        Whether an edge crosses its row, else its column.
    image : (N,) int32
        Image of each edge.
    strength : (F, 2, H, W) float32
        Strength of color edges across the row, and across the column, in each image.
    moves : (M, 5) float64
    center : (2,) float64
    sums, counts : (M, F) float64
        Written: sum of the strengths and number of the edges in the image.
    """
    sums[:] = 0.0
    counts[:] = 0.0
    height, width = strength.shape[2], strength.shape[3]
    for m in range(moves.shape[0]):
        g, du, dv, p, q = moves[m]
        for n in range(places.shape[0]):
            z = places[n, 2]
            u = center[0] + g * (places[n, 0] - center[0]) + du + p / z
            v = center[1] + g * (places[n, 1] - center[1]) + dv + q / z
            c, r = int(np.floor(u)), int(np.floor(v))
            if c < 0 or r < 0 or c >= width - 1 or r >= height - 1:
                continue
            a, b = u - c, v - r
            one = strength[image[n], 0 if across[n] else 1]
            sums[m, image[n]] += (one[r, c] * (1 - a) + one[r, c + 1] * a) * (1 - b) + (
                one[r + 1, c] * (1 - a) + one[r + 1, c + 1] * a
            ) * b
            counts[m, image[n]] += 1.0
