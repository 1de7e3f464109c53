"""Hot loops of a correction of poses: points that move with their keyframes, and the planes that they lie on."""

from __future__ import annotations

import numpy as np
from numba import njit

from cuboid.kernels.cubes import (
    BLOCK_BITS,
    CUBE_BITS,
    CUBE_SIDE,
    PLACES,
    add_row,
    corner,
    find_row,
    make_cube,
    pack_key,
    voxel_in,
)
from cuboid.kernels.voxels import MOST_HITS

# Points that come one after another lie close together: so many are held against all planes at once.
TOGETHER = 256


@njit(cache=True, nogil=True)
def move(points, anchor, motions, moves, moved):
    """Move points (N, 3) with their keyframes.

    Parameters
    ----------
    points : (N, 3) float32
    anchor : (N,) uint16
        Keyframe of each.
    motions : (A, 3, 4) float64
        Of each keyframe.
    moves : (A,) bool
        Whether it moves at all.
    moved : (N, 3) float64, output
    """
    for i in range(points.shape[0]):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        T = motions[anchor[i]]
        for axis in range(3):
            if moves[anchor[i]]:
                moved[i, axis] = T[axis, 0] * x + T[axis, 1] * y + T[axis, 2] * z + T[axis, 3]
            else:
                moved[i, axis] = points[i, axis]


@njit(cache=True, nogil=True)
def leave(rows, cubes, points):
    """Let rows (N,) be dead."""
    for row in rows:
        block = row >> BLOCK_BITS
        points.weight[row] = 0.0
        points.hits[row] = points.passes[row] = points.owner[row] = points.confidence[row] = 0
        cubes.dead[cubes.cube_of[block]] += 1
        cubes.changed[block] = True


@njit(cache=True, nogil=True)
def settle(keys, taken, motions, moves, voxel_m, cubes, points, rows):
    """Let points that were taken from their cubes move with their keyframes, and enter those where they come to lie.

    Of two points that meet in a voxel place, color and heat are averaged, hits and passes add up; the oldest object's
    keeps the owner.

    Parameters
    ----------
    keys : (N,) int64
        Of the cubes that they were in.
    taken : Points
        Their columns (N, ...).
    motions, moves
        As of `move`.
    voxel_m : float
    cubes : Cubes
        All in memory.
    points : Points
    rows : (N,) int64, output
        Where each is now; -1 where there was no more room.
    """
    mask, last_key, cube = CUBE_SIDE - 1, np.int64(-1), np.int64(-1)
    inside = np.empty(3, np.int64)
    for i in range(keys.size):
        x, y, z = corner(keys[i])
        voxel, anchor = np.int64(taken.voxel[i]), taken.anchor[i]
        x, y, z = x + (voxel >> (2 * CUBE_BITS)), y + ((voxel >> CUBE_BITS) & mask), z + (voxel & mask)
        inside[:] = taken.place[i]
        if moves[anchor]:
            T = motions[anchor]
            px = (x + (inside[0] + 0.5) / PLACES) * voxel_m
            py = (y + (inside[1] + 0.5) / PLACES) * voxel_m
            pz = (z + (inside[2] + 0.5) / PLACES) * voxel_m
            qx = (T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]) / voxel_m
            qy = (T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]) / voxel_m
            qz = (T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]) / voxel_m
            x, y, z = np.int64(np.floor(qx)), np.int64(np.floor(qy)), np.int64(np.floor(qz))
            inside[0], inside[1], inside[2] = (qx - x) * PLACES, (qy - y) * PLACES, (qz - z) * PLACES
        key = pack_key(x >> CUBE_BITS, y >> CUBE_BITS, z >> CUBE_BITS)
        if key != last_key:
            last_key, cube = key, make_cube(key, cubes)
        rows[i] = -1
        if cube < 0:
            continue
        voxel = voxel_in(x, y, z)
        row, at = find_row(cube, voxel, cubes, points.voxel)
        if row < 0:
            row = add_row(cube, voxel, at, cubes, points.voxel)
            if row < 0:
                continue
            points.weight[row] = 0.0
        elif points.weight[row] <= 0.0:
            cubes.dead[cube] -= 1
        rows[i] = row
        cubes.changed[row >> BLOCK_BITS] = True
        if points.weight[row] > 0.0:
            meet(row, i, inside, taken, points)
        else:
            enter(row, i, inside, taken, points)


@njit(cache=True, nogil=True)
def enter(row, i, inside, taken, points):
    """Let a point that was taken have a row, its voxel's, and lie at a place in it."""
    points.weight[row], points.owner[row], points.last_frame[row] = taken.weight[i], taken.owner[i], taken.last_frame[i]
    for k in range(3):
        points.place[row, k] = min(inside[k], np.int64(PLACES) - 1)
        points.color[row, k] = taken.color[i, k]
    points.heat[row], points.hits[row], points.passes[row] = taken.heat[i], taken.hits[i], taken.passes[i]
    points.anchor[row], points.confidence[row], points.voted[row] = taken.anchor[i], taken.confidence[i], 0


@njit(cache=True, nogil=True)
def meet(row, i, inside, taken, points):
    """Let a point that was taken become one with that of a row."""
    weight = points.weight[row] + taken.weight[i]
    share = np.float64(taken.weight[i]) / weight
    points.weight[row] = weight
    for k in range(3):
        points.place[row, k] = mean(points.place[row, k], min(inside[k], np.int64(PLACES) - 1), share)
        points.color[row, k] = mean(points.color[row, k], taken.color[i, k], share)
    points.heat[row] = mean(points.heat[row], taken.heat[i], share)
    points.hits[row] = min(np.int64(points.hits[row]) + taken.hits[i], MOST_HITS)
    points.passes[row] = min(np.int64(points.passes[row]) + taken.passes[i], MOST_HITS)
    one, other = points.owner[row], taken.owner[i]
    points.owner[row] = min(one, other) if min(one, other) > 0 else max(one, other)
    points.last_frame[row] = max(points.last_frame[row], taken.last_frame[i])
    points.anchor[row] = max(points.anchor[row], taken.anchor[i])
    points.confidence[row] = max(points.confidence[row], taken.confidence[i])


@njit(cache=True, nogil=True, inline="always")
def mean(one, other, share):
    """Return the mean of two whole numbers of which the other has a share."""
    return np.int64(one + share * (np.int64(other) - np.int64(one)) + 0.5)


@njit(cache=True, nogil=True)
def on_planes(points, R, normals, offsets, windows, first, covered, off_m, cell_m, plane, point):
    """Find which points lie on which planes: close to them, and where these cover the ground.

    Parameters
    ----------
    points : (N, 3) float32
        Those that come one after another lie close together, or this takes long.
    R : (3, 3) float64
        Carries them to the plan frame.
    normals : (P, 3) float64
    offsets : (P,) float64
    windows : (P, 4) int64
        First cell of each plane's window and the one past the last.
    first : (P,) int64
        Where the cells of each begin.
    covered : (C,) uint8
        Cells of all windows, by row.
    off_m, cell_m : float
        Points are on a plane that are so close to it; edge of a cell.
    plane, point : (M,) int32, output
        Pairs, by point, as many as there is room for.

    Returns
    -------
    int
        How many pairs there are.
    """
    count = 0
    likely, plan = np.empty(offsets.size, np.int64), np.empty((TOGETHER, 3))
    for begin in range(0, points.shape[0], TOGETHER):
        these = min(TOGETHER, points.shape[0] - begin)
        for i in range(these):
            wx, wy, wz = np.float64(points[begin + i, 0]), np.float64(points[begin + i, 1]), points[begin + i, 2]
            for axis in range(3):
                plan[i, axis] = R[axis, 0] * wx + R[axis, 1] * wy + R[axis, 2] * wz
        some = near_some(plan[:these], normals, offsets, windows, off_m, cell_m, likely)
        for i in range(these) if some else range(0):
            x, y, z = plan[i, 0], plan[i, 1], plan[i, 2]
            row, column = np.int64(np.floor(x / cell_m)), np.int64(np.floor(y / cell_m))
            for k in likely[:some]:
                if abs(normals[k, 0] * x + normals[k, 1] * y + normals[k, 2] * z + offsets[k]) >= off_m:
                    continue
                low, left, high, right = windows[k, 0], windows[k, 1], windows[k, 2], windows[k, 3]
                if not (low <= row < high and left <= column < right):
                    continue
                if covered[first[k] + (row - low) * (right - left) + column - left]:
                    if count < plane.size:
                        plane[count], point[count] = k, begin + i
                    count += 1
    return count


@njit(cache=True, nogil=True)
def near_some(points, normals, offsets, windows, off_m, cell_m, likely):
    """Find the planes that any of some points can lie on, by the box around these; return how many there are."""
    low, high = points[0].copy(), points[0].copy()
    for i in range(1, points.shape[0]):
        for k in range(3):
            low[k], high[k] = min(low[k], points[i, k]), max(high[k], points[i, k])
    count = 0
    for k in range(offsets.size):
        window, off, half = windows[k], offsets[k], 0.0
        if high[0] < window[0] * cell_m or high[1] < window[1] * cell_m:
            continue
        if low[0] > window[2] * cell_m or low[1] > window[3] * cell_m:
            continue
        for axis in range(3):
            off += normals[k, axis] * (low[axis] + high[axis]) / 2
            half += abs(normals[k, axis]) * (high[axis] - low[axis]) / 2
        if abs(off) < off_m + half + 1e-9:
            likely[count] = k
            count += 1
    return count


@njit(cache=True, nogil=True)
def keep_cells(cells, before, offset, least, after, window):
    """Keep the readings of the cells that points lie in; those with several points have as many as need be.

    Parameters
    ----------
    cells : (N, 2) int64
        Of the points, in the window; those outside of it count for nothing.
    before : (h, w) int32
        Readings by cell, in a window that is no larger.
    offset : (2,) int64
        The window's first cell in that one.
    least : int
        Readings that several points stand for.
    after : (H, W) int32, output
        Zeros.
    window : (4,) int64, output
        Around the cells that have so many readings: the first one, and the one past the last.

    Returns
    -------
    int
        How many cells have so many readings.
    """
    height, width = after.shape
    known = 0
    window[0], window[1], window[2], window[3] = height, width, 0, 0
    for turn in range(3):
        for n in range(cells.shape[0]):
            i, j = cells[n]
            if not (0 <= i < height and 0 <= j < width):
                continue
            if turn == 0:  # count
                after[i, j] += 1
            elif turn == 1 and after[i, j] > 0:  # below 0: done
                x, y = i + offset[0], j + offset[1]
                inside = 0 <= x < before.shape[0] and 0 <= y < before.shape[1]
                readings = np.int64(before[x, y]) if inside else 0
                readings = max(readings, least) if after[i, j] > 1 else readings
                if readings >= least:
                    known += 1
                    window[0], window[1] = min(window[0], i), min(window[1], j)
                    window[2], window[3] = max(window[2], i + 1), max(window[3], j + 1)
                after[i, j] = -1 - readings
            elif turn == 2 and after[i, j] < 0:
                after[i, j] = -1 - after[i, j]
    return known
