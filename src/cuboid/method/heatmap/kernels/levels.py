"""Hot loops of the map's levels of detail: background out of view is stored in cells of two voxels per side.

A row of a cell represents several of its eight voxels; its mark lists them. Color and heat are stored once; the
position has one part for each layer of voxels along each axis, so that a surface between two layers is preserved. Rows
of cells are the last ones of their cube, so that rows of objects keep their numbers when cells are split again.
"""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.method.heatmap.kernels.cubes import BLOCK_BITS, BLOCK_ROWS, CUBE_BITS, HEATS, add_block, fill_index, row_of

# Bits of a cell's coordinate in its cube along an axis; a cell has two voxels per side.
CELL_BITS = CUBE_BITS - 1
CELLS = 1 << (3 * CELL_BITS)
# Voxels share a cell only if their heat is in the same step of this size: cold and hot voxels stay separate.
HEAT_STEP = HEATS * 0.1


@kernel(inline="always")
def cell_of(voxel):
    """Return the cell of a voxel of a cube, and the index of the voxel among the eight of the cell."""
    x, y, z = voxel >> (2 * CUBE_BITS), (voxel >> CUBE_BITS) & ((1 << CUBE_BITS) - 1), voxel & ((1 << CUBE_BITS) - 1)
    cell = ((x >> 1) << (2 * CELL_BITS)) | ((y >> 1) << CELL_BITS) | (z >> 1)
    return cell, ((x & 1) << 2) | ((y & 1) << 1) | (z & 1)


@kernel(inline="always")
def voxel_of(first, eighth):
    """Return the voxel with index `eighth` in a cell, given the first voxel of the cell."""
    return first | ((eighth >> 2) << (2 * CUBE_BITS)) | (((eighth >> 1) & 1) << CUBE_BITS) | (eighth & 1)


@kernel(inline="always")
def layer_place(place, layer):
    """Return the position in a voxel along an axis, unpacked for one of the two layers of a cell."""
    return (((place >> (8 * layer)) & 255) << 8) | 128


@kernel(inline="always")
def kind_of(row, since, points):
    """Return a key for rows of one cell: rows with equal keys have equal properties for all decisions and may merge."""
    warmth = int(points.heat[row] / HEAT_STEP)
    kind = (np.int64(points.anchor[row]) << 8) | (warmth << 2)
    return kind | (np.int64(points.hits[row] > 1) << 1) | np.int64(points.last_frame[row] >= since)


@kernel(inline="always")
def copy(words, row, to_words, to):
    """Copy a row between arrays of words."""
    for k in range(words.shape[1]):
        to_words[to, k] = words[row, k]


@kernel
def thin(chosen, since, cubes, words, points, made_words, made, moved):
    """Merge voxels that have no owner and lie in one cell into one row, if their properties agree.

    Parameters
    ----------
    chosen : (C,) int64
        Cubes whose rows are in memory; their tables are invalid afterwards.
    since : int
        Rows seen from this frame on are not merged with older ones.
    cubes : Cubes
    words : (N, W) uint32
        The rows as words.
    points : Points
        The same rows, as columns.
    made_words, made
        Buffers for the largest number of rows of a cube, as words and as columns.
    moved : (M,) int64, output
        Its first entries are the new numbers of the rows of objects that moved to another block.

    Returns
    -------
    int
        Number of these entries.
    """
    moved_count = np.int64(0)
    for cube in chosen:
        moved_count = thin_one(cube, since, cubes, words, points, made_words, made, moved, moved_count)
    return moved_count


@kernel
def thin_one(cube, since, cubes, words, points, made_words, made, moved, moved_count):
    """Thin one cube; see `thin`."""
    count = np.int64(cubes.rows[cube])
    # A group of rows to merge is identified by its first row; each cell lists its groups, last one first.
    heads, before = np.full(CELLS, -1, np.int32), np.empty(count, np.int32)
    following, last, size = np.full(count, -1, np.int32), np.empty(count, np.int32), np.zeros(count, np.int32)
    kinds = np.empty(count, np.int64)
    for k in range(count):
        row = row_of(cube, k, cubes.blocks)
        if points.weight[row] <= 0.0 or points.owner[row] > 0 or points.confidence[row] > 0 or points.mark[row] > 0:
            continue
        cell, _ = cell_of(np.int64(points.voxel[row]))
        kinds[k] = kind_of(row, since, points)
        group = heads[cell]
        while group >= 0 and kinds[group] != kinds[k]:
            group = before[group]
        if group < 0:
            before[k], heads[cell] = heads[cell], k
            group = k
        else:
            following[last[group]] = k
        last[group] = k
        size[group] += 1
    cells = np.int64(0)
    for k in range(count):
        if size[k] > 1:
            merge_rows(cube, k, following, cubes, words, points, made_words, made, cells)
            cells += 1
    kept = np.int64(0)
    for k in range(count):
        row = row_of(cube, k, cubes.blocks)
        # All rows of merged groups are dead now.
        if points.weight[row] > 0.0:
            to = row_of(cube, kept, cubes.blocks)
            if to != row:
                copy(words, row, words, to)
            if points.owner[to] > 0 and to >> BLOCK_BITS != row >> BLOCK_BITS:
                moved[moved_count] = to
                moved_count += 1
            kept += 1
    for k in range(cells):
        copy(made_words, k, words, row_of(cube, kept + k, cubes.blocks))
    if kept + cells < count:
        for k in range(kept + cells, count):
            words[row_of(cube, k, cubes.blocks)] = 0
        for k in range(0, count, BLOCK_ROWS):
            cubes.changed[cubes.blocks[cube, k >> BLOCK_BITS]] = True
    cubes.rows[cube] = kept + cells
    cubes.dead[cube] = 0
    return moved_count


@kernel
def merge_rows(cube, first, following, cubes, words, points, made_words, made, to):
    """Make one row for a cell from a group of rows, which become dead."""
    places, weights = np.zeros((3, 2)), np.zeros((3, 2))
    red, green, blue, heat, weight = 0.0, 0.0, 0.0, 0.0, 0.0
    mark, hits, passes, members, seen = 0, 0, 0, 0, np.int64(-1)
    k = np.int64(first)
    while k >= 0:
        row = row_of(cube, k, cubes.blocks)
        w = np.float64(points.weight[row])
        _, eighth = cell_of(np.int64(points.voxel[row]))
        mark |= 1 << eighth
        for axis in range(3):
            layer = (eighth >> (2 - axis)) & 1
            places[axis, layer] += w * points.place[row, axis]
            weights[axis, layer] += w
        red += w * points.color[row, 0]
        green += w * points.color[row, 1]
        blue += w * points.color[row, 2]
        heat += w * points.heat[row]
        weight += w
        hits += np.int64(points.hits[row])
        passes += np.int64(points.passes[row])
        seen = max(seen, np.int64(points.last_frame[row]))
        members += 1
        points.weight[row] = 0.0
        k = np.int64(following[k])
    row = row_of(cube, first, cubes.blocks)
    copy(words, row, made_words, to)
    _, eighth = cell_of(np.int64(points.voxel[row]))
    made.voxel[to] = np.int64(points.voxel[row]) ^ voxel_of(0, eighth)
    for axis in range(3):
        low = int(places[axis, 0] / weights[axis, 0]) >> 8 if weights[axis, 0] > 0.0 else 0
        high = int(places[axis, 1] / weights[axis, 1]) >> 8 if weights[axis, 1] > 0.0 else 0
        made.place[to, axis] = low | (high << 8)
    made.color[to, 0], made.color[to, 1], made.color[to, 2] = red / weight, green / weight, blue / weight
    made.heat[to], made.weight[to] = heat / weight, weight / members
    made.hits[to], made.passes[to] = (hits + members // 2) // members, (passes + members // 2) // members
    made.last_frame[to], made.mark[to] = seen, mark


@kernel
def split_cells(chosen, cubes, words, points, made_words, made, parted):
    """Give each voxel represented by a row of a cell its own row again, and rebuild the tables of the cubes.

    See `thin`; `parted` (C,) bool is set for the cubes that had such rows.
    """
    for i in range(chosen.size):
        cube = chosen[i]
        kept = np.int64(cubes.rows[cube])
        while kept > 0 and points.mark[row_of(cube, kept - 1, cubes.blocks)] > 0:
            kept -= 1
        cells = np.int64(cubes.rows[cube]) - kept
        for k in range(cells):
            copy(words, row_of(cube, kept + k, cubes.blocks), made_words, k)
        to = kept
        for k in range(cells):
            for eighth in range(8):
                if (made.mark[k] >> eighth) & 1 == 0 or not add_block(cube, to, cubes):
                    continue
                row = row_of(cube, to, cubes.blocks)
                copy(made_words, k, words, row)
                points.voxel[row], points.mark[row] = voxel_of(np.int64(made.voxel[k]), eighth), 0
                for axis in range(3):
                    points.place[row, axis] = layer_place(np.int64(made.place[k, axis]), (eighth >> (2 - axis)) & 1)
                cubes.changed[row >> BLOCK_BITS] = True
                to += 1
        cubes.rows[cube] = to
        fill_index(cube, cubes, points)
        parted[i] = cells > 0
