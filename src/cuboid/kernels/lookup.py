"""Hot loops that look into the cubes of the map: which are in view, which row is where, where a row is."""

from __future__ import annotations

import numpy as np
from numba import njit

from cuboid.kernels.cubes import (
    BLOCK_BITS,
    CUBE_BITS,
    CUBE_SIDE,
    PLACES,
    corner,
    find_cube,
    find_row,
    pack_key,
    voxel_in,
)


@njit(cache=True, nogil=True)
def rows_at(points, voxel_m, cubes, voxels, weights, rows, missing):
    """Find for each point (N, 3) the row of the living voxel there, -1 none; written to `rows` (N,) int64.

    Returns how many points lie in cubes that are not in memory; `missing` (N,) int64 begins with these cubes.
    """
    inverse, absent = 1.0 / voxel_m, 0
    for i in range(points.shape[0]):
        ix = np.int64(np.floor(points[i, 0] * inverse))
        iy = np.int64(np.floor(points[i, 1] * inverse))
        iz = np.int64(np.floor(points[i, 2] * inverse))
        rows[i] = -1
        cube, _ = find_cube(pack_key(ix >> CUBE_BITS, iy >> CUBE_BITS, iz >> CUBE_BITS), cubes)
        if cube < 0:
            continue
        if cubes.bits[cube] == 0:
            missing[absent] = cube
            absent += 1
            continue
        row, _ = find_row(cube, voxel_in(ix, iy, iz), cubes, voxels)
        if row >= 0 and weights[row] > 0.0:
            rows[i] = row
    return absent


@njit(cache=True, nogil=True)
def places(rows, voxel_m, cubes, points, xyz):
    """Write where in the world the points of rows (N,) are to `xyz` (N, 3) float32."""
    mask = CUBE_SIDE - 1
    for i in range(rows.size):
        row = rows[i]
        x, y, z = corner(cubes.key[cubes.cube_of[row >> BLOCK_BITS]])
        voxel, place = np.int64(points.voxel[row]), points.place[row]
        xyz[i, 0] = (x + (voxel >> (2 * CUBE_BITS)) + (place[0] + 0.5) / PLACES) * voxel_m
        xyz[i, 1] = (y + ((voxel >> CUBE_BITS) & mask) + (place[1] + 0.5) / PLACES) * voxel_m
        xyz[i, 2] = (z + (voxel & mask) + (place[2] + 0.5) / PLACES) * voxel_m


@njit(cache=True, nogil=True)
def in_view(T_camera_world, camera, width, height, far_m, voxel_m, cubes, seen):
    """Find the cubes that reach into a picture, and no farther than some distance; by their spheres.

    Parameters
    ----------
    T_camera_world : (4, 4) float64
    camera : (4,) float64
        fx, fy, cx, cy.
    width, height : int
    far_m, voxel_m : float
    cubes : Cubes
    seen : (C,) int64, output
        Begins with them, ascending.

    Returns
    -------
    int
        How many there are.
    """
    T, count = T_camera_world, 0
    fx, fy = camera[0], camera[1]
    # A pixel more on each side than there is.
    left, right, top, bottom = camera[2] + 1.0, width - camera[2], camera[3] + 1.0, height - camera[3]
    along_left, along_right = np.sqrt(fx * fx + left * left), np.sqrt(fx * fx + right * right)
    along_top, along_bottom = np.sqrt(fy * fy + top * top), np.sqrt(fy * fy + bottom * bottom)
    half = 0.5 * CUBE_SIDE * voxel_m
    radius = 1.74 * half
    for cube in range(cubes.used[0]):
        ix, iy, iz = corner(cubes.key[cube])
        px, py, pz = ix * voxel_m + half, iy * voxel_m + half, iz * voxel_m + half
        z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
        if z < -radius or z > far_m + radius:
            continue
        x = T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]
        if fx * x + left * z < -radius * along_left or right * z - fx * x < -radius * along_right:
            continue
        y = T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]
        if fy * y + top * z < -radius * along_top or bottom * z - fy * y < -radius * along_bottom:
            continue
        seen[count] = cube
        count += 1
    return count
