"""Hot loop of the search for what moves: which readings lie where earlier frames saw free space."""

from __future__ import annotations

import numpy as np

from cuboid.core.compiled import kernel
from cuboid.core.tolerances import JUMP_SIGMAS, NEAREST_M


@kernel(error_model="numpy")
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
    fx, fy = 1.0 / camera[0], 1.0 / camera[1]
    # Motions to pixels of each reference.
    P = np.empty((references.shape[0], 3, 4))
    for k in range(references.shape[0]):
        for i in range(4):
            P[k, 0, i] = cameras[k, 0] * T_reference_camera[k, 0, i] + cameras[k, 2] * T_reference_camera[k, 2, i]
            P[k, 1, i] = cameras[k, 1] * T_reference_camera[k, 1, i] + cameras[k, 3] * T_reference_camera[k, 2, i]
            P[k, 2, i] = T_reference_camera[k, 2, i]
    for v in range(height):
        for u in range(width):
            z, bits = depth[v, u], 0
            freed[v, u] = 0
            if z <= 0.0:
                continue
            x, y = (u - camera[2]) * fx * z, (v - camera[3]) * fy * z
            for k in range(references.shape[0]):
                there = P[k, 2, 0] * x + P[k, 2, 1] * y + P[k, 2, 2] * z + P[k, 2, 3]
                if there < NEAREST_M:
                    continue
                scale = 1.0 / there
                # To the nearest pixel.
                column = (P[k, 0, 0] * x + P[k, 0, 1] * y + P[k, 0, 2] * z + P[k, 0, 3]) * scale + 0.5
                row = (P[k, 1, 0] * x + P[k, 1, 1] * y + P[k, 1, 2] * z + P[k, 1, 3]) * scale + 0.5
                if column < 0.0 or row < 0.0 or column >= width or row >= height:
                    continue
                behind = references[k, int(row), int(column)]
                # Both readings err: the farther one more.
                if behind - there > error_m[k] + JUMP_SIGMAS * noise * behind * behind:
                    bits |= 1 << k
            freed[v, u] = bits


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
