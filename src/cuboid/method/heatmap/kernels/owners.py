"""Hot loops over the owners of the voxel map: the rows of an object, and the owner of each pixel of a frame."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.method.heatmap.kernels.cubes import HEATS


@kernel
def rows_of(number, blocks, size, owner, rows):
    """Gather the rows of an object from the blocks that may contain some.

    Parameters
    ----------
    number : int
    blocks : (B,) int64
        Ascending.
    size : int
        Number of rows of a block.
    owner : (N,) int32
    rows : (B * size,) int64, output
        Ascending.

    Returns
    -------
    int
        Number of rows found.
    """
    n = 0
    for block in blocks:
        for row in range(block * size, min((block + 1) * size, owner.size)):
            if owner[row] == number:
                rows[n] = row
                n += 1
    return n


@kernel
def solid_rows_of(number, blocks, size, owner, weight, confidence, hits, heat, hot, votes, ratio, max_frames, rows):
    """Gather the living rows of an object that are hot and have enough votes; see `rows_of`.

    Parameters
    ----------
    weight : (N,) float32
        0 for dead rows.
    confidence : (N,) uint8
        Number of votes.
    hits : (N,) uint16
        Number of frames that saw each row.
    heat : (N,) uint16
    hot : float32
        Smallest heat, 0..1.
    votes, ratio, max_frames : int
        The votes must be at least `votes`, and at least 1/`ratio` of the frames, of which at most `max_frames` count.
    rows : (B * size,) int64, output

    Returns
    -------
    int
        Number of rows found.
    """
    n = 0
    for block in blocks:
        for row in range(block * size, min((block + 1) * size, owner.size)):
            if owner[row] != number or not weight[row] > 0.0 or np.float32(heat[row]) / np.float32(HEATS - 1) < hot:
                continue
            votes_of_row = np.int64(confidence[row])
            if votes_of_row >= votes and ratio * votes_of_row >= min(np.int64(hits[row]), max_frames):
                rows[n] = row
                n += 1
    return n


@kernel
def have_rows(numbers, min_rows, blocks, ends, size, owner, weight, found):
    """Find the objects (n,) that have at least `min_rows` (n,) living rows: `found` (n,) bool; see `rows_of`.

    The blocks (B,) of object k are those from `ends[k - 1]` (0 for the first one) to `ends[k]`.
    """
    begin = 0
    for k in range(numbers.size):
        n = 0
        for place in range(begin, ends[k]):
            block = blocks[place]
            for row in range(block * size, min((block + 1) * size, owner.size)):
                if owner[row] == numbers[k] and weight[row] > 0.0:
                    n += 1
                    if n >= min_rows[k]:
                        break
            if n >= min_rows[k]:
                break
        found[k] = n >= min_rows[k]
        begin = ends[k]


@kernel
def release(gone, blocks, size, owner, confidence, changed):
    """Remove the ownership and votes of objects, marked by number in `gone` (M,) bool; see `rows_of`.

    Only blocks (B,), which may contain their rows, are searched; changed blocks are marked in `changed`.
    """
    for block in blocks:
        for row in range(block * size, min((block + 1) * size, owner.size)):
            if owner[row] < gone.size and gone[owner[row]]:
                owner[row] = confidence[row] = 0
                changed[block] = True


@kernel
def owner_of(slots, owner, hits, pixel_owner, mapped):
    """Look up the owner of the voxel of each pixel, and whether earlier frames saw the voxel.

    Parameters
    ----------
    slots : (h, w) int32
        Row of each pixel, -1: none.
    owner : (N,) int32
    hits : (N,) uint16
        Number of frames that saw each row, including this one.
    pixel_owner : (h, w) int32, output
        Owner of each pixel, 0: none.
    mapped : (h, w) bool, output
    """
    for v in range(slots.shape[0]):
        for u in range(slots.shape[1]):
            row = slots[v, u]
            pixel_owner[v, u] = owner[row] if row >= 0 else 0
            mapped[v, u] = row >= 0 and hits[row] > 1


@kernel
def choose(slots, owner, numbers, depth, far_m, chosen):
    """Keep only the pixels of a depth image in voxels of some objects and within a distance.

    Parameters
    ----------
    slots : (h, w) int32
        Row of each pixel, -1: none.
    owner : (N,) int32
    numbers : (M,) bool
        Whether each object, by number, is kept; objects from M on are not.
    depth : (h, w) float32
    far_m : float
    chosen : (h, w) float32, output
        Depth of the kept pixels, 0 elsewhere.

    Returns
    -------
    tuple of int
        First and last row, first and last column of the kept pixels, end exclusive; empty if there are none.
    """
    top, bottom, left, right = slots.shape[0], 0, slots.shape[1], 0
    for v in range(slots.shape[0]):
        for u in range(slots.shape[1]):
            row, chosen[v, u] = slots[v, u], 0.0
            if row < 0 or owner[row] >= numbers.size or not numbers[owner[row]] or depth[v, u] > far_m:
                continue
            chosen[v, u] = depth[v, u]
            top, bottom = min(top, v), v + 1
            left, right = min(left, u), max(right, u + 1)
    return top, bottom, left, right
