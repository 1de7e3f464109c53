"""Hot loops: steps of color across the expected edges of a top, and their sums along moved edges."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import NEAREST_M


@kernel
def color_steps(color, camera, T_camera_map, places, outward, first_m, step_m, lag, max_step, steps):
    """Find the steps of color along lines across an edge.

    Parameters
    ----------
    color : (H, W, 3) uint8
    camera : (4,) float64
        fx, fy, cx, cy.
    T_camera_map : (4, 4) float64
    places, outward : (S, 3) float64
        A place of the expected edge and the unit direction across it, for each line, in the map.
    first_m, step_m : float
        Offset of the first point of a line from its place, and distance of its points, metres.
    lag : int
        A step is the difference of the colors at this many points before and after.
    max_step : float
        Larger steps count as this, levels.
    steps : (S, P, 3) float64, output
        By channel; 0 where a point is not in the image.
    """
    count = steps.shape[1] + 2 * lag
    height, width = color.shape[0], color.shape[1]
    line, inside = np.empty((count, 3)), np.empty(count, np.bool_)
    for i in range(places.shape[0]):
        for k in range(count):
            along = first_m + (k - lag) * step_m
            x, y, z = T_camera_map[0, 3], T_camera_map[1, 3], T_camera_map[2, 3]
            for j in range(3):
                p = places[i, j] + along * outward[i, j]
                x += T_camera_map[0, j] * p
                y += T_camera_map[1, j] * p
                z += T_camera_map[2, j] * p
            u, v = -1.0, -1.0
            if z > NEAREST_M:
                u, v = camera[0] * x / z + camera[2], camera[1] * y / z + camera[3]
            inside[k] = 0.0 <= u < width - 1.0 and 0.0 <= v < height - 1.0
            if not inside[k]:
                continue
            c, r = int(u), int(v)
            a, b = u - c, v - r
            for channel in range(3):
                upper = (1.0 - a) * color[r, c, channel] + a * color[r, c + 1, channel]
                lower = (1.0 - a) * color[r + 1, c, channel] + a * color[r + 1, c + 1, channel]
                line[k, channel] = (1.0 - b) * upper + b * lower
        for k in range(steps.shape[1]):
            for channel in range(3):
                steps[i, k, channel] = 0.0
                if inside[k] and inside[k + 2 * lag]:
                    steps[i, k, channel] = max(-max_step, min(line[k + 2 * lag, channel] - line[k, channel], max_step))


@kernel
def sums_along(steps, shifts, group, sums):
    """Find the mean step along each moved edge: of groups of neighbouring lines, in which texture averages out.

    Parameters
    ----------
    steps : (S, 3 P) float64
        From `color_steps`.
    shifts : (M, S) int64
        Shift of an edge at each line, for each tried form of the edge, points; at least 0.
    group : int
        Number of neighbouring lines whose steps have the same sign.
    sums : (M, O) float64, output
        Mean step for each form and offset, summed over the channels: the point `shift + offset` of each line.
    """
    lines, width = steps.shape[0], sums.shape[1]
    signed, total = np.empty(3 * width), np.empty(3 * width)
    for m in range(shifts.shape[0]):
        total[:] = 0.0
        for first in range(0, lines, group):
            signed[:] = 0.0
            for i in range(first, min(first + group, lines)):
                start = 3 * shifts[m, i]
                for k in range(3 * width):
                    signed[k] += steps[i, start + k]
            for k in range(3 * width):
                total[k] += abs(signed[k])
        for o in range(width):
            sums[m, o] = (total[3 * o] + total[3 * o + 1] + total[3 * o + 2]) / lines
