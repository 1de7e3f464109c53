"""Functions shared by the sources: convert boxes or masks to proposals and keep the best."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import InputError
from cuboid.method.detection.boxes import MAX_BOXES, best_boxes, unit_scores
from cuboid.method.proposals.types import Proposals


def refuse_options(name: str, options: str | None) -> None:
    """Raise InputError if a source that takes no options was given some."""
    if options is not None:
        raise InputError(f"proposal source '{name}' takes no options, got '{options}'")


def boxes_as_proposals(boxes_xyxy: npt.ArrayLike, scores: npt.ArrayLike, width: int, height: int) -> Proposals:
    """Return the best `MAX_BOXES` boxes, clipped to the image.

    Boxes outside the image, or with a score of NaN or infinity, are dropped.

    Parameters
    ----------
    boxes_xyxy : (N, 4)
        Pixels, end exclusive; fractions are rounded.
    scores : (N,)
        0..1; clipped.
    width, height : int
        Size of the image.
    """
    boxes, values, _ = best_boxes(boxes_xyxy, scores, width, height)
    return Proposals(boxes, values)


def masks_as_proposals(masks: npt.NDArray[np.generic], scores: npt.ArrayLike) -> Proposals:
    """Return the best `MAX_BOXES` of masks (N, H, W), each cropped to its own rectangle; empty masks are dropped."""
    values = unit_scores(scores)
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
        if len(kept) == MAX_BOXES:
            break
    return Proposals(np.array(boxes, dtype=np.int32).reshape(-1, 4), np.array(kept, dtype=np.float32), tuple(crops))
