"""Hot loop: the shift at which a rigid cluster of points fits an image, in shape and color."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import JUMP_SIGMAS, NEAREST_M


@kernel
def score_shifts(points, normals, colors, shifts, view, camera, T_camera_world, margin, noise, max_difference, counts):
    """Count, for each of several shifts of a cluster, the points that a frame confirms, and those it sees through.

    Parameters
    ----------
    points, normals : (N, 3) float32
        World.
    colors : (N, 3) uint8
    shifts : (S, 3) float64
        World, metres.
    view : (depth (h, w) float32, color (h, w, 3) uint8)
    camera : (4,) float64
        fx, fy, cx, cy.
    T_camera_world : (4, 4) float64
    margin, noise : float
        A reading agrees with a point within the margin, metres, plus four standard deviations, noise times z squared.
    max_difference : int
        Largest difference per channel, of 255, between colors that agree.
    counts : (S, 3) int64, output
        Points that face the camera: those that agree, those seen through, and all inside the image.
    """
    depth, color = view
    height, width = depth.shape
    T = T_camera_world
    counts[:] = 0
    for s in range(shifts.shape[0]):
        for k in range(points.shape[0]):
            x, y, z = points[k, 0] + shifts[s, 0], points[k, 1] + shifts[s, 1], points[k, 2] + shifts[s, 2]
            across = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
            down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
            ahead = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            if ahead < NEAREST_M:
                continue
            nx = T[0, 0] * normals[k, 0] + T[0, 1] * normals[k, 1] + T[0, 2] * normals[k, 2]
            ny = T[1, 0] * normals[k, 0] + T[1, 1] * normals[k, 1] + T[1, 2] * normals[k, 2]
            nz = T[2, 0] * normals[k, 0] + T[2, 1] * normals[k, 1] + T[2, 2] * normals[k, 2]
            if nx * across + ny * down + nz * ahead > 0.0:
                continue
            u = int(np.rint(across / ahead * camera[0] + camera[2]))
            v = int(np.rint(down / ahead * camera[1] + camera[3]))
            if u < 0 or v < 0 or u >= width or v >= height:
                continue
            counts[s, 2] += 1
            reading, within = depth[v, u], margin + JUMP_SIGMAS * noise * ahead * ahead
            if reading <= 0.0 or reading < ahead - within:
                continue
            if reading > ahead + within:
                counts[s, 1] += 1
                continue
            same = True
            for c in range(3):
                same &= abs(np.int64(color[v, u, c]) - np.int64(colors[k, c])) <= max_difference
            counts[s, 0] += same
