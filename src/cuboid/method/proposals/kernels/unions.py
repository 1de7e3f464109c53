"""Hot loops that join the segments of a depth image step by step, select among the unions, and write their masks."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.kernels.regions import (
    BOTTOM,
    GROOVES,
    INVERSE,
    LEFTMOST,
    OUTLINE,
    PIXELS,
    READINGS,
    RIGHTMOST,
    STRENGTH,
    TOP,
)


@kernel
def join(segments, borders, count, focal, largest, members, found, parts):
    """Join neighbouring segments step by step, weakest outline first, and keep all intermediate unions.

    Parameters
    ----------
    segments, borders : see `measure`
        Changed in place; `level` is not used.
    count : int
        The last label.
    focal : float
        Pixels.
    largest : float
        Largest size of a union, metres.
    members : (2 S, S) uint8, output
        Which segments each region consists of.
    found : (2 S, COLUMNS) float64, output
        Measures of each region.
    parts : (2 S, 2) int32, output
        The two regions that a union joins; -1 for a segment.

    Returns
    -------
    int
        Number of regions: the segments themselves, then the unions.
    """
    contact, weight, grooves = borders.contact, borders.weight, borders.grooves
    members[:] = 0
    alive = np.zeros(count + 1, np.uint8)
    current = np.zeros(count + 1, np.int32)
    n = 0
    for k in range(1, count + 1):
        if segments[k, READINGS] == 0:
            continue
        members[n, k] = 1
        for m in range(found.shape[1]):
            found[n, m] = segments[k, m]
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
                boundary = strength / np.sqrt(min(1.0, shared))
                if boundary < best and can_join(segments[a], segments[b], focal, largest):
                    best, i, j = boundary, a, b
        if best == np.inf:
            return n
        first, second = segments[i], segments[j]
        unite(first, second, contact[i, j], weight[i, j] + weight[j, i], grooves[i, j], first)
        alive[j] = 0
        for k in range(1, count + 1):
            if alive[k] and k != i:
                contact[i, k] += contact[j, k]
                contact[k, i] = contact[i, k]
                weight[i, k] += weight[j, k]
                weight[k, i] += weight[k, j]
                grooves[i, k] += grooves[j, k]
                grooves[k, i] = grooves[i, k]
        for k in range(1, count + 1):
            members[n, k] = members[current[i], k] | members[current[j], k]
        for m in range(found.shape[1]):
            found[n, m] = first[m]
        parts[n, 0], parts[n, 1] = current[i], current[j]
        current[i] = n
        n += 1


@kernel
def pair(segments, borders, count, focal, largest, n, members, found, parts):
    """Add the unions of two neighbouring segments that `join` did not make.

    `join` uses each segment in only one tree of unions: if the inside of a mug was joined with the wall behind it, no
    union is the mug.

    Parameters
    ----------
    segments, borders, count, focal, largest : see `join`
        As `measure` returned them.
    n : int
        Number of regions that `join` found.
    members, found, parts : see `join`, in and out
        Pairs beyond their size are dropped; three pairs per segment always fit, the most that plane regions have.

    Returns
    -------
    int
        Number of regions.
    """
    contact, weight, grooves = borders.contact, borders.weight, borders.grooves
    place = np.full(count + 1, -1, np.int64)
    single = np.zeros(n, np.int64)
    for i in range(n):
        if parts[i, 0] < 0:
            single[i] = members[i].argmax()
            place[single[i]] = i
    made = np.zeros((count + 1, count + 1), np.uint8)
    for i in range(n):
        if parts[i, 0] >= 0:
            first, second = single[parts[i, 0]], single[parts[i, 1]]
            made[first, second] = made[second, first] = 1
    for a in range(1, count + 1):
        for b in range(a + 1, count + 1):
            if contact[a, b] == 0 or made[a, b] or n == len(members):
                continue
            if can_join(segments[a], segments[b], focal, largest):
                strength = weight[a, b] + weight[b, a]
                unite(segments[a], segments[b], contact[a, b], strength, grooves[a, b], found[n])
                members[n, a] = members[n, b] = 1
                parts[n, 0], parts[n, 1] = place[a], place[b]
                n += 1
    return n


@kernel
def distinct(order, members, pixels, weight, same, kept):
    """Select regions, best first, without near duplicates of better ones.

    Parameters
    ----------
    order : (K,) int64
        Regions, best first.
    members : (N, S) uint8
        Which segments each region consists of.
    pixels : (N,) int64
        Pixels of each region.
    weight : (S,) int64
        Pixels of each segment.
    same : float
        Regions with this IoU or more are duplicates.
    kept : (most,) int64, output
        The selected regions.

    Returns
    -------
    int
        Number of selected regions.
    """
    n = 0
    for a in order:
        if n == kept.size:
            break
        new = True
        for j in range(n):
            b = kept[j]
            # The IoU is at most the ratio of the sizes; 0.99 allows for rounding.
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


@kernel(inline="always")
def unite(first, second, shared, strength, grooves, union):
    """Compute the measures of the union of two segments; the output may be one of them.

    Parameters
    ----------
    first, second : (COLUMNS,) float64
    shared : float
        Length of the shared outline, pixels.
    strength : float
        Sum of the strengths of the shared outline, in both directions.
    grooves : float
        Length of the shared outline in grooves, pixels.
    union : (COLUMNS,) float64, output
    """
    union[PIXELS] = first[PIXELS] + second[PIXELS]
    union[READINGS] = first[READINGS] + second[READINGS]
    union[INVERSE] = first[INVERSE] + second[INVERSE]
    union[LEFTMOST], union[TOP] = min(first[LEFTMOST], second[LEFTMOST]), min(first[TOP], second[TOP])
    union[RIGHTMOST] = max(first[RIGHTMOST], second[RIGHTMOST])
    union[BOTTOM] = max(first[BOTTOM], second[BOTTOM])
    union[OUTLINE] = first[OUTLINE] + second[OUTLINE] - 2.0 * shared
    union[STRENGTH] = first[STRENGTH] + second[STRENGTH] - strength
    union[GROOVES] = first[GROOVES] + second[GROOVES] + grooves


@kernel(inline="always")
def extent(row, focal):
    """Return the longer side of a segment's rectangle at its mean depth, metres."""
    side = max(row[RIGHTMOST] - row[LEFTMOST], row[BOTTOM] - row[TOP]) + 1.0
    return side * row[READINGS] / (row[INVERSE] * focal)


@kernel(inline="always")
def can_join(first, second, focal, largest):
    """Return whether a union would be no larger than an object, in the image and in depth."""
    z1, z2 = first[READINGS] / first[INVERSE], second[READINGS] / second[INVERSE]
    if abs(z1 - z2) > 0.5 * largest:
        return False
    across = max(first[RIGHTMOST], second[RIGHTMOST]) - min(first[LEFTMOST], second[LEFTMOST])
    down = max(first[BOTTOM], second[BOTTOM]) - min(first[TOP], second[TOP])
    return (max(across, down) + 1.0) * 0.5 * (z1 + z2) / focal <= largest


@kernel
def cut_masks(labels, members, chosen, boxes, masks):
    """Write the masks of regions, each cropped to its rectangle, one after the other.

    Parameters
    ----------
    labels : (h, w) int16
        Segment of each pixel, 0: none, -1: far, -2 - p: on plane p.
    members : (N, S) uint8
        1 for each segment of a region; planes are counted from the end.
    chosen : (K,) int64
        Regions.
    boxes : (K, 4) int32
        x0, y0, x1, y1 of each region, end exclusive.
    masks : (L,) uint8, output
    """
    at, last = 0, members.shape[1]
    # For each label, from the last plane's on, whether it belongs to the region.
    inside = np.zeros(2 * last + 1, np.uint8)
    for row in range(chosen.size):
        for k in range(last):
            inside[k] = inside[last + 1 + k] = members[chosen[row], k]
        x0, y0, x1, y1 = boxes[row]
        for v in range(y0, y1):
            line, seen = masks[at : at + x1 - x0], labels[v, x0:x1]
            for u in range(seen.size):
                line[u] = inside[seen[u] + last + 1]
            at += x1 - x0
