"""Hot loops that search the cubes of the map: cubes in view, the row at a point, the position of a row."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.method.heatmap.kernels.cubes import (
    BATCH,
    BLOCK_BITS,
    CUBE_BITS,
    CUBE_SIDE,
    PLACES,
    corner,
    edge_of,
    find_cube,
    find_row,
    pack_key,
    voxel_in,
)
from cuboid.method.heatmap.kernels.levels import layer_place, voxel_of


@kernel
def rows_at(points, voxel_m, cubes, voxels, weights, rows, missing):
    """Find the row of the living voxel at each point (N, 3), -1: none, and write it to `rows` (N,) int64.

    Return the number of points in cubes that are not in memory; the first entries of `missing` (N,) int64 are these
    cubes.
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


@kernel
def seen_around(ground, axes, reach, min_columns, voxel_m, cubes, voxels, weights, seen, missing):
    """Find the places on a plane around which enough of nine columns, each three voxels high, hold a point.

    Parameters
    ----------
    ground : (N, 3) float64
    axes : (3, 3) float64
        Row by row: two axes of the plane, and its normal.
    reach : float
        Distance between neighbouring sample places, metres.
    min_columns : int
        Smallest number of such columns among the nine.
    voxel_m, cubes, voxels, weights, missing
        See `rows_at`; `missing` has room for 27 N.
    seen : (N,) bool, output

    Returns
    -------
    int
        Number of sample places in cubes that are not in memory; see `rows_at`.
    """
    steps = np.array([-reach, 0.0, reach])
    column, rows, absent = np.empty((3, 3)), np.empty(3, np.int64), 0
    for i in range(ground.shape[0]):
        occupied = 0
        for a in range(3):
            for b in range(3):
                if occupied >= min_columns:
                    continue
                for c in range(3):
                    for k in range(3):
                        off = steps[a] * axes[0, k] + steps[b] * axes[1, k] + steps[c] * axes[2, k]
                        column[c, k] = ground[i, k] + off
                absent += rows_at(column, voxel_m, cubes, voxels, weights, rows, missing[absent:])
                occupied += max(rows[0], rows[1], rows[2]) >= 0
        seen[i] = occupied >= min_columns
    return absent


@kernel
def places(rows, eighths, voxel_m, cubes, points, motions, xyz):
    """Write the world positions of the points of rows (N,) to `xyz` (N, 3) float32.

    Pending motions, `motions` (ANCHORS, 3, 4) by anchor, are applied. For a row that represents several voxels,
    `eighths` (N,) selects one of them.
    """
    mask, place = CUBE_SIDE - 1, np.empty(3, np.int64)
    for i in range(rows.size):
        row, eighth = rows[i], np.int64(eighths[i])
        key = cubes.key[cubes.cube_of[row >> BLOCK_BITS]]
        (x, y, z), edge_m = corner(key), edge_of(key, voxel_m)
        voxel = np.int64(points.voxel[row])
        place[0], place[1], place[2] = points.place[row, 0], points.place[row, 1], points.place[row, 2]
        if points.mark[row] > 0:
            voxel = voxel_of(voxel, eighth)
            for k in range(3):
                place[k] = layer_place(place[k], (eighth >> (2 - k)) & 1)
        px = (x + (voxel >> (2 * CUBE_BITS)) + (place[0] + 0.5) / PLACES) * edge_m
        py = (y + ((voxel >> CUBE_BITS) & mask) + (place[1] + 0.5) / PLACES) * edge_m
        pz = (z + (voxel & mask) + (place[2] + 0.5) / PLACES) * edge_m
        if cubes.pending[points.anchor[row]]:
            T = motions[points.anchor[row]]
            for k in range(3):
                xyz[i, k] = T[k, 0] * px + T[k, 1] * py + T[k, 2] * pz + T[k, 3]
        else:
            xyz[i, 0], xyz[i, 1], xyz[i, 2] = px, py, pz


@kernel
def cubes_meeting(spaces, cube, anchor, motions, voxel_m, cubes, meets):
    """Find the pairs (N,) of a cube and an anchor whose points may be in a region, by the cubes' bounding spheres.

    Parameters
    ----------
    spaces : (H, 4) float64
        The region is the intersection of half-spaces: inside if x a + y b + z c + d >= 0, (a, b, c) unit.
    cube, anchor : (N,) int32
    motions : (ANCHORS, 3, 4) float64
        Pending motion of the points of each anchor.
    voxel_m : float
    cubes : Cubes
    meets : (N,) bool, output
        Whether points may lie in the region now, or after their motion.
    """
    for i in range(cube.size):
        key = cubes.key[cube[i]]
        (ix, iy, iz), edge_m = corner(key), edge_of(key, voxel_m)
        half = 0.5 * CUBE_SIDE * edge_m
        px, py, pz = ix * edge_m + half, iy * edge_m + half, iz * edge_m + half
        T = motions[anchor[i]]
        meets[i] = _meets(spaces, px, py, pz, 1.74 * half) or _meets(
            spaces,
            T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3],
            T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3],
            T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3],
            1.74 * half,
        )


@kernel(inline="always")
def _meets(spaces, x, y, z, radius):
    for k in range(spaces.shape[0]):
        if spaces[k, 0] * x + spaces[k, 1] * y + spaces[k, 2] * z + spaces[k, 3] < -radius:
            return False
    return True


@kernel
def touched(slots, cube_of, marks, found):
    """Find the cubes of the rows of pixels (H, W) int32, -1: none.

    `marks` (C,) bool are False before and after; the first entries of `found` (C,) int64 are the cubes; return their
    number.
    """
    count, last = 0, np.int64(-1)
    for row in slots.ravel():
        if row < 0:
            continue
        cube = np.int64(cube_of[row >> BLOCK_BITS])
        if cube != last and not marks[cube]:
            marks[cube] = True
            found[count] = cube
            count += 1
        last = cube
    for k in range(count):
        marks[found[k]] = False
    return count


@kernel
def cubes_in_frustum(T_camera_world, camera, width, height, far_m, voxel_m, cubes, seen):
    """Find the cubes whose bounding spheres reach into an image within a distance.

    Parameters
    ----------
    T_camera_world : (4, 4) float64
    camera : (4,) float64
        fx, fy, cx, cy.
    width, height : int
    far_m, voxel_m : float
    cubes : Cubes
    seen : (C,) int64, output
        Its first entries are the cubes, ascending.

    Returns
    -------
    int
        Number of cubes.
    """
    T, count = T_camera_world, 0
    fx, fy = camera[0], camera[1]
    # One pixel larger on each side than the image.
    left, right, top, bottom = camera[2] + 1.0, width - camera[2], camera[3] + 1.0, height - camera[3]
    along_left, along_right = np.sqrt(fx * fx + left * left), np.sqrt(fx * fx + right * right)
    along_top, along_bottom = np.sqrt(fy * fy + top * top), np.sqrt(fy * fy + bottom * bottom)
    used = cubes.used[0]
    for batch in range((used + BATCH - 1) // BATCH):
        # First the sphere around a batch of cubes, then each cube.
        for k in range(-1, min(BATCH, used - batch * BATCH)):
            cube = batch * BATCH + k
            half = 0.5 * CUBE_SIDE * voxel_m
            if k < 0:
                b = cubes.bounds[batch]
                dx, dy, dz = np.float64(b[3] - b[0]), np.float64(b[4] - b[1]), np.float64(b[5] - b[2])
                radius = 1.74 * half + 0.501 * voxel_m * np.sqrt(dx * dx + dy * dy + dz * dz)
                px, py, pz = 0.5 * voxel_m * (b[0] + b[3]), 0.5 * voxel_m * (b[1] + b[4]), 0.5 * voxel_m * (b[2] + b[5])
            else:
                (ix, iy, iz), edge_m = corner(cubes.key[cube]), edge_of(cubes.key[cube], voxel_m)
                half = 0.5 * CUBE_SIDE * edge_m
                px, py, pz, radius = ix * edge_m, iy * edge_m, iz * edge_m, 1.74 * half
            px, py, pz = px + half, py + half, pz + half
            z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
            x = T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]
            y = T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]
            outside = z < -radius or z > far_m + radius
            outside |= fx * x + left * z < -radius * along_left or right * z - fx * x < -radius * along_right
            outside |= fy * y + top * z < -radius * along_top or bottom * z - fy * y < -radius * along_bottom
            if k < 0 and outside:
                break
            if k >= 0 and not outside:
                seen[count] = cube
                count += 1
    return count
