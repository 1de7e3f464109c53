"""Hot loops that merge the leaves of a picture into a tree of regions, the most similar neighbours first."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.compiling.compiled import kernel
from cuboid.method.proposals.kernels.sums import (
    COLOR,
    CONCAVE,
    CONTRAST,
    CONVEX,
    DEPTH_STEP,
    LINK_SUMS,
    LINKS,
    NORMAL,
    PIXEL_SUMS,
    PIXELS,
)

# What makes two neighbours dissimilar: color, depth, both, or a small common size (as in selective search: Uijlings et
# al., IJCV 2013).
BY_COLOR, BY_DEPTH, BY_BOTH, BY_SIZE = range(4)
# Dissimilarity grows with this power of the smaller region's size: small regions join first.
SIZE_POWER = 0.35


class Graph(NamedTuple):
    """The leaves of a picture, and the borders between neighbouring ones.

    Attributes
    ----------
    sums : (N, PIXEL_SUMS) float64
    boxes : (N, 4) int32
    ends : (B, 2) int32
        The two leaves of each border.
    borders : (B, 2, LINK_SUMS) float64
        Each border as seen from both leaves.
    """

    sums: npt.NDArray[np.float64]
    boxes: npt.NDArray[np.int32]
    ends: npt.NDArray[np.int32]
    borders: npt.NDArray[np.float64]


class Tree(NamedTuple):
    """A tree of regions: the leaves 0..N-1, then each union after its two parts.

    Attributes
    ----------
    sums : (2 N, PIXEL_SUMS) float64
    boxes : (2 N, 4) int32
    borders : (2 N, LINK_SUMS) float64
    parts : (2 N, 2) int32
        -1 for a leaf.
    parent : (2 N,) int32
        -1 for a root.
    joined : (2 N,) float64
        Dissimilarity of the two parts; 0 for a leaf.
    left : (2 N,) float64
        Dissimilarity at which it became a part; -1 for a root.
    """

    sums: npt.NDArray[np.float64]
    boxes: npt.NDArray[np.int32]
    borders: npt.NDArray[np.float64]
    parts: npt.NDArray[np.int32]
    parent: npt.NDArray[np.int32]
    joined: npt.NDArray[np.float64]
    left: npt.NDArray[np.float64]


class Work(NamedTuple):
    """Work arrays for N leaves, B borders, and a heap of H entries.

    Attributes
    ----------
    ends : (B, 2) int32
    borders : (B, 2, LINK_SUMS) float64
    alive : (B,) uint8
    version : (B,) int32
    head, mark : (2 N,) int32
    following : (2 B,) int32
        Lists of the borders of each region: entry 2 b + s is border b at its end s.
    keys : (H,) float64
    entries : (H, 2) int32
        Border and version.
    """

    ends: npt.NDArray[np.int32]
    borders: npt.NDArray[np.float64]
    alive: npt.NDArray[np.uint8]
    version: npt.NDArray[np.int32]
    head: npt.NDArray[np.int32]
    mark: npt.NDArray[np.int32]
    following: npt.NDArray[np.int32]
    keys: npt.NDArray[np.float64]
    entries: npt.NDArray[np.int32]


@kernel
def dissimilarity(tree, a, b, border, order, image_pixels):
    """Return how dissimilar two neighbouring regions are."""
    first, second = tree.sums[a, PIXELS], tree.sums[b, PIXELS]
    color, bend = 0.0, 0.0
    for k in range(3):
        color += abs(tree.sums[a, COLOR + k] / first - tree.sums[b, COLOR + k] / second)
        bend += (tree.sums[a, NORMAL + k] / first - tree.sums[b, NORMAL + k] / second) ** 2
    links = border[LINKS]
    contrast, step = border[CONTRAST] / links, border[DEPTH_STEP] / links
    crease = (border[CONCAVE] + 0.5 * border[CONVEX]) / links
    if order == BY_SIZE:
        wide = max(tree.boxes[a, 2], tree.boxes[b, 2]) - min(tree.boxes[a, 0], tree.boxes[b, 0])
        high = max(tree.boxes[a, 3], tree.boxes[b, 3]) - min(tree.boxes[a, 1], tree.boxes[b, 1])
        return color / 60.0 + wide * high / image_pixels + step / 30.0
    small = min(first, second) ** SIZE_POWER
    if order == BY_COLOR:
        return (0.7 * contrast + 0.5 * color + 2.0) * small
    if order == BY_BOTH:
        return (0.5 * contrast + 0.4 * color + 7.0 * step + 15.0 * crease + 2.0) * small
    return (8.0 * step + 20.0 * crease + 6.0 * math.sqrt(bend) + 0.1 * color + 1.0) * small


@kernel(inline="always")
def push(work, size, key, border, version):
    """Add an entry to the heap of `size` entries; the smallest key is first."""
    i = size
    while i > 0:
        above = (i - 1) >> 1
        if work.keys[above] <= key:
            break
        work.keys[i] = work.keys[above]
        work.entries[i, 0], work.entries[i, 1] = work.entries[above, 0], work.entries[above, 1]
        i = above
    work.keys[i], work.entries[i, 0], work.entries[i, 1] = key, border, version


@kernel(inline="always")
def drop_first(work, size):
    """Remove the first entry from the heap; `size` entries are left."""
    key, border, version = work.keys[size], work.entries[size, 0], work.entries[size, 1]
    i = 0
    while 2 * i + 1 < size:
        below = 2 * i + 1
        if below + 1 < size and work.keys[below + 1] < work.keys[below]:
            below += 1
        if work.keys[below] >= key:
            break
        work.keys[i] = work.keys[below]
        work.entries[i, 0], work.entries[i, 1] = work.entries[below, 0], work.entries[below, 1]
        i = below
    work.keys[i], work.entries[i, 0], work.entries[i, 1] = key, border, version


@kernel
def begin(graph, order, image_pixels, tree, work):
    """Copy the leaves and their borders; return the number of entries of the heap."""
    n = len(graph.sums)
    for i in range(2 * n):
        work.head[i], work.mark[i] = -1, -1
        tree.parts[i, 0], tree.parts[i, 1], tree.parent[i] = -1, -1, -1
        tree.joined[i], tree.left[i] = 0.0, -1.0
    for i in range(n):
        for k in range(PIXEL_SUMS):
            tree.sums[i, k] = graph.sums[i, k]
        for k in range(4):
            tree.boxes[i, k] = graph.boxes[i, k]
        for k in range(LINK_SUMS):
            tree.borders[i, k] = 0.0
    for b in range(len(graph.ends)):
        work.alive[b], work.version[b] = 1, 0
        for s in range(2):
            i = graph.ends[b, s]
            work.ends[b, s], work.following[2 * b + s], work.head[i] = i, work.head[i], 2 * b + s
            for k in range(LINK_SUMS):
                work.borders[b, s, k] = graph.borders[b, s, k]
                tree.borders[i, k] += graph.borders[b, s, k]
        key = dissimilarity(tree, graph.ends[b, 0], graph.ends[b, 1], work.borders[b, 0], order, image_pixels)
        push(work, b, key, b, 0)
    return len(graph.ends)


@kernel
def merge(graph, order, image_pixels, max_pixels, tree, work):
    """Merge neighbouring regions one by one, the least dissimilar ones first.

    Parameters
    ----------
    graph : Graph
    order : int
        BY_COLOR, BY_DEPTH, BY_BOTH or BY_SIZE.
    image_pixels : float
    max_pixels : float
        Larger unions are not made.
    tree : Tree, output
    work : Work

    Returns
    -------
    int
        Number of regions.
    """
    size, new = begin(graph, order, image_pixels, tree, work), len(graph.sums)
    while size > 0:
        key, border, version = work.keys[0], work.entries[0, 0], work.entries[0, 1]
        size -= 1
        drop_first(work, size)
        if not work.alive[border] or work.version[border] != version:
            continue
        work.alive[border] = 0
        a, b = work.ends[border, 0], work.ends[border, 1]
        if tree.sums[a, PIXELS] + tree.sums[b, PIXELS] > max_pixels:
            continue
        unite(tree, a, b, work.borders[border], key, new)
        relink(work, a, b, new)
        at = work.head[new]
        while at >= 0:
            other, s = at >> 1, at & 1
            work.mark[work.ends[other, 1 - s]] = -1
            if size < len(work.keys):
                work.version[other] += 1
                ends = work.ends[other]
                key = dissimilarity(tree, ends[0], ends[1], work.borders[other, 0], order, image_pixels)
                push(work, size, key, other, work.version[other])
                size += 1
            at = work.following[at]
        new += 1
    return new


@kernel
def unite(tree, a, b, border, key, new):
    """Make a region of two parts with a common border."""
    for k in range(PIXEL_SUMS):
        tree.sums[new, k] = tree.sums[a, k] + tree.sums[b, k]
    for k in range(LINK_SUMS):
        tree.borders[new, k] = tree.borders[a, k] + tree.borders[b, k] - border[0, k] - border[1, k]
    for k in range(2):
        tree.boxes[new, k] = min(tree.boxes[a, k], tree.boxes[b, k])
        tree.boxes[new, k + 2] = max(tree.boxes[a, k + 2], tree.boxes[b, k + 2])
    tree.parts[new, 0], tree.parts[new, 1], tree.joined[new] = a, b, key
    tree.parent[a] = tree.parent[b] = new
    tree.left[a] = tree.left[b] = key


@kernel
def relink(work, a, b, new):
    """Give the borders of two regions to their union; two borders with the same neighbour become one."""
    last = -1
    for part in (a, b):
        at = work.head[part]
        while at >= 0:
            following, border, s = work.following[at], at >> 1, at & 1
            if work.alive[border]:
                neighbour = work.ends[border, 1 - s]
                same = work.mark[neighbour]
                if same < 0:
                    work.mark[neighbour] = at
                    work.ends[border, s] = new
                    work.following[at] = last
                    last = at
                else:
                    for k in range(LINK_SUMS):
                        work.borders[same >> 1, same & 1, k] += work.borders[border, s, k]
                        work.borders[same >> 1, 1 - (same & 1), k] += work.borders[border, 1 - s, k]
                    work.alive[border] = 0
            at = following
    work.head[new] = last
