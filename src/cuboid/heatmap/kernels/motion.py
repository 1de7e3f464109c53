"""Hot loop of the search for what moves: which readings lie where earlier frames saw free space."""

from __future__ import annotations

import numpy as np

from cuboid.core.compiled import kernel
from cuboid.core.tolerances import JUMP_SIGMAS, NEAREST_M


@kernel
def mark_freed(depth, camera, references, cameras, T_reference_camera, error_m, noise, freed):
    """Mark the readings of an image that lie where earlier images saw free space.

    Parameters
    ----------
    depth : (h, w) float32
        Metres, 0 none.
    camera : (4,) float64
        fx, fy, cx, cy of it.
    references : (K, h, w) float32
        The nearest reading around each pixel of an earlier image, metres; 0 where one of them is missing.
    cameras : (K, 4) float64
        Of the references.
    T_reference_camera : (K, 4, 4) float64
    error_m : (K,) float64
        How far the poses of image and reference may be off, one from the other, metres.
    noise : float
        Standard deviation of depth is this times z squared.
    freed : (h, w) uint8, output
        Bit k is set where reference k saw what lies behind the reading.
    """
    height, width = depth.shape
    freed[:] = 0
    for k in range(references.shape[0]):
        T, reference = T_reference_camera[k], references[k]
        xx, xy, xz, x0 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
        yx, yy, yz, y0 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
        zx, zy, zz, z0 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
        fx, fy, cx, cy = cameras[k, 0], cameras[k, 1], cameras[k, 2], cameras[k, 3]
        bit = np.uint8(1 << k)
        for v in range(height):
            ray_y = (v - camera[3]) / camera[1]
            for u in range(width):
                z = depth[v, u]
                if z <= 0.0:
                    continue
                x, y = (u - camera[2]) / camera[0] * z, ray_y * z
                there = zx * x + zy * y + zz * z + z0
                if there < NEAREST_M:
                    continue
                column = int(np.rint((xx * x + xy * y + xz * z + x0) / there * fx + cx))
                row = int(np.rint((yx * x + yy * y + yz * z + y0) / there * fy + cy))
                if column < 0 or row < 0 or column >= width or row >= height:
                    continue
                behind = reference[row, column]
                # Both readings err: the farther one more.
                if behind - there > error_m[k] + JUMP_SIGMAS * noise * behind * behind:
                    freed[v, u] |= bit


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
        The marked pixels, and these.
    """
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if marked[v, u] or z <= 0.0:
                continue
            most = step_m + JUMP_SIGMAS * noise * z * z
            for dv, du in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                i, j = v + dv, u + du
                if 0 <= i < height and 0 <= j < width and marked[i, j] and abs(depth[i, j] - z) < most:
                    out[v, u] = 1
