"""The input of the metrics of a sequence: the overlap in each frame, and one-to-one matching."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.evaluation.result import IntArray
from cuboid.method.objects.matching import assign


@dataclass(frozen=True, slots=True)
class FrameOverlap:
    """True and found objects of a frame, and their overlap.

    Attributes
    ----------
    frame : int
        Frame of the recording.
    truth : (G,) int64
        Objects, numbered from 0 over the sequence.
    found : (P,) int64
        Labels, numbered from 0 over the sequence.
    iou : (G, P) float64
    """

    frame: int
    truth: IntArray
    found: IntArray
    iou: Float64Array


def match(iou: Float64Array, threshold: float) -> list[tuple[int, int]]:
    """Pair rows with columns one to one.

    Parameters
    ----------
    iou : (N, M) float64
        0..1.
    threshold : float
        Minimum IoU of a pair.

    Returns
    -------
    list of (int, int)
        The maximum number of pairs, with the largest summed IoU among such pairings (Kuhn 1955).
    """
    # One more pair outweighs any sum of IoU, which is at most the number of pairs.
    bonus = 1.0 + min(iou.shape)
    return assign(np.where(iou >= threshold, bonus + iou, 0.0), bonus)


def ratio(part: float, whole: float) -> float | None:
    """Return part / whole; None if the whole is 0."""
    return float(part / whole) if whole else None
