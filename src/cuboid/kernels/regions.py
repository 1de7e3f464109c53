"""Hot loops that measure the segments of a depth image, and how strongly their outlines part them."""

from __future__ import annotations

from numba import njit

from cuboid.kernels.segments import NONE
from cuboid.tolerances import JUMP_SIGMAS, LITTLE, SOME

# Columns of a segment's row: pixels, readings, sum of 1/z, rectangle (end inclusive), length of the outline, the
# sum of its strengths, and how much of it is cut off by the image's border.
PIXELS, READINGS, INVERSE, LEFT, TOP, RIGHTMOST, BOTTOM, OUTLINE, STRENGTH, BORDER = range(10)
COLUMNS = 10
# How strongly a piece of outline parts a segment from what is around it, 0..1: at least before what lies behind, where
# it grows to 1 with the jump; at a hole or a crease, which may part the two or not. Towards what hides it or stands on
# it: some; at a gap in a crease: little.
BEFORE, HALF = 0.3, 0.4
# Label of pixels that are too far away; plane p has BACKGROUND - 1 - p.
BACKGROUND = -1


@njit(cache=True, nogil=True, inline="always")
def take_in(row, v, u, height, width, read, inverse):
    """Add a pixel to the measures of a segment."""
    row[PIXELS] += 1
    if read:
        row[READINGS] += 1
        row[INVERSE] += inverse
    row[LEFT] = min(row[LEFT], u)
    row[RIGHTMOST] = max(row[RIGHTMOST], u)
    row[TOP] = min(row[TOP], v)
    row[BOTTOM] = max(row[BOTTOM], v)
    at_border = (u == 0) + (v == 0) + (u == width - 1) + (v == height - 1)
    row[OUTLINE] += at_border
    row[BORDER] += at_border


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
                take_in(segments[a], v, u, height, width, kind[v, u] != NONE, inverse[v, u])
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
                    segments[max(a, b), STRENGTH] += HALF
                    continue
                wa, wb = inverse[v, u], inverse[vv, uu]
                low = min(wa, wb)
                limit = jump * low * low + JUMP_SIGMAS * noise
                gap = abs(wa - wb)
                # A jump in metres, from the nearer of the two to the farther.
                step = abs(1.0 / wa - 1.0 / wb)
                strength_a = strength_b = LITTLE
                if gap > limit:
                    behind = BEFORE + (1.0 - BEFORE) * min(1.0, step / sure)
                    strength_a = behind if wa > wb else SOME
                    strength_b = behind if wb > wa else SOME
                elif (marks[v, u] | marks[vv, uu]) & 4:
                    strength_a = strength_b = HALF
                if a < 0:
                    segments[b, STRENGTH] += 1.0 if gap <= limit or wb > wa else SOME
                elif b < 0:
                    segments[a, STRENGTH] += 1.0 if gap <= limit or wa > wb else SOME
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
                take_in(rows[BACKGROUND - 1 - a], v, u, height, width, True, inverse[v, u])
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
                        row[STRENGTH] += HALF
                        continue
                    ahead = inverse[v, u] - inverse[vv, uu]
                    if side == 1:
                        ahead = -ahead
                    if abs(ahead) <= jump * low * low + JUMP_SIGMAS * noise:
                        row[STRENGTH] += 1.0 - HALF if other < BACKGROUND else SOME
                    elif ahead > 0.0:
                        # From the nearer to the farther, in metres.
                        row[STRENGTH] += BEFORE + (1.0 - BEFORE) * min(1.0, (1.0 / low - 1.0 / (low + ahead)) / sure)
                    else:
                        row[STRENGTH] += SOME
