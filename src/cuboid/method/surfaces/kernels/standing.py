"""Hot loops that find pieces that rise from the flat areas of a depth image, and classify their surroundings."""

from __future__ import annotations

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import JUMP_SIGMAS, SIGMAS
from cuboid.method.surfaces.kernels.pieces import find_root

# Columns of `others` in `bounds`: kinds of neighbour across the outline of a piece, other than planes it touches.
FREE, HIDDEN, BORDER, CONTACT = range(4)
KINDS = len((FREE, HIDDEN, BORDER, CONTACT))
# Codes of readings on no plane: on another surface, or without a valid depth.
SURFACE, NOTHING = range(-1, -3, -1)


@kernel(error_model="numpy")
def lie_on(depth, camera, planes, noise, floor, bias, max_depth, on):
    """Find the plane on which each reading lies.

    Parameters
    ----------
    depth : (H, W) float32
        Metres, 0 none.
    camera : (4,) float64
        fx, fy, cx, cy.
    planes : (P, 4) float64
        Unit normal towards the camera and offset, in the camera frame: n.p + d is the height above it.
    noise : float
        Standard deviation of depth is noise * z * z, 1/metre.
    floor, bias : float
        A reading is off a plane at max(floor, bias + 3 standard deviations of its height) or more, metres.
    max_depth : float
        Metres.
    on : (H, W) int8, output
        Index of a plane, SURFACE or NOTHING.
    """
    rows, columns = depth.shape
    for v in range(rows):
        y = (v - camera[3]) / camera[1]
        for u in range(columns):
            z = depth[v, u]
            on[v, u] = NOTHING if not (0.0 < z <= max_depth) else SURFACE
            if on[v, u] == NOTHING:
                continue
            x = (u - camera[2]) / camera[0]
            nearest = 1.0
            for p in range(len(planes)):
                along = planes[p, 0] * x + planes[p, 1] * y + planes[p, 2]
                off = abs(along * z + planes[p, 3]) / max(floor, bias - SIGMAS * noise * z * z * along)
                if off < nearest:
                    nearest = off
                    on[v, u] = p


@kernel
def label_pieces(depth, on, noise, jump_m, labels, queue):
    """Number the connected pieces of surface on no plane, cut at depth jumps.

    Parameters
    ----------
    depth : (H, W) float32
    on : (H, W) int8
        From `lie_on`.
    noise : float
    jump_m : float
        Larger depth steps, beyond noise, are jumps, metres.
    labels : (H, W) int32, output
        From 0; -1 elsewhere.
    queue : (H * W, 2) int32, scratch

    Returns
    -------
    int
        Number of pieces.
    """
    rows, columns = depth.shape
    labels[:] = -1
    count = 0
    for row in range(rows):
        for column in range(columns):
            if on[row, column] != SURFACE or labels[row, column] >= 0:
                continue
            labels[row, column] = count
            queue[0, 0], queue[0, 1] = row, column
            head, tail = 0, 1
            while head < tail:
                v, u = queue[head]
                head += 1
                z = depth[v, u]
                limit = jump_m + JUMP_SIGMAS * noise * z * z
                for k in range(4):
                    vv, uu = v + (k == 0) - (k == 1), u + (k == 2) - (k == 3)
                    if vv < 0 or uu < 0 or vv >= rows or uu >= columns:
                        continue
                    if on[vv, uu] != SURFACE or labels[vv, uu] >= 0 or abs(depth[vv, uu] - z) > limit:
                        continue
                    labels[vv, uu] = count
                    queue[tail, 0], queue[tail, 1] = vv, uu
                    tail += 1
            count += 1
    return count


@kernel
def gather_pieces(labels, starts, pixels):
    """List the pixels of each piece, in the order of the image.

    Parameters
    ----------
    labels : (H, W) int32
        From `label_pieces`.
    starts : (N + 1,) int64, output
        The pixels of piece k are `pixels[starts[k] : starts[k + 1]]`.
    pixels : (H * W, 2) int32, output
        Row and column.
    """
    rows, columns = labels.shape
    starts[:] = 0
    for v in range(rows):
        for u in range(columns):
            if labels[v, u] >= 0:
                starts[labels[v, u] + 1] += 1
    for k in range(1, len(starts)):
        starts[k] += starts[k - 1]
    for v in range(rows):
        for u in range(columns):
            piece = labels[v, u]
            if piece >= 0:
                pixels[starts[piece], 0], pixels[starts[piece], 1] = v, u
                starts[piece] += 1
    for k in range(len(starts) - 1, 0, -1):
        starts[k] = starts[k - 1]
    starts[0] = 0


@kernel
def bounds(depth, on, labels, noise, jump_m, reach, touches, others, groups):
    """Count the kinds of neighbours across the outline of each piece: a plane that it touches, or something else.

    The first reading outwards decides, across holes up to `reach` pixels at 1 m; if there is none, nothing is counted.

    Parameters
    ----------
    depth, on, labels, noise, jump_m
        See `label_pieces`.
    reach : float
        Pixels times metres.
    touches : (N, P) int64, output
        Number of outline pixels at which each plane continues without a jump.
    others : (N, KINDS) int64, output
        Number of outline pixels at which the next surface lies behind (FREE), lies in front (HIDDEN), continues and
        is not a plane (CONTACT), or at which the image ends (BORDER).
    groups : (N,) int64, output
        Lowest number among the pieces that are connected with each one by contact.
    """
    rows, columns = depth.shape
    touches[:] = 0
    others[:] = 0
    for k in range(len(groups)):
        groups[k] = k
    for v in range(rows):
        for u in range(columns):
            piece = labels[v, u]
            if piece < 0 or (
                0 < v < rows - 1
                and 0 < u < columns - 1
                and piece == labels[v - 1, u] == labels[v + 1, u] == labels[v, u - 1] == labels[v, u + 1]
            ):
                continue
            z = depth[v, u]
            limit = jump_m + JUMP_SIGMAS * noise * z * z
            for k in range(4):
                dv, du = (k == 0) - (k == 1), (k == 2) - (k == 3)
                for n in range(1, max(2, int(reach / z)) + 1):
                    vv, uu = v + n * dv, u + n * du
                    if vv < 0 or uu < 0 or vv >= rows or uu >= columns:
                        others[piece, BORDER] += 1
                        break
                    beyond = depth[vv, uu]
                    if beyond <= 0.0:
                        continue
                    if labels[vv, uu] == piece:
                        break
                    if beyond > z + limit:
                        others[piece, FREE] += 1
                    elif beyond < z - limit:
                        others[piece, HIDDEN] += 1
                    elif on[vv, uu] >= 0:
                        touches[piece, on[vv, uu]] += 1
                    else:
                        others[piece, CONTACT] += 1
                        if labels[vv, uu] >= 0:
                            first, second = find_root(groups, piece), find_root(groups, labels[vv, uu])
                            groups[max(first, second)] = min(first, second)
                    break
    for k in range(len(groups)):
        groups[k] = find_root(groups, k)
