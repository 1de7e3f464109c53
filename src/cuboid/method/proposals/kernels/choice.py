"""Hot loops that choose disjoint regions: exactly in one tree, by exchanges among several."""

from __future__ import annotations

from cuboid.ground.compiling.compiled import kernel


@kernel
def best_in_tree(parts, count, gains, best, chosen):
    """Choose the disjoint regions of a tree with the largest sum of gains: a dynamic program.

    The best choice below a region is the region itself, or the best choices below its two parts.

    Parameters
    ----------
    parts : (>= count, 2) int32
        The two parts of each region, -1: a leaf; parts come before their union.
    count : int
    gains : (count,) float64
        A region with a gain of 0 or less is never chosen.
    best : (count,) float64, output
        The largest sum within each region.
    chosen : (count,) uint8, output
        Whether the region is chosen.

    Returns
    -------
    float
        The largest sum of the tree.
    """
    total = 0.0
    for i in range(count):
        below = 0.0 if parts[i, 0] < 0 else best[parts[i, 0]] + best[parts[i, 1]]
        best[i] = max(gains[i], below, 0.0)
        chosen[i] = gains[i] > 0.0 and gains[i] >= below
    # From the roots down: below a chosen region nothing else is.
    covered = chosen.copy()
    for i in range(count - 1, -1, -1):
        for k in range(2):
            part = parts[i, k]
            if part >= 0 and covered[i]:
                chosen[part] = 0
                covered[part] = 1
    for i in range(count):
        if chosen[i]:
            total += gains[i]
    return total


@kernel
def overlaps(rectangles, starts, flat, sizes, max_fraction, conflict):
    """Mark the pairs of masks that cannot both be chosen.

    Parameters
    ----------
    rectangles : (M, 4) int64
    starts : (M,) int64
    flat : (L,) uint8
        See `sums.mask_sums`.
    sizes : (M,) int64
        Pixels of each mask.
    max_fraction : float
        Two masks conflict if they share more than this fraction of the smaller one.
    conflict : (M, M) uint8, output
    """
    for i in range(len(sizes)):
        conflict[i, i] = 0
        for j in range(i):
            x0, y0 = max(rectangles[i, 0], rectangles[j, 0]), max(rectangles[i, 1], rectangles[j, 1])
            x1, y1 = min(rectangles[i, 2], rectangles[j, 2]), min(rectangles[i, 3], rectangles[j, 3])
            common = 0
            for v in range(y0, y1):
                a = starts[i] + (v - rectangles[i, 1]) * (rectangles[i, 2] - rectangles[i, 0]) - rectangles[i, 0]
                b = starts[j] + (v - rectangles[j, 1]) * (rectangles[j, 2] - rectangles[j, 0]) - rectangles[j, 0]
                for u in range(x0, x1):
                    common += flat[a + u] & flat[b + u]
            conflict[i, j] = conflict[j, i] = common > max_fraction * min(sizes[i], sizes[j])


@kernel
def exchange(gains, conflict, rounds, chosen):
    """Improve a choice of regions without conflicts, until no exchange raises the sum of their gains.

    A region comes in for those that it conflicts with, if it gains more than they do together; several regions come in
    for one if they gain more than it.

    Parameters
    ----------
    gains : (M,) float64
        In descending order, larger than 0.
    conflict : (M, M) uint8
    rounds : int
        Largest number of rounds.
    chosen : (M,) uint8, in and out
        Without conflicts.
    """
    count = len(gains)
    for _ in range(rounds):
        changed = False
        for i in range(count):
            if chosen[i]:
                continue
            against = 0.0
            for j in range(count):
                if chosen[j] and conflict[i, j]:
                    against += gains[j]
            if gains[i] > against:
                for j in range(count):
                    if conflict[i, j]:
                        chosen[j] = 0
                chosen[i] = 1
                changed = True
        for i in range(count):
            if chosen[i] and split(gains, conflict, i, chosen):
                changed = True
        if not changed:
            return


@kernel
def split(gains, conflict, i, chosen):
    """Replace a chosen region by several that conflict with it alone, if they gain more; return whether it was."""
    count, together = len(gains), 0.0
    chosen[i] = 0
    for j in range(count):
        if j != i and not chosen[j] and conflict[i, j] and fits(conflict, j, chosen):
            chosen[j] = 2
            together += gains[j]
    better = together > gains[i]
    for j in range(count):
        if chosen[j] == 2:
            chosen[j] = 1 if better else 0
    if not better:
        chosen[i] = 1
    return better


@kernel
def fits(conflict, i, chosen):
    """Return whether a region conflicts with no chosen one."""
    return not (conflict[i] * chosen).any()


@kernel
def cut_regions(labels, place, spans, rectangles, starts, flat):
    """Write the masks of regions that are spans of leaves.

    Parameters
    ----------
    labels : (h, w) int32
        Leaf of each pixel.
    place : (N,) int32
        Place of each leaf in the order of its tree: the leaves of a region follow one another.
    spans : (M, 2) int32
        First place, and the place after the last one, of each region.
    rectangles : (M, 4) int64
    starts : (M,) int64
    flat : (L,) uint8, output
    """
    for m in range(len(spans)):
        x0, y0, x1, y1 = rectangles[m, 0], rectangles[m, 1], rectangles[m, 2], rectangles[m, 3]
        at = starts[m]
        for v in range(y0, y1):
            for u in range(x0, x1):
                p = place[labels[v, u]]
                flat[at] = spans[m, 0] <= p and p < spans[m, 1]
                at += 1


@kernel
def order_leaves(parts, parent, count, leaves, place, spans):
    """Put the leaves of a tree in an order in which those of each region follow one another.

    Parameters
    ----------
    parts : (>= count, 2) int32
    parent : (>= count,) int32
    count, leaves : int
        Number of regions, and of leaves.
    place : (leaves,) int32, output
    spans : (count, 2) int32, output
    """
    for i in range(count):
        spans[i, 1] = 1 if i < leaves else spans[parts[i, 0], 1] + spans[parts[i, 1], 1]  # number of leaves
    begin = 0
    for i in range(count - 1, -1, -1):
        if parent[i] < 0:
            spans[i, 0] = begin
            begin += spans[i, 1]
        if i >= leaves:
            a, b = parts[i, 0], parts[i, 1]
            spans[a, 0] = spans[i, 0]
            spans[b, 0] = spans[i, 0] + spans[a, 1]
    for i in range(count):
        spans[i, 1] += spans[i, 0]
        if i < leaves:
            place[i] = spans[i, 0]
