"""The 2D heat of a frame: the weighted vote of its proposals, corrected by depth."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.config import TrackerConfig
from cuboid.frame import Float32Array, UInt8Array
from cuboid.kernels import votes as kernel
from cuboid.proposals.types import Proposals
from cuboid.working import WorkingImage

# The strongest proposals that say how much weight counts as sure.
STRONGEST = 10
# A frame whose best proposals are weaker than this has nothing sure in it (scores are 0..1).
LEAST_SURE = 0.1


def pixel_heat(
    image: WorkingImage,
    candidate: UInt8Array,
    proposals: Proposals,
    focal_px: float,
    config: TrackerConfig,
) -> tuple[Float32Array, npt.NDArray[np.int32]]:
    """Return the heat of each working pixel, 0..1, and the mask that claims it.

    Votes v become 1 - exp(-v / r), with r the mean weight of the frame's strongest proposals: one sure proposal
    gives 0.63, several agreeing ones approach 1, and neither the number of proposals nor the scale of a source's
    scores matters.

    Parameters
    ----------
    image : WorkingImage
    candidate : (h, w) uint8
        1 where a reading may belong to an object: off every plane, above one of them.
    proposals : Proposals
        In pixels of the full image.
    focal_px : float
        Focal length of the full image.
    config : TrackerConfig
        Sizes of objects.

    Returns
    -------
    (h, w) float32
        Heat.
    (h, w) int32
        Number of the heaviest mask over a candidate, -1 none.
    """
    heat, claim = np.zeros(candidate.shape, np.float32), np.full(candidate.shape, -1, np.int32)
    if len(proposals) == 0:
        return heat, claim
    masks, starts = _flatten(proposals)
    phase = np.array(image.phase, dtype=np.int64)
    weights = np.empty(len(proposals), np.float32)
    boxes = np.ascontiguousarray(proposals.boxes_xyxy, dtype=np.int32)
    scores = np.ascontiguousarray(proposals.scores, dtype=np.float32)
    kernel.weigh(
        image.depth_m, candidate, boxes, scores, masks, starts, image.step, phase, focal_px, config.min_size_m,
        config.max_size_m, weights,
    )  # fmt: skip
    kernel.vote(candidate, boxes, weights, masks, starts, image.step, phase, heat, claim)
    sure = max(LEAST_SURE, float(np.sort(weights)[::-1][:STRONGEST].mean()))
    heat = np.asarray(1.0 - np.exp(-heat / np.float32(sure)), dtype=np.float32)
    return heat, claim


def _flatten(proposals: Proposals) -> tuple[UInt8Array, np.ndarray[tuple[int], np.dtype[np.int64]]]:
    if proposals.masks is None:
        return np.zeros(1, np.uint8), np.full(len(proposals), -1, np.int64)
    sizes = np.array([mask.size for mask in proposals.masks], dtype=np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    return np.concatenate([np.asarray(mask, np.uint8).ravel() for mask in proposals.masks]), starts
