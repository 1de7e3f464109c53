"""Hot loops of the voxel hash: fuse a frame's points, see through stray ones, find the point of a place.

The map is a set of dense arrays, one row a voxel, and an open-addressing table that leads from a voxel's key
to its row (0 is empty, k + 1 is row k). A removed voxel keeps its row with zero weight until the map is packed.
"""

from __future__ import annotations

import numpy as np
from numba import njit

KEY_BITS = 21
KEY_OFFSET = 1 << (KEY_BITS - 1)  # voxel numbers run from -2^20 to 2^20 - 1: +-10 km at 1 cm

# A pixel colder than this is no news.
COLD = 0.1

# Beyond this noise passes half a voxel, metres: cold points there are walls and floors.
FAR_M = 2.0

# Columns of the value array.
X, Y, Z, RED, GREEN, BLUE, HEAT, WEIGHT = range(8)


@njit(cache=True, nogil=True, inline="always")
def pack_key(ix, iy, iz):
    """Return the key of voxel (ix, iy, iz)."""
    return ((ix + KEY_OFFSET) << (2 * KEY_BITS)) | ((iy + KEY_OFFSET) << KEY_BITS) | (iz + KEY_OFFSET)


@njit(cache=True, nogil=True, inline="always")
def find_slot(key, keys, table):
    """Return (row, place): the row of a key or -1, and where in the table it is or would go."""
    mask = table.size - 1
    # A product's bit depends on no higher bit of its factors: fold the upper half in, and mix once more.
    h = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    h = (h ^ (h >> np.uint64(32))) * np.uint64(0x9E3779B97F4A7C15)
    place = np.int64(h >> np.uint64(32)) & mask
    while True:
        entry = table[place]
        if entry == 0:
            return -1, place
        if keys[entry - 1] == key:
            return entry - 1, place
        place = (place + 1) & mask


@njit(cache=True, nogil=True)
def fill_table(keys, count, table):
    """Enter rows 0..count-1 into an empty table."""
    for row in range(count):
        _, place = find_slot(keys[row], keys, table)
        table[place] = row + 1


@njit(cache=True, nogil=True)
def fuse(
    depth,
    color,
    heat,
    camera,
    T,
    voxel,
    max_depth,
    frame,
    keys,
    values,
    hits,
    last_frame,
    count,
    table,
    slots,
):
    """Fuse a frame's points into the map: a weighted running mean of place, color and heat a voxel.

    Parameters
    ----------
    depth : (H, W) float32
        Metres, 0 none.
    color : (H, W, 3) uint8
    heat : (H, W) float32
    camera : (4,) float64
        fx, fy, cx, cy of these images.
    T : (4, 4) float64
        T_world_camera.
    voxel, max_depth : float
        Metres.
    frame : int
        Number of this frame; a voxel counts one hit a frame.
    keys, values, hits, last_frame : arrays of the map
        Must have room for H * W more rows.
    count : int
        Rows in use.
    table : (C,) int32
    slots : (H, W) int32, output
        Row of each pixel, -1 where there is no reading and where another cold pixel speaks for it.

    Returns
    -------
    (int, int)
        Rows in use afterwards, and how many that were removed are seen again.
    """
    height, width = depth.shape
    again = 0
    inverse = 1.0 / voxel
    # Local copies: what is written below could lie in these arrays, for all the compiler knows.
    fx, fy, cx, cy = 1.0 / camera[0], 1.0 / camera[1], camera[2], camera[3]
    xx, xy, xz, x0 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    yx, yy, yz, y0 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    zx, zy, zz, z0 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            slots[v, u] = -1
            if not (0.0 < z <= max_depth):
                continue
            share = 1.0
            warm = heat[v, u]
            if warm < COLD:
                # Of what is cold one pixel in four speaks for all, in turn; of what is cold and far one in sixteen.
                if (u & 1) + 2 * (v & 1) != frame & 3:
                    continue
                share = 4.0
                if z > FAR_M:
                    if ((u >> 1) & 1) + 2 * ((v >> 1) & 1) != (frame >> 2) & 3:
                        continue
                    share = 16.0
            elif z > FAR_M:
                # There a voxel is hardly wider than a pixel, and its noise wider than both: every other one will do.
                if (u + v + frame) & 1:
                    continue
                share = 2.0
            x = (u - cx) * fx * z
            y = (v - cy) * fy * z
            wx = xx * x + xy * y + xz * z + x0
            wy = yx * x + yy * y + yz * z + y0
            wz = zx * x + zy * y + zz * z + z0
            key = pack_key(
                np.int64(np.floor(wx * inverse)),
                np.int64(np.floor(wy * inverse)),
                np.int64(np.floor(wz * inverse)),
            )
            # Most hot pixels share their voxel with the one to the left or above: no need to ask the table.
            row = np.int64(slots[v, u - 1]) if u > 0 else np.int64(-1)
            if row < 0 or keys[row] != key:
                row = np.int64(slots[v - 1, u]) if v > 0 else np.int64(-1)
            place = np.int64(-1)
            if row < 0 or keys[row] != key:
                row, place = find_slot(key, keys, table)
            if row < 0:
                row = count
                count += 1
                table[place] = row + 1
                keys[row] = key
                values[row, :] = 0.0
                hits[row] = 0
                last_frame[row] = -1
            elif values[row, WEIGHT] <= 0.0:
                again += 1
                last_frame[row] = -1
            slots[v, u] = row
            # Depth's variance grows with z^4: a near sighting says more. Half a metre and nearer weigh alike.
            near = max(z, 0.5)
            w = share / (near * near * near * near)
            value = values[row]
            total = value[WEIGHT] + w
            a = np.float32(w / total)
            value[X] += a * (np.float32(wx) - value[X])
            value[Y] += a * (np.float32(wy) - value[Y])
            value[Z] += a * (np.float32(wz) - value[Z])
            value[RED] += a * (np.float32(color[v, u, 0]) - value[RED])
            value[GREEN] += a * (np.float32(color[v, u, 1]) - value[GREEN])
            value[BLUE] += a * (np.float32(color[v, u, 2]) - value[BLUE])
            value[HEAT] += a * (warm - value[HEAT])
            value[WEIGHT] = total
            if last_frame[row] != frame:
                last_frame[row] = frame
                hits[row] += 1
    return count, again


@njit(cache=True, nogil=True)
def see_through(first, last, depth, camera, T_camera_world, noise, margin, step, values, hits, passes):
    """Count, for rows first..last-1, sightings that pass through them; remove those passed more often than hit.

    A voxel is passed when the reading at its pixel and at the eight around it all lie behind it by more than the
    margin and four standard deviations of depth. `step` is how many frames one such look stands for.
    Returns how many were removed.
    """
    height, width = depth.shape
    T = T_camera_world
    removed = 0
    for row in range(first, last):
        if values[row, WEIGHT] <= 0.0:
            continue
        px, py, pz = values[row, X], values[row, Y], values[row, Z]
        z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
        if z < 0.1:
            continue
        u = int(np.rint((T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]) / z * camera[0] + camera[2]))
        v = int(np.rint((T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]) / z * camera[1] + camera[3]))
        if u < 1 or v < 1 or u >= width - 1 or v >= height - 1:
            continue
        behind = z + max(margin, 4.0 * noise * z * z)
        passed = True
        for dv in range(-1, 2):
            for du in range(-1, 2):
                if not depth[v + dv, u + du] > behind:
                    passed = False
        if passed:
            passes[row] += step
            if passes[row] >= 3 and passes[row] > hits[row]:
                values[row, WEIGHT] = 0.0
                hits[row] = 0
                passes[row] = 0
                removed += 1
    return removed


@njit(cache=True, nogil=True)
def rows_at(points, voxel, keys, values, table, rows):
    """Find for each point (N, 3) the row of the living voxel there, -1 none; written to `rows` (N,) int64."""
    inverse = 1.0 / voxel
    for i in range(points.shape[0]):
        key = pack_key(
            np.int64(np.floor(points[i, 0] * inverse)),
            np.int64(np.floor(points[i, 1] * inverse)),
            np.int64(np.floor(points[i, 2] * inverse)),
        )
        row, _ = find_slot(key, keys, table)
        rows[i] = row if row >= 0 and values[row, WEIGHT] > 0.0 else -1


@njit(cache=True, nogil=True)
def rows_of(number, blocks, size, owner, rows):
    """Gather the rows of an object from the blocks that may hold some.

    Parameters
    ----------
    number : int
    blocks : (B,) int64
        Ascending.
    size : int
        Rows of a block.
    owner : (N,) int32
    rows : (B * size,) int64, output
        Ascending.

    Returns
    -------
    int
        How many there are.
    """
    n = 0
    for block in blocks:
        for row in range(block * size, min((block + 1) * size, owner.size)):
            if owner[row] == number:
                rows[n] = row
                n += 1
    return n


@njit(cache=True, nogil=True)
def blocks_touched(claim, slots, bits, touched):
    """Mark in which blocks of rows each share of a frame has voxels.

    Parameters
    ----------
    claim : (h, w) int32
        Share of each pixel, -1 none.
    slots : (h, w) int32
        Row of each pixel, -1 none.
    bits : int
        A block has 2 to this many rows.
    touched : (shares, blocks) uint8, in and out
    """
    for v in range(claim.shape[0]):
        for u in range(claim.shape[1]):
            if claim[v, u] >= 0 and slots[v, u] >= 0:
                touched[claim[v, u], slots[v, u] >> bits] = 1


@njit(cache=True, nogil=True)
def owner_of(slots, owner, pixel_owner):
    """Look up whom the voxel of each pixel belongs to.

    Parameters
    ----------
    slots : (h, w) int32
        Row of each pixel, -1 none.
    owner : (N,) int32
    pixel_owner : (h, w) int32, output
        0 where there is none.
    """
    for v in range(slots.shape[0]):
        for u in range(slots.shape[1]):
            pixel_owner[v, u] = owner[slots[v, u]] if slots[v, u] >= 0 else 0
