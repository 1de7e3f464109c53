"""Hot loops that share a frame's pixels out among its proposals, and weigh what bounds each share."""

from __future__ import annotations

import numpy as np
from numba import njit

# What lies across a piece of outline: columns of `outline`.
FREE, SUPPORT, UNSURE, CONTACT, HIDDEN, BORDER = range(6)
KINDS = 6
# Sides of a thing in the picture, seen from the camera held upright: columns of `outline` too.
TOP, BOTTOM, LEFT, RIGHT = range(4)
# The top and the bottom of a thing are so much of its height.
END_SHARE = 0.05
# Color that differs by so many levels, over its three channels, has an edge in between: a third of that is shading and
# the camera's noise. It is compared with that of so many pixels inside, clear of the blur at an outline.
EDGE_LEVELS, INNER_PIXELS = 90, 2


@njit(cache=True, nogil=True)
def common(owner, place, rectangles, starts, covered, column, table, sight):
    """Count the candidates that each proposal covers, by the object that they belong to.

    Parameters
    ----------
    owner : (h, w) int32
        Object of each working pixel, 0 none.
    place : (M,) int64
        Column of each object by number; the last one for those that do not count, and for 0.
    rectangles : (N, 4) int64
    starts : (N + 1,) int64
    covered : (L,) uint8
        See `votes.weigh`.
    column : (h, w) int32, scratch
    table : (N, columns) int64, output
    sight : (columns,) int64, output
        Pixels of each object, candidates or not, in any proposal or none.
    """
    table[:] = 0
    sight[:] = 0
    # What belongs to one object comes in runs: a sum in hand is faster than one in memory.
    last, run = 0, 0
    for v in range(owner.shape[0]):
        for u in range(owner.shape[1]):
            here = place[owner[v, u]]
            column[v, u] = here
            if here != last:
                sight[last] += run
                last, run = here, 0
            run += 1
    sight[last] += run
    for k in range(rectangles.shape[0]):
        x0, y0, x1, y1 = rectangles[k]
        at, last, run = starts[k], 0, 0
        for v in range(y0, y1):
            for u in range(x0, x1):
                at += 1
                if covered[at - 1]:
                    if column[v, u] != last:
                        table[k, last] += run
                        last, run = column[v, u], 0
                    run += 1
        table[k, last] += run


@njit(cache=True, nogil=True)
def shared(claim, owner, known, place, table, size):
    """Count the pixels that each share of a frame has in common with each object, and those known before.

    Parameters
    ----------
    claim : (h, w) int32
        Share of each pixel, -1 none.
    owner : (h, w) int32
        Object of each pixel, 0 none.
    known : (h, w) bool
    place : (M,) int64
        Column of each object by number; the last one for those that do not count, and for 0.
    table : (n + 1, columns) int64, output
        The last row is for pixels of no share.
    size : (n + 1,) int64, output
        Known pixels of each share.
    """
    table[:] = 0
    size[:] = 0
    nobody = table.shape[0] - 1
    # They come in runs, as in `common`.
    mine, theirs, run, seen = nobody, 0, 0, 0
    for v in range(claim.shape[0]):
        for u in range(claim.shape[1]):
            k = claim[v, u] if claim[v, u] >= 0 else nobody
            here = place[owner[v, u]]
            if k != mine or here != theirs:
                table[mine, theirs] += run
                size[mine] += seen
                mine, theirs, run, seen = k, here, 0, 0
            run += 1
            seen += known[v, u]
    table[mine, theirs] += run
    size[mine] += seen


@njit(cache=True, nogil=True)
def share_out(order, rectangles, starts, covered, least, free_share, claim):
    """Give each candidate pixel to at most one proposal: the strongest first, as long as it is mostly free.

    Parameters
    ----------
    order : (K,) int64
        Proposals, the strongest first.
    rectangles : (N, 4) int64
    starts : (N + 1,) int64
    covered : (L,) uint8
        See `votes.weigh`.
    least : int
        A share of fewer pixels is none.
    free_share : float
        A proposal is left out when less than this of it is free.
    claim : (h, w) int32, output
        Place in `order` of the proposal that has the pixel, -1 none.
    """
    claim[:] = -1
    for i in range(order.size):
        k = order[i]
        x0, y0, x1, y1 = rectangles[k]
        # Without a branch, row by row: so one instruction takes many pixels.
        at, total, free = starts[k], 0, 0
        for v in range(y0, y1):
            mine, row = covered[at : at + x1 - x0], claim[v, x0:x1]
            for u in range(mine.size):
                total += mine[u]
                free += mine[u] if row[u] < 0 else 0
            at += x1 - x0
        if free < least or free < free_share * total:
            continue
        at = starts[k]
        for v in range(y0, y1):
            mine, row = covered[at : at + x1 - x0], claim[v, x0:x1]
            for u in range(mine.size):
                row[u] = i if (mine[u] != 0) & (row[u] < 0) else row[u]
            at += x1 - x0


@njit(cache=True, nogil=True)
def across(depth, color, claim, on_plane, plane, v, u, dv, du, limit, reach):
    """Tell what lies across one pixel of a share's outline: the first reading outwards, over holes.

    Parameters
    ----------
    plane : int
        What the share stands on, -1 none.
    v, u, dv, du : int
        The pixel, and the step outwards.
    limit : float
        Larger differences of depth are jumps, metres.
    reach : int
        Steps that a reading is looked for.

    Returns
    -------
    (int, int)
        The kind, -1 where the share itself goes on behind a hole; and the share that begins there, -1 none.

    Notes
    -----
    The other parameters are those of `outlines`.
    """
    height, width = depth.shape
    a, z = claim[v, u], depth[v, u]
    vi, ui = v - INNER_PIXELS * dv, u - INNER_PIXELS * du
    if vi < 0 or ui < 0 or vi >= height or ui >= width or claim[vi, ui] != a:
        vi, ui = v, u
    edge = False
    for n in range(1, reach + 1):
        vv, uu = v + n * dv, u + n * du
        if vv < 0 or uu < 0 or vv >= height or uu >= width:
            return BORDER, -1
        b, beyond = claim[vv, uu], depth[vv, uu]
        if b == a:
            return -1, -1
        if beyond > 0.0:
            if on_plane[vv, uu] >= 0 and on_plane[vv, uu] == plane:
                return SUPPORT, b
            if beyond > z + limit:
                return FREE, b
            if beyond < z - limit:
                return HIDDEN, b
            return UNSURE if b >= 0 else CONTACT, b
        change = 0
        for c in range(3):
            change += abs(np.int64(color[vv, uu, c]) - np.int64(color[vi, ui, c]))
        edge = edge or change >= EDGE_LEVELS
    return FREE if edge else UNSURE, -1


@njit(cache=True, nogil=True)
def outlines(depth, color, claim, on_plane, corners, plane_of, side_of, focal, noise, jump, gap_m, outline, contact):
    """Tell what bounds each share of a frame: air, what it stands on, another thing, something else, or nothing known.

    From each pixel of a share whose neighbour (of four) is not of it, the first reading outwards is looked for, over
    holes up to a width of `gap_m`. It is FREE where that lies behind by more than a jump; SUPPORT where it lies on the
    plane that the share stands on; UNSURE where another share begins at the same depth; CONTACT where any other
    surface goes on; HIDDEN where it lies before (what is behind it cannot be told); BORDER where the picture ends. In
    a wide hole (the shadow of an edge, or something dark) color tells: it is FREE beyond an edge of color, and UNSURE
    where the color of the share goes on.

    Parameters
    ----------
    depth : (h, w) float32
    color : (h, w, 3) uint8
    claim : (h, w) int32
        Share of each pixel, -1 none.
    on_plane : (h, w) int32
        Supporting plane that a pixel lies on, -1 none.
    corners : (count, 4) int64
        The least and the largest column and row of each share: left, top, right, bottom.
    plane_of : (count,) int64
        Plane that each share stands on, -1 none.
    side_of : (4,) int64
        Side of a thing that lies below, above, right and left of a pixel in the image: see TOP.
    focal : float
        Pixels.
    noise : float
        Standard deviation of depth is this times z squared.
    jump, gap_m : float
        Metres.
    outline : (count, 4, KINDS) int64, output
        Pixels of outline by side and kind.
    contact : (count, count) int64, output
        [i, j]: pixels of i's outline that lie at j, jump or none.
    """
    height, width = depth.shape
    outline[:] = 0
    contact[:] = 0
    for v in range(height):
        for u in range(width):
            a = claim[v, u]
            if a < 0:
                continue
            z = depth[v, u]
            limit = jump + 4.0 * noise * z * z
            reach = max(2, int(gap_m * focal / z))
            for k in range(4):
                dv, du = (k == 0) - (k == 1), (k == 2) - (k == 3)
                if 0 <= v + dv < height and 0 <= u + du < width and claim[v + dv, u + du] == a:
                    continue
                if side_of[k] <= BOTTOM:
                    # Top and bottom are at the ends, not where a slanted side steps.
                    low, high = (corners[a, 1], corners[a, 3]) if k < 2 else (corners[a, 0], corners[a, 2])
                    here = v if k < 2 else u
                    far = high - here if dv + du > 0 else here - low
                    if far > max(1.0, END_SHARE * (high - low)):
                        continue
                kind, b = across(depth, color, claim, on_plane, plane_of[a], v, u, dv, du, limit, reach)
                if b >= 0:
                    contact[a, b] += 1
                if kind >= 0:
                    outline[a, side_of[k], kind] += 1


@njit(cache=True, nogil=True)
def vote(claim, number_of, place, allowed, candidate, slots, hits, most, owner, confidence, voted):
    """Let the pixels of a frame vote for whom their voxels belong to: a majority vote in one number a voxel.

    Boyer and Moore 1981: a voxel's owner gains a vote where a frame agrees and loses one where it does not; whoever
    takes the last one away owns it. A voxel has one vote a frame.

    Parameters
    ----------
    claim : (h, w) int32
        Share of each pixel, -1 none.
    number_of : (count,) int32
        Object that each share votes for; 0 abstains.
    place : (M,) int64
        Column of each object by number; 0 for no one, -1 for those that are not in view.
    allowed : (count, columns) uint8
        1 where a share may take voxels that were seen before from an object; any share strengthens what its object
        has, and takes what is new.
    candidate : (h, w) uint8
        0 on supporting planes: such pixels vote for no one.
    slots : (h, w) int32
        Voxel of each pixel, -1 none.
    hits : (C,) int32
        Frames that saw each voxel, this one included.
    most : int
        Most votes that a voxel keeps.
    owner : (C,) int32, in and out
    confidence : (C,) uint8, in and out
    voted : (C,) uint8, scratch
        Zeros.
    """
    height, width = claim.shape
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
            held = owner[row]
            if held == number:
                if number > 0 and confidence[row] < most:
                    confidence[row] += 1
            elif confidence[row] <= 1:
                owner[row] = number
                confidence[row] = 1 if number > 0 else 0
            else:
                confidence[row] -= 1
            voted[row] = 1
    for v in range(height):
        for u in range(width):
            if slots[v, u] >= 0:
                voted[slots[v, u]] = 0
