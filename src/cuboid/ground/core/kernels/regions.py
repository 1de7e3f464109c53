"""Hot loops that measure the segments of a depth image, and how strongly their outlines separate them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cuboid.ground.arrays import Float32Array
from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.kernels.segments import CREASE, GROOVE, NONE
from cuboid.ground.core.tolerances import JUMP_SIGMAS

# Columns of a segment: pixels, readings, sum of 1/z, rectangle (end inclusive), length of the outline, sum of the
# outline's strengths, and length of the grooves between its parts (0 for a segment).
PIXELS, READINGS, INVERSE, LEFTMOST, TOP, RIGHTMOST, BOTTOM, OUTLINE, STRENGTH, GROOVES = range(10)
COLUMNS = 10
# Strength of a piece of outline, i.e. how clearly it separates a segment from its surroundings, 0..1. BEFORE: in front
# of a surface behind it, the least value; it grows to 1 with the jump. UNDECIDED: at a hole or a crease, which may
# separate two objects or not. AFTER: towards a surface that hides it or stands on it. GAP: at a gap in a crease.
BEFORE, UNDECIDED, AFTER, GAP = 0.3, 0.4, 0.2, 0.1
# Label of pixels that are too far away; plane p has the label BACKGROUND - 1 - p.
BACKGROUND = -1


class Borders(NamedTuple):
    """The borders between segments, each (S, S) float32.

    Attributes
    ----------
    contact
        Length of the outline that two segments share, pixels.
    weight
        [i, j]: sum of the strengths of i's outline towards j.
    level
        The part of `weight` from places without a depth jump.
    grooves
        The part of `contact` in grooves without a depth jump.
    """

    contact: Float32Array
    weight: Float32Array
    level: Float32Array
    grooves: Float32Array


@kernel(inline="always")
def measure_run(row, v, first, end, height, width, readings, inverse):
    """Add a run of pixels, columns first..end - 1 of image row v, to the measures of a segment.

    `inverse` is the sum of 1/z of the segment including this run, added pixel by pixel.
    """
    row[PIXELS] += end - first
    row[READINGS] += readings
    row[INVERSE] = inverse
    row[LEFTMOST] = min(row[LEFTMOST], first)
    row[RIGHTMOST] = max(row[RIGHTMOST], end - 1)
    row[TOP] = min(row[TOP], v)
    row[BOTTOM] = max(row[BOTTOM], v)
    at_border = ((v == 0) + (v == height - 1)) * (end - first) + (first == 0) + (end == width)
    row[OUTLINE] += at_border


@kernel
def measure_row(v, kind, labels, inverse, segments, planes):
    """Add an image row to the measures of all segments and planes in it; see `measure`."""
    height, width = labels.shape
    end = 0
    while end < width:
        first, a = end, labels[v, end]
        if a == 0 or a == BACKGROUND:
            while end < width and labels[v, end] == a:
                end += 1
            continue
        row = segments[a] if a > 0 else planes[BACKGROUND - 1 - a]
        total, readings = row[INVERSE], 0
        while end < width and labels[v, end] == a:
            # All pixels of a plane are readings.
            if a < 0 or kind[v, end] != NONE:
                readings += 1
                total += inverse[v, end]
            end += 1
        measure_run(row, v, first, end, height, width, readings, total)


@kernel(error_model="numpy")  # an infinite reading has 1/z = 0
def measure(kind, labels, inverse, marks, noise, jump, sure, segments, borders, planes):
    """Measure each segment and large plane, and how strongly its outline separates it from its surroundings.

    The strength of a piece of a segment's outline is in 0..1. It is 1 towards a plane or a far surface; towards another
    segment behind it, it grows from 0.3 to 1 with the jump; 0.4 on a concave crease; 0.2 towards a surface that hides
    it; 0.1 if only a gap in a crease separates the two; 0.4 towards a hole. A large plane may be part of an object too,
    such as the lid of a box: see `along_plane`.

    Parameters
    ----------
    kind, labels, inverse, marks
        See `fill_holes` and `mark`.
    noise : float
        Standard deviation of 1/z, 1/metre.
    jump, sure : float
        Smallest jump, and the jump that certainly separates two objects, metres.
    segments : (S, COLUMNS) float64, output
        Row k belongs to label k.
    borders : Borders, output
    planes : (P, COLUMNS) float64, output
        Measures of the large planes.
    """
    height, width = labels.shape
    borders.contact[:] = 0.0
    borders.weight[:] = 0.0
    borders.level[:] = 0.0
    borders.grooves[:] = 0.0
    for rows in (segments, planes):
        rows[:] = 0.0
        rows[:, LEFTMOST] = width
        rows[:, TOP] = height
    for v in range(height):
        measure_row(v, kind, labels, inverse, segments, planes)
        row, below = labels[v], labels[min(v + 1, height - 1)]
        for u in range(width):
            for k in range(2):
                a, b = row[u], row[min(u + 1, width - 1)] if k == 0 else below[u]
                if a == b:
                    continue
                vv, uu = v + k, u + 1 - k
                wa, wb = inverse[v, u], inverse[vv, uu]
                limit = jump * min(wa, wb) * min(wa, wb) + JUMP_SIGMAS * noise
                if a > 0 or b > 0:
                    between(a, b, wa, wb, limit, marks[v, u] | marks[vv, uu], sure, segments, borders)
                if a < BACKGROUND or b < BACKGROUND:
                    along_planes(a, b, wa, wb, limit, sure, planes)


@kernel(error_model="numpy")
def along_planes(a, b, wa, wb, limit, sure, planes):
    """Add a piece of outline between two labels with these 1/z, at least one of them a large plane."""
    if a < BACKGROUND:
        along_plane(planes[BACKGROUND - 1 - a], b, wa - wb, min(wa, wb), limit, sure)
    if b < BACKGROUND:
        along_plane(planes[BACKGROUND - 1 - b], a, wb - wa, min(wa, wb), limit, sure)


@kernel(error_model="numpy")
def between(a, b, wa, wb, limit, marked, sure, segments, borders):
    """Add a piece of outline between two labels with these 1/z, at least one of them a segment; see `measure`.

    `marked` are the marks of the pixels on both sides.
    """
    if a > 0:
        segments[a, OUTLINE] += 1
    if b > 0:
        segments[b, OUTLINE] += 1
    if a == 0 or b == 0:
        segments[max(a, b), STRENGTH] += UNDECIDED
        return
    gap = abs(wa - wb)
    # Depth difference of the two sides in metres.
    step = abs(1.0 / wa - 1.0 / wb)
    strength_a = strength_b = GAP
    if gap > limit:
        behind = BEFORE + (1.0 - BEFORE) * min(1.0, step / sure)
        strength_a = behind if wa > wb else AFTER
        strength_b = behind if wb > wa else AFTER
    elif marked & CREASE:
        strength_a = strength_b = UNDECIDED
    if a < 0:
        segments[b, STRENGTH] += 1.0 if gap <= limit or wb > wa else AFTER
    elif b < 0:
        segments[a, STRENGTH] += 1.0 if gap <= limit or wa > wb else AFTER
    else:
        segments[a, STRENGTH] += strength_a
        segments[b, STRENGTH] += strength_b
        borders.contact[a, b] += 1
        borders.contact[b, a] += 1
        borders.weight[a, b] += strength_a
        borders.weight[b, a] += strength_b
        if gap <= limit:
            borders.level[a, b] += strength_a
            borders.level[b, a] += strength_b
            if marked & GROOVE:
                borders.grooves[a, b] += 1
                borders.grooves[b, a] += 1


@kernel
def mean_colors(labels, color, step, means):
    """Average the colors of each segment.

    Parameters
    ----------
    labels : (h, w) int16
    color : (step h, step w, 3) uint8
    step : int
    means : (S, 3) float64, output
        Color levels; row k belongs to label k, 0 if no pixel has it.
    """
    means[:] = 0.0
    counts = np.zeros(len(means), np.int64)
    for v in range(labels.shape[0]):
        for u in range(labels.shape[1]):
            k = labels[v, u]
            if k > 0:
                counts[k] += 1
                for c in range(3):
                    means[k, c] += color[v * step, u * step, c]
    for k in range(len(means)):
        for c in range(3):
            means[k, c] /= max(1, counts[k])


@kernel(error_model="numpy", inline="always")
def along_plane(row, other, ahead, low, limit, sure):
    """Add a piece of a large plane's outline to its measures.

    Its strength: towards a surface behind it, growing from 0.3 to 1 with the jump; 0.6 where another large plane
    continues without a jump; 0.4 towards a hole; 0.2 towards a surface that hides it or stands on it.

    Parameters
    ----------
    row : (COLUMNS,) float64, in and out
    other : int
        The label on the other side.
    ahead : float
        1/z of the plane minus 1/z of the other side.
    low : float
        The smaller 1/z of the two.
    limit : float
        Larger differences of 1/z are a jump.
    sure : float
        See `measure`.
    """
    row[OUTLINE] += 1
    if other == 0:
        row[STRENGTH] += UNDECIDED
    elif abs(ahead) <= limit:
        row[STRENGTH] += 1.0 - UNDECIDED if other < BACKGROUND else AFTER
    elif ahead > 0.0:
        # Depth difference of the two sides in metres.
        row[STRENGTH] += BEFORE + (1.0 - BEFORE) * min(1.0, (1.0 / low - 1.0 / (low + ahead)) / sure)
    else:
        row[STRENGTH] += AFTER
