"""Hot loops over the pieces of a frame's shares: parted where depth jumps, joined where they are one, gathered."""

from __future__ import annotations

import numpy as np
from numba import njit

from cuboid.tolerances import JUMP_SIGMAS


@njit(cache=True, nogil=True, inline="always")
def find_root(parent, a):
    """Return the root of a in a union-find forest, halving the path."""
    while parent[a] != a:
        parent[a] = parent[parent[a]]
        a = parent[a]
    return a


@njit(cache=True, nogil=True)
def label_regions(depth, share, noise, jump, parent, labels):
    """Number the 8-connected regions of pixels of one share whose depth is continuous.

    Neighbours belong together when their depths differ by less than `jump` (metres) plus the noise of two readings.

    Parameters
    ----------
    depth : (H, W) float32
    share : (H, W) int32
        What each pixel belongs to, -1 nothing.
    noise, jump : float
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
        own, above, near, far = share[v], share[max(v - 1, 0)], depth[v], depth[max(v - 1, 0)]
        for u in range(columns):
            here = v * columns + u
            if own[u] < 0:
                parent[here] = -1
                continue
            parent[here] = root = here
            z, mine = near[u], own[u]
            limit = jump + JUMP_SIGMAS * noise * z * z
            for k in range(4):
                uu = u + k - 1 if k < 3 else u - 1
                if uu < 0 or uu >= columns or (v == 0 and k < 3):
                    continue
                if (above[uu] if k < 3 else own[uu]) == mine and abs((far[uu] if k < 3 else near[uu]) - z) < limit:
                    there = here - columns + k - 1 if k < 3 else here - 1
                    # Most neighbours are of one region by now.
                    if parent[there] == root:
                        continue
                    other = find_root(parent, there)
                    if root < other:
                        parent[other] = root
                    elif other < root:
                        parent[root] = other
                        root = other
    number, flat = 0, labels.reshape(-1)
    for v in range(rows):
        for u in range(columns):
            here = v * columns + u
            if parent[here] < 0:
                labels[v, u] = 0
                continue
            root = find_root(parent, here)
            if root == here:
                number += 1
                labels[v, u] = number
            else:
                labels[v, u] = flat[root]
    return number


@njit(cache=True, nogil=True)
def join_surfaces(labels, number, share, depth, focal, major, deep):
    """Make one region of the largest surface of each share and of those that are about as large and as near.

    Parameters
    ----------
    labels : (H, W) int32, in and out
        From `label_regions`; those that join one have its number afterwards.
    number : int
        Of regions.
    share : (H, W) int32
    depth : (H, W) float32
    focal : float
        Pixels.
    major : float
        Least size of one that joins, as a share of the largest one's.
    deep : float
        Largest difference of their mean depths, as a share of the largest one's length.
    """
    rows, columns = labels.shape
    size, total, owner = np.zeros(number + 1), np.zeros(number + 1), np.full(number + 1, -1, np.int64)
    corners = np.empty((number + 1, 4), np.int64)
    corners[:, 0], corners[:, 1], corners[:, 2], corners[:, 3] = columns, rows, -1, -1
    for v in range(rows):
        for u in range(columns):
            k = labels[v, u]
            if k > 0:
                owner[k] = share[v, u]
                size[k] += 1
                total[k] += depth[v, u]
                box = corners[k]
                box[0], box[1], box[2], box[3] = min(box[0], u), min(box[1], v), max(box[2], u), max(box[3], v)
    largest = np.zeros(owner.max() + 2, np.int64)
    for k in range(1, number + 1):
        if size[k] > size[largest[owner[k]]]:
            largest[owner[k]] = k
    become = np.arange(number + 1)
    for k in range(1, number + 1):
        m = largest[owner[k]]
        z = total[m] / size[m]
        length_m = (max(corners[m, 2] - corners[m, 0], corners[m, 3] - corners[m, 1]) + 1) * z / focal
        if size[k] >= major * size[m] and abs(total[k] / size[k] - z) <= deep * length_m:
            become[k] = m
    for v in range(rows):
        for u in range(columns):
            labels[v, u] = become[labels[v, u]]


@njit(cache=True, nogil=True)
def drop_unread(labels, readings, least, sizes):
    """Clear the regions with too few readings, and count the pixels of all.

    Parameters
    ----------
    labels : (H, W) int32, in and out
        Number of the region, from 1; 0 none.
    readings : (H, W) float32
        Metres, 0 where a hole was filled.
    least : int
        A region of fewer readings is none.
    sizes : (number + 1,) int64, output
        Pixels of each region, 0 of those that are cleared.
    """
    read = np.zeros(sizes.size, np.int64)
    sizes[:] = 0
    # What belongs to one region comes in runs: a sum in hand is faster than one in memory.
    last, run, known = 0, 0, 0
    for v in range(labels.shape[0]):
        for u in range(labels.shape[1]):
            if labels[v, u] != last:
                sizes[last] += run
                read[last] += known
                last, run, known = labels[v, u], 0, 0
            run += 1
            known += readings[v, u] > 0.0
    sizes[last] += run
    read[last] += known
    few = np.zeros(sizes.size, np.bool_)
    for k in range(1, sizes.size):
        few[k] = sizes[k] > 0 and read[k] < least
    if few.any():
        for v in range(labels.shape[0]):
            for u in range(labels.shape[1]):
                labels[v, u] = 0 if few[labels[v, u]] else labels[v, u]
    sizes[few] = 0


@njit(cache=True, nogil=True)
def gather_regions(labels, number, least, depth, camera, T_world_camera, first, pixels, points, corners, claim):
    """Gather the pixels of each region that is not too small, in the order of their numbers.

    Parameters
    ----------
    labels : (H, W) int32
        Number of the region, from 1; 0 none.
    number : int
        How many regions there are.
    least : int
        A region of fewer pixels is left out.
    depth : (H, W) float32
    camera : (4,) float64
        fx, fy, cx, cy.
    T_world_camera : (4, 4) float64
    first : (number + 1,) int64, output
        Where the pixels of each region that is kept begin, and the end of the last one's.
    pixels : (H * W,) int64, output
        Their places in the flattened image, ascending within a region.
    points : (H * W, 3) float64, output
        In the world, metres.
    corners : (number, 4) int64, output
        The least and the largest column and row of each: left, top, right, bottom.
    claim : (H, W) int32, output
        Place of each pixel's region among those kept, -1 where it is left out, and of 0.

    Returns
    -------
    int
        How many regions are kept.
    """
    rows, columns = labels.shape
    size, place = np.zeros(number + 1, np.int64), np.full(number + 1, -1, np.int32)
    for v in range(rows):
        for u in range(columns):
            size[labels[v, u]] += 1
    kept, total = 0, 0
    for k in range(1, number + 1):
        if size[k] >= least:
            place[k], first[kept] = kept, total
            kept, total = kept + 1, total + size[k]
    first[kept] = total
    filled = first[:kept].copy()
    for k in range(kept):
        corners[k, 0], corners[k, 1], corners[k, 2], corners[k, 3] = columns, rows, -1, -1
    # Local copies: what is written below could lie in these arrays, for all the compiler knows.
    xx, xy, xz, x0 = T_world_camera[0]
    yx, yy, yz, y0 = T_world_camera[1]
    zx, zy, zz, z0 = T_world_camera[2]
    across = (np.arange(columns) - camera[2]) / camera[0]
    for v in range(rows):
        down = (v - camera[3]) / camera[1]
        for u in range(columns):
            k = place[labels[v, u]]
            claim[v, u] = k
            if k < 0:
                continue
            i = filled[k]
            filled[k] += 1
            pixels[i] = v * columns + u
            z = np.float64(depth[v, u])
            x, y = across[u] * z, down * z
            point = points[i]
            point[0], point[1], point[2] = (
                xx * x + xy * y + xz * z + x0,
                yx * x + yy * y + yz * z + y0,
                zx * x + zy * y + zz * z + z0,
            )
            box = corners[k]
            box[0], box[1], box[2], box[3] = min(box[0], u), min(box[1], v), max(box[2], u), max(box[3], v)
    return kept


@njit(cache=True, nogil=True)
def sum_regions(first, pixels, heat, support, warmth, beneath):
    """Sum up what the pixels of each region are like.

    Parameters
    ----------
    first : (kept + 1,) int64
        Where the pixels of each region begin; see `gather_regions`.
    pixels : (N,) int64
    heat : (H, W) float32
    support : (H, W) int32
        Plane beneath each pixel, -1 none.
    warmth : (kept,) float64, output
        Summed heat.
    beneath : (kept, P) int64, output
        Pixels above each plane.
    """
    warmth[:] = 0.0
    beneath[:] = 0
    heats, planes = heat.ravel(), support.ravel()
    for k in range(first.size - 1):
        for i in range(first[k], first[k + 1]):
            warmth[k] += heats[pixels[i]]
            p = planes[pixels[i]]
            if p >= 0:
                beneath[k, p] += 1


@njit(cache=True, nogil=True)
def drop_filled(first, pixels, points, readings, own):
    """Move the readings of each region to the front of all its pixels; what was filled goes.

    Parameters
    ----------
    first : (kept + 1,) int64
        Where the pixels of each region begin; see `gather_regions`.
    pixels : (N,) int64, in and out
    points : (N, 3) float64, in and out
    readings : (H, W) float32
        Metres, 0 where a hole was filled.
    own : (kept,) int64, output
        Where the readings of each region end.
    """
    depth = readings.ravel()
    for k in range(own.size):
        n = first[k]
        for i in range(first[k], first[k + 1]):
            if depth[pixels[i]] > 0.0:
                pixels[n] = pixels[i]
                points[n, 0], points[n, 1], points[n, 2] = points[i, 0], points[i, 1], points[i, 2]
                n += 1
        own[k] = n
