"""Storage of the map's points: cubes of voxels, blocks of rows for their points, and tables that find a row.

A cube has 32 voxels per side. Its points are stored in rows of a few blocks of 1,024 rows, in the order of their
arrival. Each cube has an open-addressing table from a voxel to a row (0 is empty, k + 1 is row k of the cube). A map
therefore grows by blocks, and existing rows never move. A removed point keeps its row, with zero weight, until its cube
is packed.

There are two kinds of cubes: those of the map's voxels, and fine ones, whose voxels have half the edge; the sign of the
cube's key distinguishes them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.compiling.compiled import kernel

# Bits of a cube's coordinate along an axis, and of a voxel's coordinate within its cube.
KEY_BITS, CUBE_BITS = 21, 5
KEY_OFFSET = 1 << (KEY_BITS - 1)  # cube numbers run from -2^20 to 2^20 - 1: +-300 km at 1 cm
CUBE_SIDE = 1 << CUBE_BITS
# Sign bit in the key of a fine cube.
FINE = -(1 << 63)
# Bits of a row's number within its block.
BLOCK_BITS = 10
BLOCK_ROWS = 1 << BLOCK_BITS
# Blocks of a full cube, and bits of the largest table: at most half of its entries are used.
MAX_BLOCKS = 1 << (3 * CUBE_BITS - BLOCK_BITS)
TABLE_BITS = 3 * CUBE_BITS + 1
# Bits of the smallest table: one page of memory.
MIN_BITS = 11
# Cubes are searched in batches of this many, and a batch is skipped if its bounds are out of view: successive cubes lie
# near each other.
BATCH = 64
# Number of anchors: see `Points.anchor`.
ANCHORS = 1 << 16
# Resolution of a position within a voxel, of a color level, and of heat: finer than any sensor.
PLACES, LEVELS, HEATS = 65536.0, 256.0, 65536.0


class Points(NamedTuple):
    """Columns of the rows, (N, ...)."""

    # Sum of the weights of all sightings, metres to the power of -4; 0 marks a dead row.
    weight: npt.NDArray[np.float32]
    # Object that owns the point, 0: none.
    owner: npt.NDArray[np.int32]
    # Last frame that saw it.
    last_frame: npt.NDArray[np.int32]
    # Its voxel in the cube, and its position (N, 3) in the voxel, in parts of the edge.
    voxel: npt.NDArray[np.uint16]
    place: npt.NDArray[np.uint16]
    # Red, green, blue (N, 3) in parts of a level, and heat.
    color: npt.NDArray[np.uint16]
    heat: npt.NDArray[np.uint16]
    # Number of frames that saw it (hits), and of frames whose rays passed it.
    hits: npt.NDArray[np.uint16]
    passes: npt.NDArray[np.uint16]
    # Its anchor: a keyframe with one of its poses; see `heatmap.anchors`.
    anchor: npt.NDArray[np.uint16]
    # Lead of the owner over all others, votes.
    confidence: npt.NDArray[np.uint8]
    # For a row that represents several voxels of a cell: bits for these of the eight voxels, see `kernels.levels`.
    # While votes are counted: marks rows that have voted.
    mark: npt.NDArray[np.uint8]


ROW = np.dtype(
    [
        ("weight", "<f4"),
        *((name, "<i4") for name in ("owner", "last_frame")),
        ("voxel", "<u2"),
        *((name, "<u2", 3) for name in ("place", "color")),
        *((name, "<u2") for name in ("heat", "hits", "passes", "anchor")),
        *((name, "u1") for name in ("confidence", "mark")),
    ]
)


class Cubes(NamedTuple):
    """The cubes, by number, and the blocks, by number."""

    # Hash table of cubes (2 C,), 0: empty, k + 1: cube k; and the key of each cube (C,).
    table: npt.NDArray[np.int32]
    key: npt.NDArray[np.int64]
    # Smallest and largest x, y, z (C / BATCH, 6) of the first voxels of each batch of cubes, in voxels of the map.
    bounds: npt.NDArray[np.int64]
    # Blocks of each cube (C, MAX_BLOCKS), ascending, 0: none; number of used rows, and of dead ones among them.
    blocks: npt.NDArray[np.int32]
    rows: npt.NDArray[np.int32]
    dead: npt.NDArray[np.int32]
    # Bits of the used size of each cube's table; 0: it has no table, because it is not in memory, or because its rows
    # represent several voxels.
    bits: npt.NDArray[np.uint8]
    # The tables of all cubes (C << TABLE_BITS,).
    tables: npt.NDArray[np.uint16]
    # For each block (B,): its cube, its index among the cube's blocks, and whether a row has changed. There is one
    # extra entry at the end, which row -1 marks.
    cube_of: npt.NDArray[np.int32]
    turn: npt.NDArray[np.uint8]
    changed: npt.NDArray[np.bool_]
    # Numbers (2,) of cubes and of blocks. Block 0 is not used.
    used: npt.NDArray[np.int64]
    # For each anchor (ANCHORS,), whether a motion of its rows is pending: such rows are not at their final position,
    # and no table contains them.
    pending: npt.NDArray[np.bool_]
    # For each cube (C,), whether its table may contain such rows and must be rebuilt before use.
    index_stale: npt.NDArray[np.bool_]


@kernel(inline="always")
def pack_key(x, y, z):
    """Return the key of cube (x, y, z)."""
    return ((x + KEY_OFFSET) << (2 * KEY_BITS)) | ((y + KEY_OFFSET) << KEY_BITS) | (z + KEY_OFFSET)


@kernel(inline="always")
def corner(key):
    """Return the coordinates (x, y, z) of a cube's first voxel."""
    mask = (1 << KEY_BITS) - 1
    x = ((key >> (2 * KEY_BITS)) & mask) - KEY_OFFSET
    y = ((key >> KEY_BITS) & mask) - KEY_OFFSET
    z = (key & mask) - KEY_OFFSET
    return x << CUBE_BITS, y << CUBE_BITS, z << CUBE_BITS


@kernel(inline="always")
def edge_of(key, voxel_m):
    """Return the edge of the voxels of a cube; `voxel_m` is the edge of the map's voxels."""
    return 0.5 * voxel_m if key < 0 else voxel_m


@kernel(inline="always")
def voxel_in(ix, iy, iz):
    """Return the number of voxel (ix, iy, iz) in its cube."""
    mask = CUBE_SIDE - 1
    return ((ix & mask) << (2 * CUBE_BITS)) | ((iy & mask) << CUBE_BITS) | (iz & mask)


@kernel(inline="always")
def row_of(cube, k, blocks):
    """Return the map's row for row k of a cube."""
    return (np.int64(blocks[cube, k >> BLOCK_BITS]) << BLOCK_BITS) | (k & (BLOCK_ROWS - 1))


@kernel(inline="always")
def scatter(number):
    """Return hashed bits of a number."""
    # Each bit of a product depends only on lower bits of its factors: fold the upper half in, and multiply again.
    h = np.uint64(number) * np.uint64(0x9E3779B97F4A7C15)
    h = (h ^ (h >> np.uint64(32))) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64(h >> np.uint64(32))


@kernel
def find_cube(key, cubes):
    """Return (cube, place): the cube of a key or -1, and its index in the table, or the index for a new one."""
    mask = cubes.table.size - 1
    place = scatter(key) & mask
    while True:
        entry = cubes.table[place]
        if entry == 0:
            return -1, place
        if cubes.key[entry - 1] == key:
            return np.int64(entry) - 1, place
        place = (place + 1) & mask


@kernel
def cubes_at(keys, cubes, found):
    """Write the cube of each key (N,), -1: none, to `found` (N,) int64."""
    for i in range(keys.size):
        found[i], _ = find_cube(keys[i], cubes)


@kernel
def make_cube(key, cubes):
    """Return the cube of a key, created if necessary; -1 if there is no room for another one."""
    cube, place = find_cube(key, cubes)
    if cube < 0 and cubes.used[0] < cubes.key.size:
        cube = cubes.used[0]
        cubes.used[0] += 1
        cubes.table[place] = cube + 1
        cubes.key[cube] = key
        cubes.bits[cube] = MIN_BITS
        bounds, (x, y, z) = cubes.bounds[cube // BATCH], corner(key)
        if key < 0:
            x, y, z = x >> 1, y >> 1, z >> 1
        if cube % BATCH == 0:
            bounds[0], bounds[1], bounds[2], bounds[3], bounds[4], bounds[5] = x, y, z, x, y, z
        bounds[0], bounds[1], bounds[2] = min(bounds[0], x), min(bounds[1], y), min(bounds[2], z)
        bounds[3], bounds[4], bounds[5] = max(bounds[3], x), max(bounds[4], y), max(bounds[5], z)
    return cube


@kernel(inline="always")
def find_row(cube, voxel, cubes, voxels):
    """Return (row, place): the row of a voxel or -1, and its index in the tables, or the index for a new one."""
    first, mask = cube << TABLE_BITS, (1 << np.int64(cubes.bits[cube])) - 1
    place = scatter(voxel) & mask
    while True:
        entry = np.int64(cubes.tables[first + place])
        if entry == 0:
            return np.int64(-1), first + place
        row = row_of(cube, entry - 1, cubes.blocks)
        if voxels[row] == voxel:
            return row, first + place
        place = (place + 1) & mask


@kernel(inline="always")
def likely_row(cube, voxel, cubes):
    """Return the row at the first table index of a voxel, which may belong to another voxel; -1: none."""
    place = scatter(voxel) & ((1 << np.int64(cubes.bits[cube])) - 1)
    entry = np.int64(cubes.tables[(cube << TABLE_BITS) + place])
    return row_of(cube, entry - 1, cubes.blocks) if entry > 0 else np.int64(-1)


@kernel
def fill_index(cube, cubes, points):
    """Rebuild a cube's table in the size that its rows need, without rows that have a pending motion."""
    count = np.int64(cubes.rows[cube])
    bits = MIN_BITS
    while 10 * count > 7 << bits:
        bits += 1
    bits = min(bits, TABLE_BITS)
    first = cube << TABLE_BITS
    cubes.tables[first : first + (1 << bits)] = 0
    cubes.bits[cube] = bits
    mask = (1 << bits) - 1
    cubes.index_stale[cube] = False
    for k in range(count):
        row = row_of(cube, k, cubes.blocks)
        if cubes.pending[points.anchor[row]]:
            continue
        place = scatter(points.voxel[row]) & mask
        while cubes.tables[first + place] > 0:
            place = (place + 1) & mask
        cubes.tables[first + place] = k + 1


@kernel
def add_block(cube, k, cubes):
    """Make sure that the block of row k of a cube exists, if the earlier ones do; return whether there is room."""
    if k >= MAX_BLOCKS << BLOCK_BITS:
        return False
    if k & (BLOCK_ROWS - 1) == 0 and cubes.blocks[cube, k >> BLOCK_BITS] == 0:
        block = cubes.used[1]
        if block >= cubes.turn.size - 1:
            return False
        cubes.used[1] += 1
        cubes.blocks[cube, k >> BLOCK_BITS] = block
        cubes.cube_of[block] = cube
        cubes.turn[block] = k >> BLOCK_BITS
    return True


@kernel
def add_row(cube, voxel, place, anchor, cubes, points):
    """Return a new row for a voxel, given its index in the table; -1 if there is no room for another one."""
    k = np.int64(cubes.rows[cube])
    if not add_block(cube, k, cubes):
        return np.int64(-1)
    row = row_of(cube, k, cubes.blocks)
    points.voxel[row], points.anchor[row] = voxel, anchor
    cubes.rows[cube] += 1
    cubes.tables[place] = k + 1
    if 10 * (k + 1) > 7 << np.int64(cubes.bits[cube]) and cubes.bits[cube] < TABLE_BITS:
        fill_index(cube, cubes, points)
    return row


@kernel
def allocate_rows(keys, voxel, anchor, cubes, points, rows):
    """Allocate rows for points of different voxels, by keys of their cubes (N,), voxels in these, and anchors.

    The rows are written to `rows` (N,) int64; -1 if there is no more room.
    """
    for i in range(keys.size):
        rows[i] = -1
        cube = make_cube(keys[i], cubes)
        if cube >= 0:
            _, place = find_row(cube, voxel[i], cubes, points.voxel)
            rows[i] = add_row(cube, voxel[i], place, anchor[i], cubes, points)


def empty_cubes(max_cubes: int, tables: npt.NDArray[np.uint16]) -> Cubes:
    """Return tables for at most `max_cubes` cubes and blocks; memory is used only as they are added."""
    return Cubes(
        table=np.zeros(2 * max_cubes, np.int32),
        key=np.zeros(max_cubes, np.int64),
        bounds=np.zeros((-(-max_cubes // BATCH), 6), np.int64),
        blocks=np.zeros((max_cubes, MAX_BLOCKS), np.int32),
        rows=np.zeros(max_cubes, np.int32),
        dead=np.zeros(max_cubes, np.int32),
        bits=np.zeros(max_cubes, np.uint8),
        tables=tables,
        cube_of=np.zeros(max_cubes + 1, np.int32),
        turn=np.zeros(max_cubes + 1, np.uint8),
        changed=np.zeros(max_cubes + 1, bool),
        used=np.array([0, 1]),
        pending=np.zeros(ANCHORS, bool),
        index_stale=np.zeros(max_cubes, bool),
    )


def columns_of(rows: npt.NDArray[Any]) -> Points:
    """Return the columns of rows (N,) of type ROW, as views."""
    return Points(*(rows[name] for name in Points._fields))


def keys_of(cubes: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return a unique number (N,) for each cube or cell (N, 3)."""
    x, y, z = (cubes + KEY_OFFSET).T
    return np.asarray((x << (2 * KEY_BITS)) | (y << KEY_BITS) | z)
