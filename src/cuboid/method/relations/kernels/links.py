"""Hot loop: the connected parts of a cloud of points."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.method.objects.kernels.nearness import cell, place_of
from cuboid.method.surfaces.kernels.pieces import find_root


@kernel
def number_parts(points, limit, part):
    """Number the connected parts of points: two points whose distance is at most the limit belong to one part.

    Parameters
    ----------
    points : (N, 3) float64
    limit : float
        Above 0.
    part : (N,) int32, output
        From 0 in the order of their first point.

    Returns
    -------
    int
        Number of parts.
    """
    count = len(points)
    low = np.full(3, np.inf)
    for i in range(count):
        for axis in range(3):
            low[axis] = min(low[axis], points[i, axis])
    # The points before this one are chained in cells with the limit as edge.
    size = 2
    while size < 2 * count:
        size *= 2
    first, after, parent = np.full(size, -1, np.int32), np.empty(count, np.int32), np.empty(count, np.int32)
    for i in range(count):
        parent[i] = i
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        a, b, c = cell(x, low[0], limit), cell(y, low[1], limit), cell(z, low[2], limit)
        for n in range(27):
            near = first[place_of(a + n % 3 - 1, b + n // 3 % 3 - 1, c + n // 9 - 1, size)]
            while near >= 0:
                dx, dy, dz = points[near, 0] - x, points[near, 1] - y, points[near, 2] - z
                if dx * dx + dy * dy + dz * dz <= limit * limit:
                    one, other = find_root(parent, i), find_root(parent, near)
                    parent[max(one, other)] = min(one, other)
                near = after[near]
        place = place_of(a, b, c, size)
        after[i], first[place] = first[place], i
    parts = 0
    for i in range(count):
        root = find_root(parent, i)
        if root == i:  # the first point of its part
            part[i] = parts
            parts += 1
        else:
            part[i] = part[root]
    return parts
