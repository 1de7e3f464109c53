"""Hot loop of the search for moving pixels: readings in the free space of earlier images."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import JUMP_SIGMAS, NEAREST_M


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
        Bit k is set where reference k saw a surface behind the reading.
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
                depth_there = P[k, 2, 0] * x + P[k, 2, 1] * y + P[k, 2, 2] * z + P[k, 2, 3]
                if depth_there < NEAREST_M:
                    continue
                scale = 1.0 / depth_there
                # To the nearest pixel.
                column = (P[k, 0, 0] * x + P[k, 0, 1] * y + P[k, 0, 2] * z + P[k, 0, 3]) * scale + 0.5
                row = (P[k, 1, 0] * x + P[k, 1, 1] * y + P[k, 1, 2] * z + P[k, 1, 3]) * scale + 0.5
                if column < 0.0 or row < 0.0 or column >= width or row >= height:
                    continue
                behind = references[k, int(row), int(column)]
                # Both readings err: the farther one more.
                if behind - depth_there > error_m[k] + JUMP_SIGMAS * noise * behind * behind:
                    bits |= 1 << k
            freed[v, u] = bits


@kernel(error_model="numpy")
def mark_unseen(depth, camera, references, T_reference_camera, error_m, noise, unseen):
    """Mark the readings of an image that lie where no earlier image saw anything.

    Parameters
    ----------
    depth : (h, w) float32
        Metres, 0 none.
    camera : (4,) float64
        fx, fy, cx, cy of it and of the references.
    references : (K, h, w) float32
        The farthest reading around each pixel of an earlier image, metres; 0 if there is none.
    T_reference_camera : (K, 4, 4) float64
    error_m : float
        Error of the poses, metres.
    noise : float
        Standard deviation of depth is this times z squared.
    unseen : (h, w) uint8, output
        1 if the reading is outside of all references, or hidden in them.
    """
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            unseen[v, u] = z > 0.0
            if z <= 0.0:
                continue
            x, y = (u - camera[2]) / camera[0] * z, (v - camera[3]) / camera[1] * z
            for k in range(references.shape[0]):
                T = T_reference_camera[k]
                depth_there = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
                if depth_there < NEAREST_M:
                    continue
                column = camera[0] * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / depth_there + camera[2] + 0.5
                row = camera[1] * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / depth_there + camera[3] + 0.5
                if column < 0.0 or row < 0.0 or column >= width or row >= height:
                    continue
                farthest = references[k, int(row), int(column)]
                if depth_there - farthest <= error_m + JUMP_SIGMAS * noise * depth_there * depth_there:
                    unseen[v, u] = 0
                    break


@kernel
def spread(depth, marked, allowed, step_m, noise):
    """Spread marks over the surfaces on which they lie, as far as allowed.

    Parameters
    ----------
    depth : (h, w) float32
        Metres, 0 none.
    marked : (h, w) uint8, changed
    allowed : (h, w) uint8
        Marks spread to these pixels alone.
    step_m, noise : float
        Adjacent pixels of one surface differ by less than this plus four standard deviations of depth.
    """
    height, width = depth.shape
    reached = np.empty((height * width, 2), np.int64)
    count = 0
    for v in range(height):
        for u in range(width):
            if marked[v, u]:
                reached[count, 0], reached[count, 1] = v, u
                count += 1
    at = 0
    while at < count:
        v, u = reached[at, 0], reached[at, 1]
        at += 1
        z = depth[v, u]
        max_step = step_m + JUMP_SIGMAS * noise * z * z
        for dv, du in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            i, j = v + dv, u + du
            if not (0 <= i < height and 0 <= j < width) or marked[i, j] or not allowed[i, j]:
                continue
            if depth[i, j] > 0.0 and abs(depth[i, j] - z) < max_step:
                marked[i, j] = 1
                reached[count, 0], reached[count, 1] = i, j
                count += 1
