"""Hot loops over the segments of a depth image: holes filled, outlines weighed, neighbours joined step by step."""

from __future__ import annotations

import numpy as np
from numba import njit

from cuboid.kernels.segments import COLUMN_MASK, FAR, NONE, PLACE_BITS, PLANE

# Columns of a segment's row: pixels, readings, sum of 1/z, rectangle (end inclusive), length of the outline, the
# sum of its strengths, and how much of it is cut off by the image's border.
PIXELS, READINGS, INVERSE, LEFT, TOP, RIGHTMOST, BOTTOM, OUTLINE, STRENGTH, BORDER = range(10)
COLUMNS = 10
# Label of pixels that are too far away; plane p has BACKGROUND - 1 - p.
BACKGROUND = -1


@njit(cache=True, nogil=True)
def fill_holes(kind, on, color, step, edge, reach, focal, labels, inverse, cost, queue):
    """Give pixels without a reading the label and depth of what they lie nearest to, color edges being far to cross.

    A step to a neighbour costs 1 plus its difference in color over `edge`; a sweep there and one back find the
    cheapest way to good approximation (two more changed no recall and took as long again).
    What costs more than `reach` at the depth that it would get stays a hole.

    Parameters
    ----------
    kind : (H, W) uint8
    on : (H, W) int8
        The plane of each pixel, -1 none.
    color : (step H, step W, 3) uint8
    step : int
    edge : float
        Levels of color difference that count as one pixel.
    reach : float
        Metres.
    focal : float
        Pixels.
    labels : (H, W) int16, in and out
        Planes and far readings get theirs.
    inverse : (H, W) float32, in and out
    cost : (H, W) float32, scratch
    queue : (H * W,) int32, scratch
    """
    per_level = np.float32(1.0 / edge)
    reach = np.float32(reach)
    focal = np.float32(focal)
    height, width = kind.shape
    holes = 0
    for v in range(height):
        for u in range(width):
            if kind[v, u] == NONE:
                cost[v, u] = np.inf
                labels[v, u] = 0
                inverse[v, u] = 0.0
                queue[holes] = (v << PLACE_BITS) | u
                holes += 1
            else:
                cost[v, u] = 0.0
                if kind[v, u] == PLANE or kind[v, u] == FAR:
                    labels[v, u] = BACKGROUND - 1 - on[v, u]
    for sweep in range(2):
        s = -1 if sweep % 2 == 0 else 1
        for i in range(holes):
            here = queue[i if s < 0 else holes - 1 - i]
            v, u = here >> PLACE_BITS, here & COLUMN_MASK
            best = cost[v, u]
            for k in range(4):
                vv = v if k == 0 else v + s
                uu = u + s if k == 0 else u + k - 2
                if vv < 0 or uu < 0 or vv >= height or uu >= width or cost[vv, uu] + 1.0 >= best:
                    continue
                limit = min(best, reach * focal * inverse[vv, uu])
                total = cost[vv, uu] + (1.4 if k == 1 or k == 3 else 1.0)
                if total > limit:
                    continue
                change = abs(np.int32(color[v * step, u * step, 0]) - np.int32(color[vv * step, uu * step, 0]))
                change += abs(np.int32(color[v * step, u * step, 1]) - np.int32(color[vv * step, uu * step, 1]))
                change += abs(np.int32(color[v * step, u * step, 2]) - np.int32(color[vv * step, uu * step, 2]))
                total += change * per_level
                if total < best and total <= limit:
                    best = total
                    labels[v, u] = labels[vv, uu]
                    inverse[v, u] = inverse[vv, uu]
            cost[v, u] = best


@njit(cache=True, nogil=True, error_model="numpy")  # a reading without end has 1/z = 0
def measure(kind, labels, inverse, marks, noise, jump, sure, segments, contact, weight):
    """Measure each segment, and how strongly its outline parts it from what is around it.

    The strength of a piece of outline, 0..1: 1 towards a plane or a far thing; towards another segment that lies
    behind it, growing from 0.3 to 1 with the jump; 0.4 on a concave crease; 0.2 towards what hides it;
    0.1 where nothing but a gap in a crease parts the two; 0.4 towards a hole.

    Parameters
    ----------
    kind, labels, inverse, marks
        See `fill_holes` and `mark`.
    noise : float
        Standard deviation of 1/z, 1/metre.
    jump, sure : float
        Least jump, and the jump that is surely another object, metres.
    segments : (S, COLUMNS) float64, output
        Row k is label k.
    contact : (S, S) float32, output
        Pixels of outline that two segments share.
    weight : (S, S) float32, output
        [i, j]: the sum of strengths of i's outline towards j.
    """
    height, width = labels.shape
    segments[:] = 0.0
    contact[:] = 0.0
    weight[:] = 0.0
    segments[:, LEFT] = width
    segments[:, TOP] = height
    for v in range(height):
        for u in range(width):
            a = labels[v, u]
            if a > 0:
                row = segments[a]
                row[PIXELS] += 1
                if kind[v, u] != NONE:
                    row[READINGS] += 1
                    row[INVERSE] += inverse[v, u]
                row[LEFT] = min(row[LEFT], u)
                row[RIGHTMOST] = max(row[RIGHTMOST], u)
                row[TOP] = min(row[TOP], v)
                row[BOTTOM] = max(row[BOTTOM], v)
                at_border = (u == 0) + (v == 0) + (u == width - 1) + (v == height - 1)
                row[OUTLINE] += at_border
                row[BORDER] += at_border
            for k in range(2):
                vv, uu = v + k, u + 1 - k
                if vv >= height or uu >= width:
                    continue
                b = labels[vv, uu]
                if a == b or max(a, b) <= 0:
                    continue
                if a > 0:
                    segments[a, OUTLINE] += 1
                if b > 0:
                    segments[b, OUTLINE] += 1
                if a == 0 or b == 0:
                    segments[max(a, b), STRENGTH] += 0.4
                    continue
                wa, wb = inverse[v, u], inverse[vv, uu]
                low = min(wa, wb)
                limit = jump * low * low + 4.0 * noise
                gap = abs(wa - wb)
                # A jump in metres, from the nearer of the two to the farther.
                step = abs(1.0 / wa - 1.0 / wb)
                strength_a = strength_b = 0.1
                if gap > limit:
                    behind = 0.3 + 0.7 * min(1.0, step / sure)
                    strength_a = behind if wa > wb else 0.2
                    strength_b = behind if wb > wa else 0.2
                elif (marks[v, u] | marks[vv, uu]) & 4:
                    strength_a = strength_b = 0.4
                if a < 0:
                    segments[b, STRENGTH] += 1.0 if gap <= limit or wb > wa else 0.2
                elif b < 0:
                    segments[a, STRENGTH] += 1.0 if gap <= limit or wa > wb else 0.2
                else:
                    segments[a, STRENGTH] += strength_a
                    segments[b, STRENGTH] += strength_b
                    contact[a, b] += 1
                    contact[b, a] += 1
                    weight[a, b] += strength_a
                    weight[b, a] += strength_b


@njit(cache=True, nogil=True, error_model="numpy")  # a reading without end has 1/z = 0
def measure_planes(labels, inverse, noise, jump, sure, rows):
    """Measure large planes as if they were segments: the lid of a box is one too.

    The strength of a piece of outline: towards what lies behind, growing from 0.3 to 1 with the jump; 0.6 where another
    large plane goes on from it; 0.4 towards a hole; 0.2 towards what hides it or stands on it.

    Parameters
    ----------
    labels, inverse, noise, jump, sure : see `measure`
    rows : (P, COLUMNS) float64, output
    """
    height, width = labels.shape
    rows[:] = 0.0
    rows[:, LEFT] = width
    rows[:, TOP] = height
    for v in range(height):
        for u in range(width):
            a = labels[v, u]
            if a < BACKGROUND:
                row = rows[BACKGROUND - 1 - a]
                row[PIXELS] += 1
                row[READINGS] += 1
                row[INVERSE] += inverse[v, u]
                row[LEFT] = min(row[LEFT], u)
                row[RIGHTMOST] = max(row[RIGHTMOST], u)
                row[TOP] = min(row[TOP], v)
                row[BOTTOM] = max(row[BOTTOM], v)
                at_border = (u == 0) + (v == 0) + (u == width - 1) + (v == height - 1)
                row[OUTLINE] += at_border
                row[BORDER] += at_border
            for k in range(2):
                vv, uu = v + k, u + 1 - k
                if vv >= height or uu >= width or labels[vv, uu] == a:
                    continue
                b = labels[vv, uu]
                low = min(inverse[v, u], inverse[vv, uu])
                for side in range(2):
                    own, other = (a, b) if side == 0 else (b, a)
                    if own >= BACKGROUND:
                        continue
                    row = rows[BACKGROUND - 1 - own]
                    row[OUTLINE] += 1
                    if other == 0:
                        row[STRENGTH] += 0.4
                        continue
                    ahead = inverse[v, u] - inverse[vv, uu]
                    if side == 1:
                        ahead = -ahead
                    if abs(ahead) <= jump * low * low + 4.0 * noise:
                        row[STRENGTH] += 0.6 if other < BACKGROUND else 0.2
                    elif ahead > 0.0:
                        # From the nearer to the farther, in metres.
                        row[STRENGTH] += 0.3 + 0.7 * min(1.0, (1.0 / low - 1.0 / (low + ahead)) / sure)
                    else:
                        row[STRENGTH] += 0.2


@njit(cache=True, nogil=True)
def join(segments, contact, weight, count, focal, largest, members, found, parts):
    """Join neighbouring segments step by step, the weakest outline first, and keep all unions on the way.

    Parameters
    ----------
    segments, contact, weight : see `measure`
        Changed.
    count : int
        The last label.
    focal : float
        Pixels.
    largest : float
        No union is larger, metres.
    members : (2 S, S) uint8, output
        Which segments each region is made of.
    found : (2 S, COLUMNS) float64, output
        Its measures.
    parts : (2 S, 2) int32, output
        The two regions that a union joins; -1 for a segment.

    Returns
    -------
    int
        Number of regions: the segments themselves, then the unions.
    """
    members[:] = 0
    alive = np.zeros(count + 1, np.uint8)
    current = np.zeros(count + 1, np.int32)
    n = 0
    for k in range(1, count + 1):
        if segments[k, READINGS] == 0:
            continue
        members[n, k] = 1
        found[n] = segments[k]
        parts[n, 0] = parts[n, 1] = -1
        current[k] = n
        alive[k] = extent(segments[k], focal) <= largest
        n += 1
    while True:
        best, i, j = np.inf, 0, 0
        for a in range(1, count + 1):
            if not alive[a]:
                continue
            for b in range(a + 1, count + 1):
                if not alive[b] or contact[a, b] == 0:
                    continue
                strength = max(weight[a, b], weight[b, a]) / contact[a, b]
                shared = contact[a, b] / min(segments[a, OUTLINE], segments[b, OUTLINE])
                apart = strength / np.sqrt(min(1.0, shared))
                if apart < best and can_join(segments[a], segments[b], focal, largest):
                    best, i, j = apart, a, b
        if best == np.inf:
            return n
        one, other = segments[i], segments[j]
        unite(one, other, contact[i, j], weight[i, j] + weight[j, i], one)
        alive[j] = 0
        for k in range(1, count + 1):
            if alive[k] and k != i:
                contact[i, k] += contact[j, k]
                contact[k, i] = contact[i, k]
                weight[i, k] += weight[j, k]
                weight[k, i] += weight[k, j]
        for k in range(1, count + 1):
            members[n, k] = members[current[i], k] | members[current[j], k]
        found[n] = one
        parts[n, 0], parts[n, 1] = current[i], current[j]
        current[i] = n
        n += 1


@njit(cache=True, nogil=True)
def pair(segments, contact, weight, count, focal, largest, n, members, found, parts):
    """Add the unions of two neighbouring segments that `join` did not come by.

    A tree of unions gives a segment one chance: where the inside of a mug went with the wall behind it, no union is
    the mug.

    Parameters
    ----------
    segments, contact, weight, count, focal, largest : see `join`
        As `measure` gave them.
    n : int
        Number of regions that `join` found.
    members, found, parts : see `join`, in and out
        What has no room is left out: three pairs a segment, as many as regions of a plane can have, always have.

    Returns
    -------
    int
        Number of regions.
    """
    place = np.full(count + 1, -1, np.int64)
    single = np.zeros(n, np.int64)
    for i in range(n):
        if parts[i, 0] < 0:
            single[i] = members[i].argmax()
            place[single[i]] = i
    made = np.zeros((count + 1, count + 1), np.uint8)
    for i in range(n):
        if parts[i, 0] >= 0:
            one, other = single[parts[i, 0]], single[parts[i, 1]]
            made[one, other] = made[other, one] = 1
    for a in range(1, count + 1):
        for b in range(a + 1, count + 1):
            if contact[a, b] == 0 or made[a, b] or n == len(members):
                continue
            if can_join(segments[a], segments[b], focal, largest):
                unite(segments[a], segments[b], contact[a, b], weight[a, b] + weight[b, a], found[n])
                members[n, a] = members[n, b] = 1
                parts[n, 0], parts[n, 1] = place[a], place[b]
                n += 1
    return n


@njit(cache=True, nogil=True)
def distinct(order, members, pixels, weight, same, kept):
    """Choose regions, the best first, without those that are nearly the same as a better one.

    Parameters
    ----------
    order : (K,) int64
        Regions, the best first.
    members : (N, S) uint8
        Which segments each is made of.
    pixels : (N,) int64
        Of each region.
    weight : (S,) int64
        Pixels of each segment.
    same : float
        Regions with this IoU are the same.
    kept : (most,) int64, output
        The regions chosen.

    Returns
    -------
    int
        How many there are.
    """
    n = 0
    for a in order:
        if n == kept.size:
            break
        new = True
        for j in range(n):
            b = kept[j]
            # No IoU is larger than the quotient of their sizes; a little less, for rounding.
            if min(pixels[a], pixels[b]) < 0.99 * same * max(pixels[a], pixels[b]):
                continue
            common = 0
            for s in range(weight.size):
                common += weight[s] * (members[a, s] & members[b, s])
            if np.float32(common) / np.float32(max(pixels[a] + pixels[b] - common, 1)) >= np.float32(same):
                new = False
                break
        if new:
            kept[n] = a
            n += 1
    return n


@njit(cache=True, nogil=True, inline="always")
def unite(one, other, shared, strength, union):
    """Measure the union of two segments, which may be one of them.

    Parameters
    ----------
    one, other : (COLUMNS,) float64
    shared : float
        Pixels of outline that they share.
    strength : float
        The sum of its strengths, both ways.
    union : (COLUMNS,) float64, output
    """
    union[PIXELS] = one[PIXELS] + other[PIXELS]
    union[READINGS] = one[READINGS] + other[READINGS]
    union[INVERSE] = one[INVERSE] + other[INVERSE]
    union[LEFT], union[TOP] = min(one[LEFT], other[LEFT]), min(one[TOP], other[TOP])
    union[RIGHTMOST] = max(one[RIGHTMOST], other[RIGHTMOST])
    union[BOTTOM] = max(one[BOTTOM], other[BOTTOM])
    union[OUTLINE] = one[OUTLINE] + other[OUTLINE] - 2.0 * shared
    union[STRENGTH] = one[STRENGTH] + other[STRENGTH] - strength
    union[BORDER] = one[BORDER] + other[BORDER]


@njit(cache=True, nogil=True, inline="always")
def extent(row, focal):
    """Return the longer side of a segment's rectangle at its mean depth, metres."""
    side = max(row[RIGHTMOST] - row[LEFT], row[BOTTOM] - row[TOP]) + 1.0
    return side * row[READINGS] / (row[INVERSE] * focal)


@njit(cache=True, nogil=True, inline="always")
def can_join(one, other, focal, largest):
    """Whether a union would be no larger than an object, across and in depth."""
    z1, z2 = one[READINGS] / one[INVERSE], other[READINGS] / other[INVERSE]
    if abs(z1 - z2) > 0.5 * largest:
        return False
    across = max(one[RIGHTMOST], other[RIGHTMOST]) - min(one[LEFT], other[LEFT])
    down = max(one[BOTTOM], other[BOTTOM]) - min(one[TOP], other[TOP])
    return (max(across, down) + 1.0) * 0.5 * (z1 + z2) / focal <= largest
