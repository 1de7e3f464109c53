"""Hot loops of pose corrections: points move with the keyframes to which they are anchored."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.method.heatmap.kernels.cubes import (
    BLOCK_BITS,
    CUBE_BITS,
    CUBE_SIDE,
    FINE,
    PLACES,
    add_row,
    corner,
    edge_of,
    find_row,
    make_cube,
    pack_key,
    row_of,
    voxel_in,
)
from cuboid.method.heatmap.kernels.voxels import MAX_HITS


@kernel
def pending_rows(chosen, cubes, points, rows):
    """Find the living rows of some cubes with a pending motion.

    Parameters
    ----------
    chosen : (N,) int64
        Cubes in memory.
    cubes : Cubes
    points : Points
    rows : (M,) int64, output
        Its first entries are the rows, cube by cube.

    Returns
    -------
    int
        Number of rows.
    """
    count = 0
    for cube in chosen:
        for k in range(cubes.rows[cube]):
            row = row_of(cube, k, cubes.blocks)
            if cubes.pending[points.anchor[row]] and points.weight[row] > 0.0:
                rows[count] = row
                count += 1
    return count


@kernel
def remove_pending(chosen, cubes, points):
    """Remove all rows of some cubes (N,) with a pending motion."""
    for cube in chosen:
        for k in range(cubes.rows[cube]):
            row = row_of(cube, k, cubes.blocks)
            if cubes.pending[points.anchor[row]] and points.weight[row] > 0.0:
                points.weight[row] = 0.0
                cubes.dead[cube] += 1


@kernel
def apply_motions(keys, taken, pending, motions, voxel_m, new_keys):
    """Apply pending motions to points that were removed from their cubes.

    Parameters
    ----------
    keys : (N,) int64
        Keys of their cubes before the motion; replaced by the keys of their cubes after it.
    taken : Points
        Their columns (N, ...); voxel and place are updated.
    pending : (ANCHORS,) bool
    motions : (ANCHORS, 3, 4) float64
        The motion of each anchor.
    voxel_m : float
    new_keys : (N,) int64, output
        Its first entries are the keys of the new cubes; a key may occur more than once.

    Returns
    -------
    int
        Number of these entries.
    """
    mask, count = CUBE_SIDE - 1, 0
    for i in range(keys.size):
        x, y, z = corner(keys[i])
        voxel, anchor, place = np.int64(taken.voxel[i]), taken.anchor[i], taken.place[i]
        x, y, z = x + (voxel >> (2 * CUBE_BITS)), y + ((voxel >> CUBE_BITS) & mask), z + (voxel & mask)
        if pending[anchor]:
            T, edge_m = motions[anchor], edge_of(keys[i], voxel_m)
            px = (x + (place[0] + 0.5) / PLACES) * edge_m
            py = (y + (place[1] + 0.5) / PLACES) * edge_m
            pz = (z + (place[2] + 0.5) / PLACES) * edge_m
            qx = (T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]) / edge_m
            qy = (T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]) / edge_m
            qz = (T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]) / edge_m
            x, y, z = np.int64(np.floor(qx)), np.int64(np.floor(qy)), np.int64(np.floor(qz))
            place[0], place[1], place[2] = quantised(qx - x), quantised(qy - y), quantised(qz - z)
            keys[i] = pack_key(x >> CUBE_BITS, y >> CUBE_BITS, z >> CUBE_BITS) | (keys[i] & FINE)
            taken.voxel[i] = voxel_in(x, y, z)
        if count == 0 or new_keys[count - 1] != keys[i]:
            new_keys[count] = keys[i]
            count += 1
    return count


@kernel(inline="always")
def quantised(part):
    """Return a position within a voxel, 0..1, as the integer stored in rows."""
    return min(np.int64(part * PLACES), np.int64(PLACES) - 1)


@kernel
def insert_points(keys, taken, anchor, cubes, points, rows):
    """Insert moved points into the cubes that contain them now.

    If two points meet in a voxel, position, color and heat are averaged, hits and passes are added, and the owner is
    the older object.

    Parameters
    ----------
    keys : (N,) int64
        Keys of the cubes that contain them now.
    taken : Points
        Their columns (N, ...).
    anchor : (ANCHORS,) uint16
        New anchor for the points of each anchor; it has no pending motion.
    cubes : Cubes
        The cubes with these keys are in memory, and their tables contain no row with a pending motion.
    points : Points
    rows : (N,) int64, output
        New row of each point; -1 if there was no room.
    """
    last_key, cube = np.int64(-1), np.int64(-1)
    for i in range(keys.size):
        if keys[i] != last_key:
            last_key, cube = keys[i], make_cube(keys[i], cubes)
        rows[i] = -1
        if cube < 0:
            continue
        voxel, current_anchor = np.int64(taken.voxel[i]), anchor[taken.anchor[i]]
        row, at = find_row(cube, voxel, cubes, points.voxel)
        if row < 0:
            row = add_row(cube, voxel, at, current_anchor, cubes, points)
            if row < 0:
                continue
            points.weight[row] = 0.0
        elif points.weight[row] <= 0.0:
            cubes.dead[cube] -= 1
        rows[i] = row
        cubes.changed[row >> BLOCK_BITS] = True
        if points.weight[row] > 0.0:
            merge_point(row, i, current_anchor, taken, points)
        else:
            write_point(row, i, current_anchor, taken, points)


@kernel
def write_point(row, i, anchor, taken, points):
    """Write a point to the row of its voxel."""
    points.weight[row], points.owner[row], points.last_frame[row] = taken.weight[i], taken.owner[i], taken.last_frame[i]
    for k in range(3):
        points.place[row, k] = taken.place[i, k]
        points.color[row, k] = taken.color[i, k]
    points.heat[row], points.hits[row], points.passes[row] = taken.heat[i], taken.hits[i], taken.passes[i]
    points.anchor[row], points.confidence[row], points.mark[row] = anchor, taken.confidence[i], 0


@kernel
def merge_point(row, i, anchor, taken, points):
    """Merge a point with the point of a row."""
    weight = points.weight[row] + taken.weight[i]
    fraction = np.float64(taken.weight[i]) / weight
    points.weight[row] = weight
    for k in range(3):
        points.place[row, k] = weighted_mean(points.place[row, k], taken.place[i, k], fraction)
        points.color[row, k] = weighted_mean(points.color[row, k], taken.color[i, k], fraction)
    points.heat[row] = weighted_mean(points.heat[row], taken.heat[i], fraction)
    points.hits[row] = min(np.int64(points.hits[row]) + taken.hits[i], MAX_HITS)
    points.passes[row] = min(np.int64(points.passes[row]) + taken.passes[i], MAX_HITS)
    present, new = points.owner[row], taken.owner[i]
    points.owner[row] = min(present, new) if min(present, new) > 0 else max(present, new)
    if taken.last_frame[i] >= points.last_frame[row]:
        points.last_frame[row], points.anchor[row] = taken.last_frame[i], anchor
    points.confidence[row] = max(points.confidence[row], taken.confidence[i])


@kernel(inline="always")
def weighted_mean(first, second, fraction):
    """Return the rounded mean of two integers, where the second has the weight `fraction`."""
    return np.int64(first + fraction * (np.int64(second) - np.int64(first)) + 0.5)
