"""Post-processing of detected boxes: clipping to the image, selection of the best, removal of duplicates."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array

# Maximum number of boxes per frame from a source of many rough ones: recall at IoU 0.5 grows little after a hundred
# (Hosang et al., "What makes for effective detection proposals?", 2016), and each costs time downstream.
MAX_BOXES = 100


def best_boxes(
    boxes_xyxy: npt.ArrayLike, scores: npt.ArrayLike, width: int, height: int, max_boxes: int = MAX_BOXES
) -> tuple[npt.NDArray[np.int32], Float32Array, npt.NDArray[np.intp]]:
    """Return the best boxes, clipped to the image, their scores, and their indices in the input.

    Boxes outside the image, and boxes with a score of NaN or infinity, are left out.

    Parameters
    ----------
    boxes_xyxy : (N, 4)
        Pixels, end exclusive; fractions are rounded.
    scores : (N,)
        0..1; clipped.
    width, height : int
        Size of the image.
    max_boxes : int
    """
    values = unit_scores(scores)
    boxes = np.asarray(boxes_xyxy, dtype=np.float64).reshape(-1, 4)
    finite = np.isfinite(boxes).all(axis=1) & np.isfinite(values)
    limits = np.array([width, height, width, height], dtype=np.float64)
    whole = np.clip(np.rint(np.where(finite[:, None], boxes, 0.0)), 0.0, limits).astype(np.int32)
    inside = np.flatnonzero(finite & (whole[:, 2] > whole[:, 0]) & (whole[:, 3] > whole[:, 1]))
    order = inside[np.argsort(-values[inside], kind="stable")][:max_boxes]
    return whole[order], values[order], order


def unit_scores(scores: npt.ArrayLike) -> Float32Array:
    """Return scores (N,) clipped to 0..1."""
    return np.clip(np.asarray(scores, dtype=np.float32).ravel(), 0.0, 1.0).astype(np.float32)


def thin_out(boxes_xyxy: Float64Array, scores: Float64Array, overlap: float) -> npt.NDArray[np.intp]:
    """Return the boxes (N, 4), scored (N,), left by non-maximum suppression at IoU `overlap`: indices, best first."""
    order = np.argsort(-scores, kind="stable")
    boxes = boxes_xyxy[order]
    area = np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0), axis=1)
    alive: npt.NDArray[np.bool_] = np.ones(len(order), dtype=np.bool_)
    for k in range(len(order)):
        if not alive[k]:
            continue
        rest = boxes[k + 1 :]
        shared = np.minimum(rest[:, 2:], boxes[k, 2:]) - np.maximum(rest[:, :2], boxes[k, :2])
        both = np.prod(np.maximum(shared, 0.0), axis=1)
        union = area[k + 1 :] + area[k] - both
        alive[k + 1 :] &= both <= overlap * np.maximum(union, 1e-12)
    return order[alive]
