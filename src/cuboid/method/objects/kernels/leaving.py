"""Hot loop: counts the points of an object that a frame sees at their place, and those that it sees through."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import JUMP_SIGMAS, NEAREST_M


@kernel
def count_passed(points, depth, camera, T_camera_world, margin, noise):
    """Count the points of an object that a frame sees in their place, and those that it sees through.

    Parameters
    ----------
    points : (N, 3) float32
        World, metres.
    depth : (h, w) float32
        Metres, 0 none.
    camera : (4,) float64
        fx, fy, cx, cy.
    T_camera_world : (4, 4) float64
    margin, noise : float
        A reading agrees with a point within the margin, metres, plus four standard deviations, noise times z squared.
        A point is seen through if all nine readings around it lie farther behind.

    Returns
    -------
    (int, int)
        Points in their place, and points seen through; the others are hidden or unknown.
    """
    height, width = depth.shape
    T = T_camera_world
    in_place = passed = 0
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        ahead = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if ahead < NEAREST_M:
            continue
        u = int(np.rint((T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / ahead * camera[0] + camera[2]))
        v = int(np.rint((T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / ahead * camera[1] + camera[3]))
        if u < 1 or v < 1 or u >= width - 1 or v >= height - 1:
            continue
        within = margin + JUMP_SIGMAS * noise * ahead * ahead
        if depth[v, u] <= 0.0 or depth[v, u] < ahead - within:
            continue
        if depth[v, u] <= ahead + within:
            in_place += 1
            continue
        through = True
        for dv in range(-1, 2):
            for du in range(-1, 2):
                through &= depth[v + dv, u + du] > ahead + within
        passed += through
    return in_place, passed
