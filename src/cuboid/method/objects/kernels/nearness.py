"""Hot loop: the number of points of one set that have a point of another set near them."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.method.heatmap.kernels.cubes import pack_key, scatter


@kernel
def count_near(a, b, limit, enough):
    """Count the points of `a` that lie nearer than a limit to any point of `b`; stop at `enough`.

    Parameters
    ----------
    a, b : (N, D) and (M, D) float32
        D is 2 or 3.
    limit : float
        Above 0.
    enough : int
        The count at which the search stops.

    Returns
    -------
    int
    """
    deep = a.shape[1] > 2
    low, high = np.zeros(3), np.zeros(3)
    for k in range(a.shape[1]):
        low[k], high[k] = np.inf, -np.inf
        for i in range(len(a)):
            low[k], high[k] = min(low[k], a[i, k]), max(high[k], a[i, k])
        low[k], high[k] = low[k] - limit, high[k] + limit
    # Only points of `b` around `a` can be near. They are chained in cells with the limit as edge.
    size = 2
    while size < 2 * len(b):
        size *= 2
    first, after = np.full(size, -1, np.int32), np.empty(len(b), np.int32)
    low_b, high_b = np.full(3, np.inf), np.full(3, -np.inf)
    for j in range(len(b)):
        x, y, z = np.float64(b[j, 0]), np.float64(b[j, 1]), np.float64(b[j, 2]) if deep else 0.0
        if low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]:
            place = place_of(cell(x, low[0], limit), cell(y, low[1], limit), cell(z, low[2], limit), size)
            after[j], first[place] = first[place], j
            low_b[0], low_b[1], low_b[2] = min(low_b[0], x), min(low_b[1], y), min(low_b[2], z)
            high_b[0], high_b[1], high_b[2] = max(high_b[0], x), max(high_b[1], y), max(high_b[2], z)
    count = 0
    for i in range(len(a)):
        x, y, z = np.float64(a[i, 0]), np.float64(a[i, 1]), np.float64(a[i, 2]) if deep else 0.0
        apart = (x < low_b[0] - limit) | (x > high_b[0] + limit) | (y < low_b[1] - limit) | (y > high_b[1] + limit)
        if apart or z < low_b[2] - limit or z > high_b[2] + limit:
            continue
        count += has_near(x, y, z, b, deep, low, limit, first, after)
        if count >= enough:
            break
    return count


@kernel(inline="always")
def cell(x, low, limit):
    """Return the index of a coordinate's cell; cells begin at `low` and have the limit as edge."""
    return np.int64(np.floor((x - low) / limit))


@kernel(inline="always")
def place_of(i, j, k, size):
    """Return the slot of a cell in a table whose size is a power of two; cells that share a slot do no harm."""
    return scatter(pack_key(i, j, k)) & (size - 1)


@kernel
def has_near(x, y, z, b, deep, low, limit, first, after):
    """Return whether any point of `b` lies nearer than a limit to a place; see `count_near`."""
    i, j, k = cell(x, low[0], limit), cell(y, low[1], limit), cell(z, low[2], limit)
    size, square = len(first), limit * limit
    # Its own cell first, because a near point is usually there.
    for n in range(27 if deep else 9):
        di, dj, dk = (n + 1) % 3 - 1, (n // 3 + 1) % 3 - 1, (n // 9 + 1) % 3 - 1
        at = first[place_of(i + di, j + dj, k + (dk if deep else 0), size)]
        while at >= 0:
            dx, dy, dz = b[at, 0] - x, b[at, 1] - y, b[at, 2] - z if deep else 0.0
            if dx * dx + dy * dy + dz * dz < square:
                return True
            at = after[at]
    return False
