"""Higher Order Tracking Accuracy: detection, association and localisation in one measure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.lab.evaluation.matching import FrameOverlap
from cuboid.lab.evaluation.result import IntArray
from cuboid.method.objects.matching import assign

ALPHAS = np.arange(1, 20) * 0.05
# Tolerance for rounding: an IoU one rounding step below a threshold still reaches it.
EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class Hota:
    """HOTA and its parts, each the mean over the thresholds `ALPHAS` (0.05 to 0.95).

    Attributes
    ----------
    hota : float
        Mean over thresholds of sqrt(DetA * AssA).
    det_a, det_re, det_pr : float
        Detection accuracy TP / (TP + FN + FP), recall and precision.
    ass_a, ass_re, ass_pr : float
        Association accuracy: for each true positive, the fraction of frames with both its object and label among those
        with at least one of them; association recall and precision: among the frames of the object, or of the label.
    loc_a : float
        Mean IoU of the true positives; 1 at thresholds without any.
    per_alpha : tuple of float
        HOTA at each threshold.
    """

    hota: float
    det_a: float
    det_re: float
    det_pr: float
    ass_a: float
    ass_re: float
    ass_pr: float
    loc_a: float
    per_alpha: tuple[float, ...]


def hota(frames: Sequence[FrameOverlap], objects: int, labels: int) -> Hota:
    """Return HOTA of a sequence.

    Parameters
    ----------
    frames : sequence of FrameOverlap
    objects, labels : int
        Numbers of objects and labels in the sequence.

    Notes
    -----
    Luiten, Osep, Dendorfer, Torr, Geiger, Leal-Taixe, Leibe, "HOTA: A Higher Order Metric for Evaluating
    Multi-Object Tracking", IJCV 2021. Objects and labels are matched once per frame, by the largest sum of overlap
    times global alignment score; each threshold then keeps the pairs that reach it.
    """
    together, truths, found = _global_alignment(frames, objects, labels)
    pairs, reached, iou = _matches(frames, together)
    positives = reached.sum(1).astype(np.float64)
    distinct, number = np.unique(pairs, axis=0, return_inverse=True)
    item, label = distinct.T
    number = number.ravel()
    # Number of matches of each pair of object and label at each threshold.
    matches = np.stack([np.bincount(number[kept], minlength=len(item)) for kept in reached])
    total_truth, total_found = truths.sum(), found.sum()

    def over_positives(whole: Float64Array) -> Float64Array:
        fraction = matches * matches / np.maximum(1.0, whole)
        return np.asarray(fraction.sum(1) / np.maximum(1.0, positives))

    det_a = positives / np.maximum(1.0, total_truth + total_found - positives)
    ass_a = over_positives(truths[item] + found[label] - matches)
    per_alpha = np.sqrt(det_a * ass_a)
    overlap = (reached * iou).sum(1)
    loc_a = np.where(positives > 0, overlap / np.maximum(1.0, positives), 1.0)
    return Hota(
        hota=float(per_alpha.mean()),
        det_a=float(det_a.mean()),
        det_re=float((positives / max(1.0, total_truth)).mean()),
        det_pr=float((positives / max(1.0, total_found)).mean()),
        ass_a=float(ass_a.mean()),
        ass_re=float(over_positives(truths[item]).mean()),
        ass_pr=float(over_positives(found[label]).mean()),
        loc_a=float(loc_a.mean()),
        per_alpha=tuple(per_alpha.tolist()),
    )


def _global_alignment(
    frames: Sequence[FrameOverlap], objects: int, labels: int
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return the global alignment score (objects, labels), and the number of frames of each object and label."""
    shared = np.zeros((objects, labels))
    truths, found = np.zeros(objects), np.zeros(labels)
    for frame in frames:
        iou = frame.iou
        whole = iou.sum(0)[None, :] + iou.sum(1)[:, None] - iou
        # Each overlap divided by the sum of all overlaps of its object and its label in this frame.
        shared[np.ix_(frame.truth, frame.found)] += np.divide(iou, whole, out=np.zeros_like(iou), where=whole > EPS)
        truths[frame.truth] += 1
        found[frame.found] += 1
    whole = truths[:, None] + found[None, :] - shared
    return np.divide(shared, whole, out=np.zeros_like(shared), where=whole > 0), truths, found


def _matches(
    frames: Sequence[FrameOverlap], together: Float64Array
) -> tuple[IntArray, npt.NDArray[np.bool_], Float64Array]:
    """Return the matched pairs of all frames: object and label (n, 2), reached thresholds (A, n), IoU (n,)."""
    pairs, ious = [], []
    for frame in frames:
        score = together[np.ix_(frame.truth, frame.found)] * frame.iou
        for i, j in assign(score, np.nextafter(0.0, 1.0)):
            pairs.append((frame.truth[i], frame.found[j]))
            ious.append(frame.iou[i, j])
    iou = np.array(ious, np.float64)
    return np.array(pairs, np.int64).reshape(-1, 2), iou >= ALPHAS[:, None] - EPS, iou
