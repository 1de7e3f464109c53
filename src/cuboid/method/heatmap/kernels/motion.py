"""Hot loop of the search for moving readings: marks grow over the surface on which they lie."""

from __future__ import annotations

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import JUMP_SIGMAS


@kernel
def grow(depth, marked, step_m, noise, out):
    """Mark the neighbours of marked pixels that lie on the same surface.

    Parameters
    ----------
    depth : (h, w) float32
    marked : (h, w) uint8
    step_m, noise : float
        Neighbours on one surface differ by less than this, and by four deviations of depth.
    out : (h, w) uint8, output
        The marked pixels and the new ones.
    """
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if marked[v, u] or z <= 0.0:
                continue
            limit = step_m + JUMP_SIGMAS * noise * z * z
            for dv, du in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                i, j = v + dv, u + du
                if 0 <= i < height and 0 <= j < width and marked[i, j] and abs(depth[i, j] - z) < limit:
                    out[v, u] = 1
