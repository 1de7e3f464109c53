"""Hot loops over the pixels assigned to proposals: split at depth jumps, join surfaces of one object, gather."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import JUMP_SIGMAS


@kernel(inline="always")
def find_root(parent, a):
    """Return the root of a in a union-find forest, halving the path."""
    while parent[a] != a:
        parent[a] = parent[parent[a]]
        a = parent[a]
    return a


@kernel
def label_regions(depth, assigned, noise, jump_m, parent, labels):
    """Number the 8-connected regions of pixels of one proposal with continuous depth.

    Neighbours are connected if their depths differ by less than `jump_m` plus the noise of two readings.

    Parameters
    ----------
    depth : (H, W) float32
    assigned : (H, W) int32
        Proposal of each pixel, -1: none.
    noise, jump_m : float
    parent : (H * W,) int32, scratch
    labels : (H, W) int32, output
        From 1 in the order of their first pixel, 0 elsewhere.

    Returns
    -------
    int
        Number of regions.
    """
    rows, columns = depth.shape
    for v in range(rows):
        row, above, row_depth, above_depth = assigned[v], assigned[max(v - 1, 0)], depth[v], depth[max(v - 1, 0)]
        for u in range(columns):
            pixel = v * columns + u
            if row[u] < 0:
                parent[pixel] = -1
                continue
            parent[pixel] = root = pixel
            z, proposal = row_depth[u], row[u]
            limit = jump_m + JUMP_SIGMAS * noise * z * z
            for k in range(4):
                uu = u + k - 1 if k < 3 else u - 1
                if uu < 0 or uu >= columns or (v == 0 and k < 3):
                    continue
                neighbour = pixel - columns + k - 1 if k < 3 else pixel - 1
                # Most neighbours already belong to the same region.
                if parent[neighbour] == root:
                    continue
                if (above[uu] if k < 3 else row[uu]) == proposal and abs(
                    (above_depth[uu] if k < 3 else row_depth[uu]) - z
                ) < limit:
                    neighbour_root = find_root(parent, neighbour)
                    if root < neighbour_root:
                        parent[neighbour_root] = root
                    elif neighbour_root < root:
                        parent[root] = neighbour_root
                        root = neighbour_root
    number, flat = 0, labels.reshape(-1)
    for v in range(rows):
        for u in range(columns):
            pixel = v * columns + u
            if parent[pixel] < 0:
                labels[v, u] = 0
                continue
            root = find_root(parent, pixel)
            if root == pixel:
                number += 1
                labels[v, u] = number
            else:
                labels[v, u] = flat[root]
    return number


@kernel
def measure_regions(labels, assigned, depth, readings, sizes, read, total, owner, corners):
    """Measure regions by their runs along image rows: a sum in a register is faster than one in memory.

    Parameters
    ----------
    labels, assigned, depth
        See `judge_regions`.
    readings : (H, W) float32
        Metres, 0 for filled holes.
    sizes, read : (number + 1,) int64, output
        Number of pixels of each region, and of readings among them.
    total : (number + 1,) float64, output
        Summed depth, metres.
    owner : (number + 1,) int64, output
    corners : (number + 1, 4) int64, output
        Smallest and largest column and row of each region: left, top, right, bottom.
    """
    rows, columns = labels.shape
    sizes[:], read[:], total[:], owner[:] = 0, 0, 0.0, -1
    corners[:, 0], corners[:, 1], corners[:, 2], corners[:, 3] = columns, rows, -1, -1
    for v in range(rows):
        end = 0
        while end < columns:
            first, k = end, labels[v, end]
            measured, deep = 0, total[k]
            while end < columns and labels[v, end] == k:
                measured += readings[v, end] > 0.0
                deep += depth[v, end]
                end += 1
            if k > 0:
                sizes[k], read[k], total[k], owner[k] = (
                    sizes[k] + end - first,
                    read[k] + measured,
                    deep,
                    assigned[v, first],
                )
                box = corners[k]
                box[0], box[1], box[2], box[3] = min(box[0], first), min(box[1], v), max(box[2], end - 1), v


@kernel
def judge_regions(labels, assigned, depth, readings, min_readings, focal, major, deep, become, sizes, owner):
    """Decide which regions are joined and which are dropped.

    Regions of a proposal are joined with its largest one if they are nearly as large and at a similar depth.

    Parameters
    ----------
    labels : (H, W) int32
        From `label_regions`.
    assigned : (H, W) int32
    depth : (H, W) float32
    readings : (H, W) float32
        Metres, 0 for filled holes.
    min_readings : int
        Smallest number of readings of a region; smaller ones are dropped.
    focal : float
        Pixels.
    major : float
        Smallest size of a region that is joined, as a fraction of the size of the largest one.
    deep : float
        Largest difference of the mean depths, as a fraction of the length of the largest one.
    become : (number + 1,) int32, output
        The region into which each is merged (or itself), 0: dropped.
    sizes : (number + 1,) int64, output
        Number of pixels of each region with its merged parts; 0 for merged or dropped regions.
    owner : (number + 1,) int64, output
        Proposal of each region.
    """
    count = become.size
    read, total, corners = np.empty(count, np.int64), np.empty(count), np.empty((count, 4), np.int64)
    measure_regions(labels, assigned, depth, readings, sizes, read, total, owner, corners)
    largest = np.zeros(owner.max() + 2, np.int64)
    for k in range(1, count):
        if sizes[k] > sizes[largest[owner[k]]]:
            largest[owner[k]] = k
    become[0] = 0
    for k in range(1, count):
        m = largest[owner[k]]
        z = total[m] / sizes[m]
        length_m = (max(corners[m, 2] - corners[m, 0], corners[m, 3] - corners[m, 1]) + 1) * z / focal
        joins = sizes[k] >= major * sizes[m] and abs(total[k] / sizes[k] - z) <= deep * length_m
        become[k] = m if joins else k
    for k in range(1, count):
        m = become[k]
        if m != k:
            sizes[m], read[m], sizes[k] = sizes[m] + sizes[k], read[m] + read[k], 0
    for k in range(1, count):
        if read[become[k]] < min_readings:
            sizes[become[k]] = 0
            become[k] = 0


@kernel
def gather_regions(
    labels, become, sizes, min_pixels, readings, heat, support, first, pixels, corners, claim, warmth, beneath
):
    """Gather the readings and properties of each region that is large enough, in the order of the region numbers.

    Parameters
    ----------
    labels : (H, W) int32
        Number of the region, from 1; 0: none.
    become, sizes
        See `judge_regions`.
    min_pixels : int
        Smallest number of pixels of a region; smaller ones are dropped.
    readings : (H, W) float32
        Metres, 0 for filled holes.
    heat : (H, W) float32
    support : (H, W) int32
        Plane beneath each pixel, -1: none.
    first : (number + 1, 2) int64, output
        Begin and end in `pixels` of the readings of each kept region.
    pixels : (H * W,) int64, output
        Indices of the readings in the flattened image, ascending within a region.
    corners : (number, 4) int64, output
        Smallest and largest column and row of each region, filled holes included: left, top, right, bottom.
    claim : (H, W) int32, output
        Index of each pixel's region among the kept ones, -1: none.
    warmth : (number,) float64, output
        Sum of the heat of all pixels of each region.
    beneath : (number, P) int64, output
        Number of pixels of each region above each plane.

    Returns
    -------
    int
        Number of kept regions.
    """
    rows, columns = labels.shape
    kept, total, place = 0, 0, np.full(sizes.size, -1, np.int32)
    for k in range(1, sizes.size):
        if sizes[k] >= min_pixels:
            place[k], first[kept, 0], first[kept, 1] = kept, total, total
            kept, total = kept + 1, total + sizes[k]
    warmth[:kept] = 0.0
    beneath[:kept] = 0
    for k in range(kept):
        corners[k, 0], corners[k, 1], corners[k, 2], corners[k, 3] = columns, rows, -1, -1
    for v in range(rows):
        end = 0
        while end < columns:
            begin, label = end, labels[v, end]
            while end < columns and labels[v, end] == label:
                end += 1
            k = place[become[label]]
            claim[v, begin:end] = k
            if k < 0:
                continue
            n, warm = first[k, 1], warmth[k]
            for u in range(begin, end):
                if readings[v, u] > 0.0:
                    pixels[n] = v * columns + u
                    n += 1
                warm += heat[v, u]
                if support[v, u] >= 0:
                    beneath[k, support[v, u]] += 1
            first[k, 1], warmth[k] = n, warm
            box = corners[k]
            box[0], box[1], box[2], box[3] = min(box[0], begin), min(box[1], v), max(box[2], end - 1), v
    return kept
