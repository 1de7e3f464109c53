"""The 2D heat of a frame: the weighted vote of its proposals, corrected by depth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.working import WorkingImage
from cuboid.method.heatmap.kernels import votes as kernel
from cuboid.method.heatmap.kernels.claims import proposal_overlaps
from cuboid.method.proposals.types import JoinedMasks, Proposals

# Lower limit of the mean weight to which votes are compared: weak proposals alone make no heat.
MIN_STRENGTH = 0.1
# Number of strongest proposals whose mean weight is the unit of votes.
STRONGEST = 10


class WeighedProposals(NamedTuple):
    """The proposals of a frame with weights from depth.

    Attributes
    ----------
    rectangles : (N, 4) int64
        The rectangle of working pixels in each box, end exclusive.
    starts : (N + 1,) int64
        Begin of each rectangle in the flat array of all rectangles, row by row.
    covered : (L,) uint8
        For each pixel of the flat array, 1 for a candidate that the proposal covers.
    weights : (N,) float32
        Weight, 0..1; 0 if the proposal shows no object.
    """

    rectangles: npt.NDArray[np.int64]
    starts: npt.NDArray[np.int64]
    covered: UInt8Array
    weights: Float32Array


def weigh(image: WorkingImage, candidate: UInt8Array, proposals: Proposals, config: TrackerConfig) -> WeighedProposals:
    """Weigh a frame's proposals by their depth readings.

    Parameters
    ----------
    image : WorkingImage
    candidate : (h, w) uint8
        1 where a reading may belong to an object: off every supporting plane.
    proposals : Proposals
        In pixels of the full image. A box without a mask covers all its pixels.
    config : TrackerConfig
        Sizes of objects.
    """
    rectangles = _working(proposals.boxes_xyxy, image)
    if proposals.masks is None:
        # A box without a mask covers all its working pixels.
        flat = np.ones((rectangles[:, 2:] - rectangles[:, :2]).prod(1).sum(), np.uint8)
        grid, step, phase = rectangles, 1, np.zeros(2, np.int64)
    else:
        block, masks = proposals.mask_step, proposals.masks
        if image.step % block:
            masks, block = proposals.full_masks() or (), 1
        flat, step = masks.flat if isinstance(masks, JoinedMasks) else _one_after_another(masks), image.step // block
        grid, phase = proposals.boxes_xyxy.astype(np.int64) // block, np.array(image.phase, np.int64) // block
    scores = np.ascontiguousarray(proposals.scores, dtype=np.float32)
    starts = np.concatenate([[0], np.cumsum((rectangles[:, 2:] - rectangles[:, :2]).prod(1))])
    covered, weights = np.empty(starts[-1], np.uint8), np.empty(len(proposals), np.float32)
    masked = kernel.Masks(grid.astype(np.int32), flat, step, phase, rectangles, starts)
    sizes_m = config.min_size_m, config.max_size_m
    kernel.weigh(image.depth_m, candidate, masked, scores, image.camera.fx, *sizes_m, covered, weights)
    return WeighedProposals(rectangles, starts, covered, weights)


def _one_after_another(masks: Sequence[UInt8Array]) -> UInt8Array:
    return np.concatenate(masks, axis=None, dtype=np.uint8, casting="unsafe") if masks else np.zeros(0, np.uint8)


def _working(boxes: npt.NDArray[np.int32], image: WorkingImage) -> npt.NDArray[np.int64]:
    """Return the rectangles (N, 4) of working pixels in boxes (N, 4) of the full image, clipped to the image."""
    height, width = image.depth_m.shape
    inside = (boxes.astype(np.int64) - np.array([*image.phase, *image.phase]) + image.step - 1) // image.step
    inside = np.clip(inside, 0, [width, height, width, height])
    return np.asarray(np.maximum(inside, np.tile(inside[:, :2], 2)))


def proposal_iou(
    weighed: WeighedProposals, owner: npt.NDArray[np.int32], place: npt.NDArray[np.int64], columns: int
) -> Float64Array:
    """Return the IoU of each proposal with each set of pixels, (N, columns).

    Parameters
    ----------
    weighed : WeighedProposals
    owner : (h, w) int32
        Number of the set of each working pixel, 0: none.
    place : (M,) int64
        Column of each set by number, `columns` for 0 and for sets that do not count.
    columns : int
    """
    table = np.empty((len(weighed.weights), columns + 1), np.int64)
    sizes, column = np.empty(columns + 1, np.int64), np.empty(owner.shape, np.int32)
    masks = weighed.rectangles, weighed.starts, weighed.covered
    proposal_overlaps(owner, place, *masks, column, table, sizes)
    common = table[:, :columns]
    return np.asarray(common / np.maximum(table.sum(1)[:, None] + sizes[:columns] - common, 1))


def pixel_heat(image: WorkingImage, weighed: WeighedProposals) -> Float32Array:
    """Return the heat (h, w) of each working pixel, 0..1.

    Votes v become 1 - exp(-v / r), where r is the mean weight of the frame's strongest proposals: one strong proposal
    gives 0.63, and several that agree approach 1. The result depends neither on the number of proposals nor on the
    scale of a source's scores.
    """
    heat = np.zeros(image.depth_m.shape, np.float32)
    if len(weighed.weights) == 0:
        return heat
    kernel.accumulate_heat(weighed.rectangles, weighed.starts, weighed.covered, weighed.weights, heat)
    strength = max(MIN_STRENGTH, float(np.sort(weighed.weights)[::-1][:STRONGEST].mean()))
    heat /= -np.float32(strength)
    np.exp(heat, out=heat)
    return np.subtract(np.float32(1.0), heat, out=heat)
