"""Hot loops of the voxel map: fuse a frame's points, carve free space, pack cubes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import JUMP_SIGMAS, NEAREST_M
from cuboid.method.heatmap.kernels.cubes import (
    BLOCK_BITS,
    BLOCK_ROWS,
    CUBE_BITS,
    CUBE_SIDE,
    HEATS,
    KEY_BITS,
    LEVELS,
    PLACES,
    add_row,
    corner,
    edge_of,
    fill_index,
    find_row,
    likely_row,
    make_cube,
    pack_key,
    row_of,
    voxel_in,
)

# Pixels with less heat than this are cold: background.
COLD_HEAT = 0.1
# A voxel is removed only after rays have passed it this many times: fewer may be noise.
MIN_PASSES = 3
# Beyond this distance depth noise exceeds half a voxel, metres: cold points there are walls and floors.
FAR_M = 2.0
# Largest count of frames; when it is reached, the counts are halved.
MAX_HITS = 65535
# Size of the cache of cubes while a frame is fused: 4 x 4 x 4 neighbouring cubes never replace each other.
LAST_CUBES = 64


class Pixels(NamedTuple):
    """The pixels of a frame that are fused into the map.

    Attributes
    ----------
    depth : (H, W) float32
        Metres, 0 none.
    color : (H, W, 3) uint8
    heat : (H, W) float32
    camera : (4,) float64
        fx, fy, cx, cy of these images.
    T_world_camera : (4, 4) float64
    """

    depth: npt.NDArray[np.float32]
    color: npt.NDArray[np.uint8]
    heat: npt.NDArray[np.float32]
    camera: npt.NDArray[np.float64]
    T_world_camera: npt.NDArray[np.float64]


@kernel(inline="always")
def running_mean(part, parts, weight_of_pixel, to):
    """Return a mean, stored in units of 1/parts, after a sighting of value `to` with the weight `weight_of_pixel`."""
    old = part + 0.5
    return np.uint16(min(np.int64(old + weight_of_pixel * (to * parts - old)), 65535))


@kernel(inline="always")
def pixel_weights(depth, heat, v, odd, turn, max_depth, pixel_weight):
    """Subsample an image row: write how many pixels each one represents; 0 if another pixel represents it this time.

    Cold pixels are left out if `turn` is below 0; see `fuse`.
    """
    # No branches, so that the compiler can vectorise the loop.
    for u in range(depth.size):
        z = depth[u]
        # One in four cold pixels is used; one in sixteen of the cold pixels that are far away.
        in_turn = ((u & 1) + 2 * (v & 1) == turn & 3) & (turn >= 0)
        in_far_turn = ((u >> 1) & 1) + 2 * ((v >> 1) & 1) == (turn >> 2) & 3
        cold = (4.0 if z <= FAR_M else (16.0 if in_far_turn else 0.0)) if in_turn else 0.0
        # Far away a voxel is hardly wider than a pixel, and noise is wider than both: every second pixel suffices.
        hot = 1.0 if z <= FAR_M else (0.0 if (u + v + odd) & 1 else 2.0)
        weight_of_pixel = cold if heat[u] < COLD_HEAT else hot
        pixel_weight[u] = weight_of_pixel if (z > 0.0) & (z <= max_depth) else 0.0


@kernel
def likely_rows(count, cube_in, voxel_of, cubes, voxels, likely):
    """Look up the row of each voxel at its first index in its cube's table; -1 if it is not there.

    The look-ups are independent of each other, so that the memory accesses can overlap.
    """
    for k in range(count):
        likely[k] = likely_row(cube_in[k], voxel_of[k], cubes) if cube_in[k] >= 0 else np.int64(-1)
    for k in range(count):
        likely[k] = likely[k] if likely[k] >= 0 and voxels[likely[k]] == voxel_of[k] else -1


@kernel
def fuse(pixels, voxel_m, max_depth, frame, odd, turn, anchor, level, cubes, points, slots):
    """Fuse a frame's points into the map: a weighted running mean of position, color and heat for each voxel.

    Parameters
    ----------
    pixels : Pixels
    voxel_m, max_depth : float
        Metres.
    frame : int
        Number of this frame; a voxel counts at most one hit per frame.
    odd : int
        0 and 1 in turn: selects half of the far hot pixels. Frame numbers may all be even.
    turn : int
        Selects the cold pixels that represent the others; below 0, cold pixels are left out.
    anchor : int
        Anchor of the fused points.
    level : int
        0, or `FINE` for voxels of fine cubes.
    cubes : Cubes
        Cubes in view are in memory, and no motion of points in them, or into them, is pending.
    points : Points
    slots : (H, W) int32, output
        Row of each pixel, -1 without a reading, or if another pixel represents it.
    """
    depth, color, heat, camera, T = pixels
    height, width = depth.shape
    inverse = 1.0 / voxel_m
    # Local copies: the compiler cannot know that the writes below do not change these arrays.
    fx, fy, cx, cy = 1.0 / camera[0], 1.0 / camera[1], camera[2], camera[3]
    xx, xy, xz, x0 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    yx, yy, yz, y0 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    zx, zy, zz, z0 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    voxels, last_frame, weight, hits = points.voxel, points.last_frame, points.weight, points.hits
    place, colors, heats = points.place, points.color, points.heat
    changed, bits, anchors = cubes.changed, cubes.bits, points.anchor
    # Cache of the last cubes, by the low bits of their keys: a look-up takes far longer.
    last_keys, last_cubes = np.full(LAST_CUBES, -1, np.int64), np.empty(LAST_CUBES, np.int64)
    # For one image row: number of pixels that each one represents; for the fused ones: column, position in the
    # voxel, cube (-1: none), voxel, and the row of the map that is likely to be the voxel's.
    pixel_weight, columns, where = np.empty(width), np.empty(width, np.int64), np.empty((width, 3))
    cube_in, voxel_of, likely = np.empty(width, np.int64), np.empty(width, np.int64), np.empty(width, np.int64)
    for v in range(height):
        slots[v] = -1
        pixel_weights(depth[v], heat[v], v, odd, turn, max_depth, pixel_weight)
        count = 0
        for u in range(width):
            columns[count] = u
            count += pixel_weight[u] > 0.0
        for k in range(count):
            u = columns[k]
            z = depth[v, u]
            x = (u - cx) * fx * z
            y = (v - cy) * fy * z
            wx = (xx * x + xy * y + xz * z + x0) * inverse
            wy = (yx * x + yy * y + yz * z + y0) * inverse
            wz = (zx * x + zy * y + zz * z + z0) * inverse
            ix, iy, iz = np.int64(np.floor(wx)), np.int64(np.floor(wy)), np.int64(np.floor(wz))
            cube_in[k] = pack_key(ix >> CUBE_BITS, iy >> CUBE_BITS, iz >> CUBE_BITS) | level
            voxel_of[k] = voxel_in(ix, iy, iz)
            where[k, 0], where[k, 1], where[k, 2] = wx - ix, wy - iy, wz - iz
        # From here on, `cube_in` holds cubes instead of keys.
        for k in range(count):
            key = cube_in[k]
            last = (key & 3) | ((key >> KEY_BITS) & 3) << 2 | ((key >> (2 * KEY_BITS)) & 3) << 4
            if last_keys[last] != key:
                cube = make_cube(key, cubes)
                last_keys[last], last_cubes[last] = key, cube if cube >= 0 and bits[cube] > 0 else np.int64(-1)
            cube_in[k] = last_cubes[last]
        likely_rows(count, cube_in, voxel_of, cubes, voxels, likely)
        for k in range(count):
            u, row, at, inside = columns[k], likely[k], np.int64(0), where[k]
            if cube_in[k] < 0:
                continue
            if row < 0:
                row, at = find_row(cube_in[k], voxel_of[k], cubes, voxels)
            if row < 0:
                row = add_row(cube_in[k], voxel_of[k], at, anchor, cubes, points)
                if row < 0:
                    continue
                last_frame[row] = -1
            elif weight[row] <= 0.0:
                cubes.dead[cube_in[k]] -= 1
                last_frame[row] = -1
            slots[v, u], anchors[row] = row, anchor
            z, warm = depth[v, u], heat[v, u]
            # The variance of depth grows with z^4: near sightings have more weight. Below half a metre the weight is
            # constant.
            near = max(z, 0.5)
            w = pixel_weight[u] / (near * near * near * near)
            total = weight[row] + w
            a = w / total
            for axis in range(3):
                place[row, axis] = running_mean(place[row, axis], PLACES, a, inside[axis])
                colors[row, axis] = running_mean(colors[row, axis], LEVELS, a, color[v, u, axis] + 0.5 / LEVELS)
            heats[row] = running_mean(heats[row], HEATS, a, warm)
            weight[row] = total
            if last_frame[row] != frame:
                last_frame[row] = frame
                if hits[row] == MAX_HITS:
                    hits[row] >>= 1
                    points.passes[row] >>= 1
                    weight[row] *= 0.5
                hits[row] += 1
            changed[row >> BLOCK_BITS] = True


@kernel
def carve_free_space(chosen, depth, camera, T_camera_world, noise, margin, step, voxel_m, cubes, points):
    """Carve free space: count the rays that pass the points of some cubes; remove points passed more often than hit.

    A ray passes a voxel if the readings at its pixel and at the eight around it all lie behind it by more than the
    margin and the noise of depth. Each pass counts for `step` frames.
    """
    height, width = depth.shape
    T = T_camera_world
    mask = CUBE_SIDE - 1
    weight, hits, passes, place = points.weight, points.hits, points.passes, points.place
    for cube in chosen:
        (x0, y0, z0), edge_m = corner(cubes.key[cube]), edge_of(cubes.key[cube], voxel_m)
        for k in range(cubes.rows[cube]):
            row = row_of(cube, k, cubes.blocks)
            if weight[row] <= 0.0:
                continue
            voxel = np.int64(points.voxel[row])
            px = (x0 + (voxel >> (2 * CUBE_BITS)) + (place[row, 0] + 0.5) / PLACES) * edge_m
            py = (y0 + ((voxel >> CUBE_BITS) & mask) + (place[row, 1] + 0.5) / PLACES) * edge_m
            pz = (z0 + (voxel & mask) + (place[row, 2] + 0.5) / PLACES) * edge_m
            z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
            if z < NEAREST_M:
                continue
            u = int(np.rint((T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]) / z * camera[0] + camera[2]))
            v = int(np.rint((T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]) / z * camera[1] + camera[3]))
            if u < 1 or v < 1 or u >= width - 1 or v >= height - 1:
                continue
            behind = z + max(margin, JUMP_SIGMAS * noise * z * z)
            passed = depth[v, u] > behind
            if not passed:
                continue
            for dv in range(-1, 2):
                for du in range(-1, 2):
                    if not depth[v + dv, u + du] > behind:
                        passed = False
            if passed:
                cubes.changed[row >> BLOCK_BITS] = True
                passes[row] = min(MAX_HITS, passes[row] + step)
                if passes[row] >= MIN_PASSES and passes[row] > hits[row]:
                    weight[row] = 0.0
                    hits[row] = 0
                    passes[row] = 0
                    cubes.dead[cube] += 1


@kernel
def pack(cube, cubes, rows, points):
    """Remove the dead rows of a cube and keep the order of the others; freed rows become zeros.

    Parameters
    ----------
    cube : int
    cubes : Cubes
    rows : (N, R) uint8
        The rows, as bytes.
    points : Points
        The same rows, as columns.
    """
    count = np.int64(cubes.rows[cube])
    kept = np.int64(0)
    for k in range(count):
        row = row_of(cube, k, cubes.blocks)
        if points.weight[row] > 0.0:
            to = row_of(cube, kept, cubes.blocks)
            if to != row:
                for byte in range(rows.shape[1]):
                    rows[to, byte] = rows[row, byte]
            kept += 1
    for k in range(kept, count):
        rows[row_of(cube, k, cubes.blocks)] = 0
    for k in range(0, count, BLOCK_ROWS):
        cubes.changed[cubes.blocks[cube, k >> BLOCK_BITS]] = True
    cubes.rows[cube] = kept
    cubes.dead[cube] = 0
    fill_index(cube, cubes, points)
