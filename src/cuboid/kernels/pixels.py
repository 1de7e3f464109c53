"""Hot loops over the pixels of one frame: height above the plane beneath, mixed pixels."""

from __future__ import annotations

import numpy as np
from numba import njit

from cuboid.tolerances import JUMP_M, SIGMAS


@njit(cache=True, nogil=True)
def drop_mixed(depth, jump, out):
    """Copy depth without mixed pixels: readings that hang between a nearer and a farther neighbour.

    A reading goes when, along a row or a column, one neighbour is nearer and the other farther by more than
    `jump` times z squared, plus `JUMP_M`.
    """
    height, width = depth.shape
    out[:] = depth
    for v in range(1, height - 1):
        above, row, below, clean = depth[v - 1], depth[v], depth[v + 1], out[v]
        # Without a branch: so one instruction takes several pixels.
        for u in range(1, width - 1):
            z = row[u]
            limit = JUMP_M + jump * z * z
            mixed = hangs(row[u - 1], z, row[u + 1], limit) | hangs(above[u], z, below[u], limit)
            clean[u] = np.float32(0.0) if mixed else z


@njit(cache=True, nogil=True, inline="always")
def hangs(before, z, after, limit):
    """Tell whether a reading lies between a nearer and a farther neighbour, far from both."""
    near, far = before - z, z - after
    known = (before > 0.0) & (z > 0.0) & (after > 0.0)
    return known & (near * far > 0.0) & (min(abs(near), abs(far)) > limit)


@njit(cache=True, nogil=True, error_model="numpy")
def stand_on(
    depth, camera, T_grid_camera, planes_camera, numbers, ground, origin, cell, patches, patch, noise, floor, bias,
    max_depth, heights, support, seen,
):  # fmt: skip
    """Find for each pixel the supporting plane beneath it and its height above that plane.

    Parameters
    ----------
    depth : (H, W) float32
    camera : (4,) float64
        fx, fy, cx, cy.
    T_grid_camera : (4, 4) float64
        Carries camera coordinates to the grid frame, whose third axis is up.
    planes_camera : (P, 4) float64
        Each plane in the camera frame, as this frame sees it: normal (up) and offset, n.p + d = height.
    numbers : (P,) int32
        What each plane is called in `patches`.
    ground : (P, N, M) uint8
        Cells that each plane covers (1), holes beneath objects filled.
    origin : (2,) float64
        Grid coordinates of the corner of cell (0, 0), metres.
    cell : float
        Edge of a cell, metres.
    patches : (H // patch, W // patch) int32
        Plane that each patch of the image lies on, -1 none.
    patch : int
        Edge of a patch, pixels.
    noise : float
        Standard deviation of depth is noise * z * z.
    floor, bias : float
        A reading is off its plane from max(floor, bias + 3 standard deviations of its height), metres.
    max_depth : float
    heights : (H, W) float32, output
        Metres above the plane beneath, NaN without one.
    support : (H, W) int32, output
        Plane beneath, 0..P-1, -1 none.
    seen : (P, N, M) int32, in and out
        Readings that lie on each plane, by cell; only those of patches that lie on it as a whole.

    Notes
    -----
    A reading on a plane gets height 0.
    """
    rows, columns = depth.shape
    count = planes_camera.shape[0]
    nx_cells, ny_cells = ground.shape[1], ground.shape[2]
    # Local copies: what is written below could lie in these arrays, for all the compiler knows.
    xx, xy, xz, x0 = T_grid_camera[0]
    yx, yy, yz, y0 = T_grid_camera[1]
    left, top = origin[0], origin[1]
    across, patch_of = (np.arange(columns) - camera[2]) / camera[0], np.arange(columns) // patch
    for v in range(rows):
        ry, pr = (v - camera[3]) / camera[1], v // patch
        for u in range(columns):
            support[v, u] = -1
            heights[v, u] = np.nan
            z = depth[v, u]
            if not (0.0 < z <= max_depth):
                continue
            rx = across[u]
            x, y = rx * z, ry * z
            gx = xx * x + xy * y + xz * z + x0
            gy = yx * x + yy * y + yz * z + y0
            ix = int(np.floor((gx - left) / cell))
            iy = int(np.floor((gy - top) / cell))
            if ix < 0 or iy < 0 or ix >= nx_cells or iy >= ny_cells:
                continue
            pc = patch_of[u]
            on = patches[pr, pc] if pr < patches.shape[0] and pc < patches.shape[1] else -1
            best = np.inf
            # No limit below is larger: what is farther from a plane than this is not on it.
            most = max(floor, bias + (SIGMAS + 0.01) * noise * z * z * (abs(rx) + abs(ry) + 1.0))
            for p in range(count):
                n0, n1, n2 = planes_camera[p, 0], planes_camera[p, 1], planes_camera[p, 2]
                h = n0 * x + n1 * y + n2 * z + planes_camera[p, 3]
                if h < -most or (h > most and h >= best):
                    continue
                spread = noise * z * z * abs(n0 * rx + n1 * ry + n2)
                limit = max(floor, bias + SIGMAS * spread)
                if abs(h) < limit:
                    if on == numbers[p]:
                        seen[p, ix, iy] += 1
                    if ground[p, ix, iy]:
                        best = 0.0
                        support[v, u] = p
                        break
                elif limit <= h < best and ground[p, ix, iy]:
                    best = h
                    support[v, u] = p
            if best < np.inf:
                heights[v, u] = best
