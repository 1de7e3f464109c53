"""The fitted score of regions for the segments of a frame: how likely each shows one whole thing."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.working import WorkingImage
from cuboid.method.proposals.forest import fitted_forest
from cuboid.method.proposals.kernels import forest, hierarchy, quantities, sums
from cuboid.method.proposals.kernels.quantities import QUANTITIES
from cuboid.method.proposals.region_maps import ReducedFrame, graph_of
from cuboid.method.proposals.regions import MIN_CANDIDATE_PIXELS, MIN_SIDE, SURFACE_TREE, surface_masks
from cuboid.method.proposals.types import JoinedMasks, Proposals

# Narrower pictures have no scores, pixels: the score is fitted to pictures of 320 pixels, and much coarser ones show
# things in another way.
MIN_SCORED_WIDTH_PX = 240
# All trees count, also for improbable segments.
NO_STAGES = np.zeros(0, np.float32)


def segment_log_odds(
    reduced: ReducedFrame, image: WorkingImage, claim: npt.NDArray[np.int32], count: int, surfaces: Proposals
) -> Float64Array:
    """Return the log-odds (count,) that each segment shows one whole thing; NaN: it cannot be judged.

    Segments that are too small for candidates of `regions`, and those of pictures narrower than
    `MIN_SCORED_WIDTH_PX`, cannot be judged: the score is not fitted to such ones.

    Parameters
    ----------
    reduced : ReducedFrame
    image : WorkingImage
        The working image of the frame.
    claim : (h, w) int32
        Segment of each working pixel, 0..count-1, -1: none.
    count : int
    surfaces : Proposals
        The proposals of the frame: their masks are compared with the segments, if they are those from depth.
    """
    if max(reduced.intrinsics.width, reduced.intrinsics.height) < MIN_SCORED_WIDTH_PX:
        return np.full(count, np.nan)
    labels, pinhole = _on_grid(claim, image, reduced.shape, reduced.step) + np.int32(1), reduced.pinhole
    graph = graph_of(labels, count + 1, reduced.maps, pinhole)
    borders = np.zeros((count + 1, sums.LINK_SUMS))
    for end in range(2):
        np.add.at(borders, graph.ends[:, end], graph.borders[:, end])
    alone, root, left = (
        np.full((count + 1, 2), -1, np.int32),
        np.full(count + 1, -1, np.int32),
        np.full(count + 1, -1.0),
    )
    tree = hierarchy.Tree(graph.sums, graph.boxes, borders, alone, root, np.zeros(count + 1), left)
    found, usable = np.zeros((count + 1, len(QUANTITIES)), np.float32), np.empty(count + 1, np.uint8)
    if isinstance(surfaces.masks, JoinedMasks) and surfaces.mask_step == reduced.step:
        masks, scores = surface_masks(surfaces)
        counts = np.zeros((count + 1, len(scores)), np.float32)
        quantities.count_leaves(*masks, labels, counts)
        usable[:] = 1
        sizes = masks.sizes.astype(np.float32)
        quantities.compare_surfaces(tree, count + 1, count + 1, sizes, scores, usable, counts, found)
        # Among the surfaces of the depth image, its score stands for how a region came about.
        tree.joined[:] = found[:, -1]
    limits = MIN_SIDE, MIN_CANDIDATE_PIXELS, float(labels.size)
    quantities.quantities(tree, count + 1, SURFACE_TREE, pinhole, labels.shape, limits, found, usable)
    log_odds = np.empty(count + 1)
    forest.log_odds(found, usable, fitted_forest(), NO_STAGES, log_odds)
    log_odds[usable == 0] = np.nan
    return log_odds[1:]


def _on_grid(
    claim: npt.NDArray[np.int32], image: WorkingImage, shape: tuple[int, ...], step: int
) -> npt.NDArray[np.int32]:
    """Return the segment of each pixel of another grid (h, w): its pixels are blocks of `step` frame pixels."""
    nearest = []
    for axis, phase in ((0, image.phase[1]), (1, image.phase[0])):
        middle = (np.arange(shape[axis]) + 0.5) * step - 0.5
        index = np.rint((middle - phase) / image.step).astype(np.int64)
        nearest.append(np.clip(index, 0, claim.shape[axis] - 1))
    return claim[np.ix_(*nearest)]
