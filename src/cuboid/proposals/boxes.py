"""Functions shared by the sources: clip rectangles, thin out overlapping ones, crop masks, keep the best."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.core.errors import InputError
from cuboid.core.frame import Float32Array, Float64Array, UInt8Array
from cuboid.proposals.types import Proposals

# Proposals of a frame, at most, from a source of many rough boxes: recall at IoU 0.5 grows little after a hundred
# (Hosang et al., "What makes for effective detection proposals?", 2016), and each costs time downstream.
MAX_BOXES = 100

BoolArray = npt.NDArray[np.bool_]


def refuse_options(name: str, options: str | None) -> None:
    """Raise InputError where a source that takes no options got some."""
    if options is not None:
        raise InputError(f"proposal source '{name}' takes no options, got '{options}'")


def boxes_as_proposals(
    boxes_xyxy: npt.ArrayLike, scores: npt.ArrayLike, width: int, height: int, most: int = MAX_BOXES
) -> Proposals:
    """Return the best boxes, clipped to the image; those outside it or with a score that is no number are left out.

    Parameters
    ----------
    boxes_xyxy : (N, 4)
        Pixels, end exclusive; fractions are rounded.
    scores : (N,)
        0..1; clipped.
    width, height : int
        Of the image.
    most : int
    """
    boxes, values, _ = best_boxes(boxes_xyxy, scores, width, height, most)
    return Proposals(boxes, values)


def best_boxes(
    boxes_xyxy: npt.ArrayLike, scores: npt.ArrayLike, width: int, height: int, most: int = MAX_BOXES
) -> tuple[npt.NDArray[np.int32], Float32Array, npt.NDArray[np.intp]]:
    """Return boxes and scores as `boxes_as_proposals` does, and which of the given ones they are."""
    values = _unit(scores)
    boxes = np.asarray(boxes_xyxy, dtype=np.float64).reshape(-1, 4)
    finite = np.isfinite(boxes).all(axis=1) & np.isfinite(values)
    limits = np.array([width, height, width, height], dtype=np.float64)
    whole = np.clip(np.rint(np.where(finite[:, None], boxes, 0.0)), 0.0, limits).astype(np.int32)
    inside = np.flatnonzero(finite & (whole[:, 2] > whole[:, 0]) & (whole[:, 3] > whole[:, 1]))
    order = inside[np.argsort(-values[inside], kind="stable")][:most]
    return whole[order], values[order], order


def masks_as_proposals(masks: npt.NDArray[np.generic], scores: npt.ArrayLike, most: int = MAX_BOXES) -> Proposals:
    """Return the best masks, (N, H, W), each cropped to its own rectangle; empty masks are left out."""
    values = _unit(scores)
    boxes: list[tuple[int, int, int, int]] = []
    crops: list[UInt8Array] = []
    kept: list[float] = []
    for k in np.argsort(-values, kind="stable"):
        mask = np.asarray(masks[k]) > 0
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        if len(rows) == 0 or not np.isfinite(values[k]):
            continue
        x0, y0, x1, y1 = int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
        boxes.append((x0, y0, x1, y1))
        crops.append(np.ascontiguousarray(mask[y0:y1, x0:x1], dtype=np.uint8))
        kept.append(float(values[k]))
        if len(kept) == most:
            break
    return Proposals(np.array(boxes, dtype=np.int32).reshape(-1, 4), np.array(kept, dtype=np.float32), tuple(crops))


def _unit(scores: npt.ArrayLike) -> Float32Array:
    return np.clip(np.asarray(scores, dtype=np.float32).ravel(), 0.0, 1.0).astype(np.float32)


def thin_out(boxes_xyxy: Float64Array, scores: Float64Array, overlap: float) -> npt.NDArray[np.intp]:
    """Return which boxes stay, the best first, when each removes the worse ones with an IoU above `overlap`."""
    order = np.argsort(-scores, kind="stable")
    boxes = boxes_xyxy[order]
    area = np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0), axis=1)
    alive: BoolArray = np.ones(len(order), dtype=np.bool_)
    for k in range(len(order)):
        if not alive[k]:
            continue
        rest = boxes[k + 1 :]
        shared = np.minimum(rest[:, 2:], boxes[k, 2:]) - np.maximum(rest[:, :2], boxes[k, :2])
        both = np.prod(np.maximum(shared, 0.0), axis=1)
        union = area[k + 1 :] + area[k] - both
        alive[k + 1 :] &= both <= overlap * np.maximum(union, 1e-12)
    return order[alive]
