"""Hot loops that assign a frame's pixels to its proposals, and let segments vote for the owners of voxels."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.method.heatmap.kernels.cubes import BLOCK_BITS

# Size of the table of pairs (object, block) that avoids duplicates while pairs are collected; a power of 2.
REMEMBERED = 256


@kernel
def proposal_overlaps(owner, place, rectangles, starts, covered, column, table, object_pixels):
    """Count the candidates that each proposal covers, by the object that owns them.

    Parameters
    ----------
    owner : (h, w) int32
        Object of each working pixel, 0: none.
    place : (M,) int64
        Column of each object by number; the last column for 0 and for objects that do not count.
    rectangles : (N, 4) int64
    starts : (N + 1,) int64
    covered : (L,) uint8
        See `votes.weigh`.
    column : (h, w) int32, scratch
    table : (N, columns) int64, output
    object_pixels : (columns,) int64, output
        Number of pixels of each object, inside or outside candidates and proposals.
    """
    table[:] = 0
    object_pixels[:] = 0
    # Pixels of one object form runs: a sum in a register is faster than one in memory.
    last_column, run = 0, 0
    for v in range(owner.shape[0]):
        for u in range(owner.shape[1]):
            pixel_column = place[owner[v, u]]
            column[v, u] = pixel_column
            if pixel_column != last_column:
                object_pixels[last_column] += run
                last_column, run = pixel_column, 0
            run += 1
    object_pixels[last_column] += run
    for k in range(rectangles.shape[0]):
        x0, y0, x1, y1 = rectangles[k]
        at, last_column, run = starts[k], 0, 0
        for v in range(y0, y1):
            covers, columns = covered[at : at + x1 - x0], column[v, x0:x1]
            at += covers.size
            for u in range(covers.size):
                if covers[u]:
                    if columns[u] != last_column:
                        table[k, last_column] += run
                        last_column, run = columns[u], 0
                    run += 1
        table[k, last_column] += run


@kernel
def segment_overlaps(claim, owner, mapped, place, table, size):
    """Count the pixels that each segment of a frame shares with each object, and the pixels mapped before.

    Parameters
    ----------
    claim : (h, w) int32
        Segment of each pixel, -1: none.
    owner : (h, w) int32
        Object of each pixel, 0: none.
    mapped : (h, w) bool
    place : (M,) int64
        Column of each object by number; the last column for 0 and for objects that do not count.
    table : (n + 1, columns) int64, output
        The last row is for pixels outside all segments.
    size : (n + 1,) int64, output
        Number of mapped pixels of each segment.
    """
    table[:] = 0
    size[:] = 0
    no_segment = table.shape[0] - 1
    # Equal pixels form runs, as in `proposal_overlaps`.
    last_segment, last_column, run, seen = no_segment, 0, 0, 0
    for v in range(claim.shape[0]):
        for u in range(claim.shape[1]):
            k = claim[v, u] if claim[v, u] >= 0 else no_segment
            pixel_column = place[owner[v, u]]
            if k != last_segment or pixel_column != last_column:
                table[last_segment, last_column] += run
                size[last_segment] += seen
                last_segment, last_column, run, seen = k, pixel_column, 0, 0
            run += 1
            seen += mapped[v, u]
    table[last_segment, last_column] += run
    size[last_segment] += seen


@kernel
def assign_pixels(order, rectangles, starts, covered, min_pixels, free_fraction, claim):
    """Assign each candidate pixel to at most one proposal, strongest first, if the proposal is mostly free.

    Parameters
    ----------
    order : (K,) int64
        Proposals, strongest first.
    rectangles : (N, 4) int64
    starts : (N + 1,) int64
    covered : (L,) uint8
        See `votes.weigh`.
    min_pixels : int
        Smallest number of free pixels of a proposal.
    free_fraction : float
        A proposal is dropped if a smaller fraction of it is free.
    claim : (h, w) int32, output
        Index in `order` of the proposal of each pixel, -1: none.
    """
    claim[:] = -1
    for i in range(order.size):
        k = order[i]
        x0, y0, x1, y1 = rectangles[k]
        # No branches, row by row, so that the compiler can vectorise the loop.
        at, total, free = starts[k], 0, 0
        for v in range(y0, y1):
            covers, row = covered[at : at + x1 - x0], claim[v, x0:x1]
            for u in range(covers.size):
                total += covers[u]
                free += covers[u] if row[u] < 0 else 0
            at += x1 - x0
        if free < min_pixels or free < free_fraction * total:
            continue
        at = starts[k]
        for v in range(y0, y1):
            covers, row = covered[at : at + x1 - x0], claim[v, x0:x1]
            for u in range(covers.size):
                row[u] = i if (covers[u] != 0) & (row[u] < 0) else row[u]
            at += x1 - x0


@kernel
def vote_owners(claim, number_of, place, allowed, candidate, slots, hits, max_votes, owner, confidence, voted):
    """Let the pixels of a frame vote for the owners of their voxels: a majority vote with one counter per voxel.

    By Boyer and Moore 1981: the owner of a voxel gains a vote if a frame agrees and loses one if it does not; the
    object that takes the last vote away becomes the owner. Each voxel gets one vote per frame.

    Parameters
    ----------
    claim : (h, w) int32
        Segment of each pixel, -1: none.
    number_of : (count,) int32
        Object for which each segment votes; 0 abstains.
    place : (M,) int64
        Column of each object by number; 0 for no owner, -1 for objects out of view.
    allowed : (count, columns) uint8
        1 if a segment may take voxels with earlier hits from an object; every segment may vote for its own object and
        take new voxels.
    candidate : (h, w) uint8
        0 on supporting planes: such pixels vote for no owner.
    slots : (h, w) int32
        Voxel of each pixel, -1: none.
    hits : (C,) int32
        Number of frames that saw each voxel, including this one.
    max_votes : int
        Largest number of votes of a voxel.
    owner : (C,) int32, in and out
    confidence : (C,) uint8, in and out
    voted : (C,) uint8, scratch
        Zeros.

    Returns
    -------
    (K,) int64
        Object << 32 | block for the rows that voted and have an owner; a pair may occur more than once.
    """
    height, width = claim.shape
    voters, count = np.empty(claim.size, np.int32), 0
    for v in range(height):
        for u in range(width):
            row = slots[v, u]
            if row < 0 or voted[row]:
                continue
            if claim[v, u] >= 0:
                number = number_of[claim[v, u]]
                if number == 0:
                    continue
                if owner[row] != number and hits[row] > 1:
                    column = place[owner[row]]
                    if column < 0 or not allowed[claim[v, u], column]:
                        continue
            elif candidate[v, u] == 0:
                number = 0
            else:
                continue
            present = owner[row]
            if present == number:
                if number > 0 and confidence[row] < max_votes:
                    confidence[row] += 1
            elif confidence[row] <= 1:
                owner[row] = number
                confidence[row] = 1 if number > 0 else 0
            else:
                confidence[row] -= 1
            voted[row] = 1
            voters[count] = row
            count += 1
    pairs, found, recent = np.empty(count, np.int64), 0, np.full(REMEMBERED, -1, np.int64)
    for row in voters[:count]:
        voted[row] = 0
        pair = (np.int64(owner[row]) << 32) | (np.int64(row) >> BLOCK_BITS)
        slot = (pair ^ (pair >> 32)) & (REMEMBERED - 1)
        if owner[row] > 0 and recent[slot] != pair:
            recent[slot] = pair
            pairs[found] = pair
            found += 1
    return pairs[:found]
