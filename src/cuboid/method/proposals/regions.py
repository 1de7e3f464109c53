"""Proposals from color and depth: a learned choice among the regions of several trees.

A picture is divided twice into leaves, mainly by color and mainly by depth, and the leaves of each division are merged
in several orders. The regions of these trees, and the surfaces that `depth` finds, are candidates. Boosted trees give
each the log-odds that it is one whole thing (`benchmarks/fit_regions.py` fits them), and disjoint candidates with the
largest sum of log-odds are chosen. So one score decides what is one thing and what is two.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.proposals.depth import WIDEST, DepthSegmentation
from cuboid.method.proposals.forest import Forest, fitted_forest
from cuboid.method.proposals.kernels import choice, forest, hierarchy, leaves, quantities, sums
from cuboid.method.proposals.kernels.quantities import QUANTITIES
from cuboid.method.proposals.region_maps import Int32Array, Maps, ReducedFrame, empty_sums, graph_of
from cuboid.method.proposals.registry import SOURCES
from cuboid.method.proposals.types import JoinedMasks, Proposals, ProposalSource

Int64Array = npt.NDArray[np.int64]


class Division(NamedTuple):
    """How a picture is divided into leaves, and in which orders they merge.

    Attributes
    ----------
    color, depth : float
        Weights of differences in color and in depth.
    orders : tuple of int
    """

    color: float
    depth: float
    orders: tuple[int, ...]


# Two divisions with five trees contain .96 of the true things of fourteen places; one division with five trees
# .94, three divisions with six .97 in half as much time again (benchmarks/region_recall.py).
DIVISIONS = (
    Division(1.0, 0.25, (hierarchy.BY_COLOR, hierarchy.BY_SIZE)),
    Division(0.25, 1.0, (hierarchy.BY_DEPTH, hierarchy.BY_BOTH, hierarchy.BY_SIZE)),
)
# Tolerance of the leaves, color units times pixels, and their smallest size, pixels of the reduced picture.
LEAF_TOLERANCE, LEAF_PIXELS = 40.0, 12
# Candidates have sides and pixels of at least this, pixels of the reduced picture, and at most this fraction of it.
MIN_SIDE, MIN_CANDIDATE_PIXELS, MAX_FRACTION = 6.0, 45.0, 0.4
# Unions with more of the picture are not made.
MAX_UNION = 0.45
# Log-odds above which a candidate may be chosen. It is below 0: the map adds up the evidence of many frames.
MIN_LOG_ODDS = -0.5
# Largest number of candidates among which regions are chosen, the most probable ones.
CONTENDERS = 150
# Two chosen regions share at most this fraction of the smaller one.
MAX_COMMON = 0.3
# Rounds of exchanges; three are enough in almost all pictures.
EXCHANGE_ROUNDS = 10
# Entries of the heap of mergers, per border.
HEAP_PER_BORDER = 40
# The number that stands for the tree of a candidate that is a surface of the depth image.
SURFACE_TREE = 10.0


class Masks(NamedTuple):
    """Masks of the reduced picture, one after the other: see `kernels.sums.mask_sums`."""

    rectangles: Int64Array
    starts: Int64Array
    flat: UInt8Array

    @property
    def sizes(self) -> Int64Array:
        """Pixels of each mask (M,)."""
        ends = np.append(self.starts[1:], len(self.flat))[: len(self.starts)]
        return np.array([np.count_nonzero(self.flat[a:b]) for a, b in zip(self.starts, ends, strict=True)], np.int64)


@dataclass(frozen=True, slots=True)
class RegionTree:
    """The regions of one tree, with their quantities.

    Attributes
    ----------
    labels : (h, w) int32
        Leaf of each pixel.
    tree : Tree
    count, leaves : int
        Number of regions, and of leaves.
    found : (count, Q) float32
    usable : (count,) uint8
    """

    labels: Int32Array
    tree: hierarchy.Tree
    count: int
    leaves: int
    found: Float32Array
    usable: UInt8Array

    def masks(self, regions: Int64Array) -> Masks:
        """Return the masks of some regions (M,)."""
        place, spans = np.empty(self.leaves, np.int32), np.empty((self.count, 2), np.int32)
        choice.order_leaves(self.tree.parts, self.tree.parent, self.count, self.leaves, place, spans)
        rectangles = self.tree.boxes[regions].astype(np.int64)
        starts, length = _starts(rectangles)
        flat = np.empty(length, np.uint8)
        choice.cut_regions(self.labels, place, spans[regions], rectangles, starts, flat)
        return Masks(rectangles, starts, flat)


@dataclass(frozen=True, slots=True)
class Surfaces:
    """The surfaces of the depth image as candidates.

    Attributes
    ----------
    masks : Masks
    found : (M, Q) float32
    usable : (M,) uint8
    """

    masks: Masks
    found: Float32Array
    usable: UInt8Array


class RegionSource:
    """Proposes disjoint regions of color and depth, each with the probability that it is one whole thing.

    Parameters
    ----------
    config : TrackerConfig
        Sizes of objects; range and noise of the sensor.
    model : Forest, optional
        By default the fitted one.
    """

    def __init__(self, config: TrackerConfig, model: Forest | None = None) -> None:
        self._surfaces = DepthSegmentation(WIDEST, config)
        self._model = fitted_forest() if model is None else model

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Proposals:
        """Return the chosen regions of `frame`; their scores are probabilities. See `candidates`."""
        return self.choose(ReducedFrame(frame, intrinsics))

    def choose(self, reduced: ReducedFrame, by_depth: Proposals | None = None) -> Proposals:
        """Return the chosen regions of a frame; their scores are probabilities. See `candidates`."""
        trees, surfaces = self.candidates(reduced, by_depth)
        judged: list[RegionTree | Surfaces] = [*trees, surfaces]
        log_odds = [_log_odds(each.found, each.usable, self._model) for each in judged]
        masks, gains, first = _contenders(trees, surfaces, log_odds)
        conflict, chosen = np.empty((len(gains), len(gains)), np.uint8), first.copy()
        choice.overlaps(*masks, masks.sizes, MAX_COMMON, conflict)
        choice.exchange(gains, conflict, EXCHANGE_ROUNDS, chosen)
        return _as_proposals(masks, gains + MIN_LOG_ODDS, np.flatnonzero(chosen), reduced.step)

    def candidates(self, reduced: ReducedFrame, by_depth: Proposals | None = None) -> tuple[list[RegionTree], Surfaces]:
        """Return the candidates of a frame with their quantities.

        Parameters
        ----------
        reduced : ReducedFrame
        by_depth : Proposals, optional
            The proposals of the source `depth` for this frame, if they are known.
        """
        maps, camera = reduced.maps, reduced.pinhole
        if by_depth is None or by_depth.mask_step != reduced.step or not isinstance(by_depth.masks, JoinedMasks):
            by_depth = self._surfaces(reduced.frame, reduced.intrinsics)
        masks, scores = surface_masks(by_depth)
        trees: list[RegionTree] = []
        for division in DIVISIONS:
            labels, graph = _divide(maps, camera, division)
            counts = np.zeros((len(graph.sums), len(scores)), np.float32)
            quantities.count_leaves(*masks, labels, counts)
            sizes = masks.sizes.astype(np.float32)
            for order in division.orders:
                tree = _merged(labels, graph, order, len(trees), camera)
                in_surfaces = np.zeros((tree.count, len(scores)), np.float32)
                in_surfaces[: tree.leaves] = counts
                quantities.compare_surfaces(
                    tree.tree, tree.count, tree.leaves, sizes, scores, tree.usable, in_surfaces, tree.found
                )
                trees.append(tree)
        return trees, _judged_surfaces(masks, scores, maps, camera)


def _divide(maps: Maps, camera: Float64Array, division: Division) -> tuple[Int32Array, hierarchy.Graph]:
    """Divide a picture into leaves; return the leaf of each pixel (h, w), and their graph."""
    shape, pixels = maps.depth_m.shape, maps.depth_m.size
    right, down, labels = (np.zeros(shape, np.int32) for _ in range(3))
    leaves.link_weights(maps.lab, maps.depth_m, maps.normals, division.color, division.depth, right, down)
    parent, size, order = np.empty(pixels, np.int32), np.empty(pixels, np.int32), np.empty(2 * pixels, np.int32)
    limit, starts = np.empty(pixels, np.float32), np.empty(leaves.MAX_WEIGHT + 2, np.int32)
    work = parent, size, limit, order, starts
    count = leaves.join_pixels(right, down, LEAF_TOLERANCE, LEAF_PIXELS, *work, labels)
    return labels, graph_of(labels, count, maps, camera)


def room_to_merge(n: int, b: int) -> tuple[hierarchy.Tree, hierarchy.Work]:
    """Return the arrays for a tree of n leaves with b borders, and for the work of merging them."""
    tree = hierarchy.Tree(
        np.empty((2 * n, sums.PIXEL_SUMS)),
        np.empty((2 * n, 4), np.int32),
        np.empty((2 * n, sums.LINK_SUMS)),
        np.empty((2 * n, 2), np.int32),
        np.empty(2 * n, np.int32),
        np.empty(2 * n),
        np.empty(2 * n),
    )
    work = hierarchy.Work(
        np.empty((b, 2), np.int32),
        np.empty((b, 2, sums.LINK_SUMS)),
        np.empty(b, np.uint8),
        np.empty(b, np.int32),
        np.empty(2 * n, np.int32),
        np.empty(2 * n, np.int32),
        np.empty(2 * b, np.int32),
        np.empty(HEAP_PER_BORDER * b),
        np.empty((HEAP_PER_BORDER * b, 2), np.int32),
    )
    return tree, work


def _merged(labels: Int32Array, graph: hierarchy.Graph, order: int, number: int, camera: Float64Array) -> RegionTree:
    """Merge leaves in one order, and compute the quantities of all regions of the tree."""
    n, b, pixels = len(graph.sums), len(graph.ends), labels.size
    tree, work = room_to_merge(n, b)
    count = hierarchy.merge(graph, order, float(pixels), MAX_UNION * pixels, tree, work)
    found, usable = np.zeros((count, len(QUANTITIES)), np.float32), np.empty(count, np.uint8)
    limits = MIN_SIDE, MIN_CANDIDATE_PIXELS, MAX_FRACTION * pixels
    quantities.quantities(tree, count, number, camera, labels.shape, limits, found, usable)
    return RegionTree(labels, tree, count, n, found, usable)


def surface_masks(proposals: Proposals) -> tuple[Masks, Float32Array]:
    """Return the masks of the proposals from depth, and their scores (M,)."""
    rectangles = proposals.boxes_xyxy.astype(np.int64) // proposals.mask_step
    starts, _ = _starts(rectangles)
    masks = proposals.masks
    assert isinstance(masks, JoinedMasks)
    return Masks(rectangles, starts, np.asarray(masks.flat, np.uint8)), proposals.scores.astype(np.float32)


def _starts(rectangles: Int64Array) -> tuple[Int64Array, int]:
    """Return the begin of each mask in their flat array, (M,), and the length of the array."""
    ends = np.cumsum((rectangles[:, 2:] - rectangles[:, :2]).prod(1))
    return np.concatenate([[0], ends[:-1]]).astype(np.int64)[: len(rectangles)], int(ends[-1]) if len(ends) else 0


def _judged_surfaces(masks: Masks, scores: Float32Array, maps: Maps, camera: Float64Array) -> Surfaces:
    """Return the surfaces of the depth image with their quantities: as the leaves of a tree of their own."""
    count, pixels = len(scores), maps.depth_m.size
    over, boxes = empty_sums(count, maps.depth_m.shape)
    over_borders, alone = np.zeros((count, sums.LINK_SUMS)), np.full((count, 2), -1, np.int32)
    sums.mask_sums(*masks, maps, camera, over, over_borders, boxes)
    root, joined, left = np.full(count, -1, np.int32), scores.astype(np.float64), np.full(count, -1.0)
    tree = hierarchy.Tree(over, boxes, over_borders, alone, root, joined, left)
    found, usable = np.zeros((count, len(QUANTITIES)), np.float32), np.empty(count, np.uint8)
    limits = MIN_SIDE, MIN_CANDIDATE_PIXELS, MAX_FRACTION * pixels
    quantities.quantities(tree, count, SURFACE_TREE, camera, maps.depth_m.shape, limits, found, usable)
    found[:, -2], found[:, -1] = 1.0, scores
    return Surfaces(masks, found, usable)


def _log_odds(found: Float32Array, usable: UInt8Array, model: Forest) -> Float64Array:
    out = np.empty(len(found))
    forest.log_odds(found, usable, model, model.least, out)
    return out


def _contenders(
    trees: list[RegionTree], surfaces: Surfaces, log_odds: list[Float64Array]
) -> tuple[Masks, Float64Array, UInt8Array]:
    """Return the masks and gains of the most probable candidates, descending, and the best choice of one tree.

    The gain of a candidate is its log-odds less MIN_LOG_ODDS. The first choice is that of the tree with the largest sum
    of gains.
    """
    parts = list(_candidates_of(trees, surfaces, log_odds))
    gains = np.concatenate([part[1] for part in parts])
    tree_of = np.concatenate([np.full(len(part[1]), k) for k, part in enumerate(parts)])
    best = max(range(len(parts)), key=lambda k: parts[k][3])
    first = np.concatenate([part[2] for part in parts])
    first[tree_of != best] = 0
    order = np.argsort(-gains, kind="stable")[:CONTENDERS]
    rectangles = np.concatenate([part[0].rectangles for part in parts])[order]
    pieces = [part[0].flat[a : a + n] for part in parts for a, n in _spans(part[0])]
    starts, _ = _starts(rectangles)
    flat = np.concatenate([pieces[k] for k in order.tolist()]) if len(order) else np.zeros(0, np.uint8)
    return Masks(rectangles, starts, flat), gains[order], first[order]


def _spans(masks: Masks) -> Iterator[tuple[int, int]]:
    """Iterate over the begin and the length of each mask."""
    lengths = (masks.rectangles[:, 2:] - masks.rectangles[:, :2]).prod(1)
    return zip(masks.starts.tolist(), lengths.tolist(), strict=True)


def _candidates_of(
    trees: list[RegionTree], surfaces: Surfaces, log_odds: list[Float64Array]
) -> Iterator[tuple[Masks, Float64Array, UInt8Array, float]]:
    """Iterate over the trees: masks of the candidates, their gains, which of them are chosen, and the sum of these."""
    for tree, odds in zip(trees, log_odds[:-1], strict=True):
        gains, best, chosen = odds - MIN_LOG_ODDS, np.empty(tree.count), np.empty(tree.count, np.uint8)
        total = choice.best_in_tree(tree.tree.parts, tree.count, gains, best, chosen)
        regions = np.flatnonzero(gains > 0.0)
        yield tree.masks(regions), gains[regions], chosen[regions], total
    gains = log_odds[-1] - MIN_LOG_ODDS
    kept = np.flatnonzero(gains > 0.0)
    rectangles, spans = surfaces.masks.rectangles[kept], list(_spans(surfaces.masks))
    pieces = [surfaces.masks.flat[a : a + n] for a, n in (spans[k] for k in kept.tolist())]
    flat = np.concatenate(pieces) if pieces else np.zeros(0, np.uint8)
    yield Masks(rectangles, _starts(rectangles)[0], flat), gains[kept], np.zeros(len(kept), np.uint8), 0.0


def _as_proposals(masks: Masks, log_odds: Float64Array, chosen: Int64Array, step: int) -> Proposals:
    spans = list(_spans(masks))
    pieces = [masks.flat[a : a + n] for a, n in (spans[k] for k in chosen.tolist())]
    rectangles = masks.rectangles[chosen].astype(np.int32)
    sizes = (rectangles[:, 2:] - rectangles[:, :2]).tolist()
    flat = np.concatenate(pieces) if pieces else np.zeros(0, np.uint8)
    probability = (1.0 / (1.0 + np.exp(-log_odds[chosen]))).astype(np.float32)
    return Proposals(np.ascontiguousarray(rectangles * step), probability, JoinedMasks(flat, sizes), step)


@SOURCES.register("regions")
def region_source(options: str | None, config: TrackerConfig) -> ProposalSource:
    """Return the source of regions.

    Raises
    ------
    InputError
        If there are options.
    """
    if options is not None:
        raise InputError(f"proposal source 'regions' takes no options, got '{options}'")
    return RegionSource(config)
