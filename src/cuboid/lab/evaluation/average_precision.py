"""Average precision of boxes or rectangles that are ranked by probability."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.evaluation.scope import BoolArray


def average_precision(score: Float64Array, right: BoolArray, wanted: int) -> float | None:
    """Return the area under precision over recall, with all-point interpolation.

    Boxes count from the highest score on. The curve has one point for each distinct score, so that the order of boxes
    with equal scores does not matter. The precision at a recall is the largest one at this recall or a higher one
    (Everingham et al., "The PASCAL VOC Challenge", IJCV 2010, as of 2010).

    Parameters
    ----------
    score : (N,) float64
        Probability, or any number that rises with it; NaN ranks last.
    right : (N,) bool
        Whether the box pairs with an object; at most one box pairs with each object.
    wanted : int
        Number of objects to be found.

    Returns
    -------
    float or None
        0..1; None if nothing is to be found.
    """
    if wanted == 0:
        return None
    _, rank = np.unique(np.where(np.isnan(score), np.inf, -score), return_inverse=True)
    order = np.argsort(rank, kind="stable")
    last = np.flatnonzero(np.diff(rank[order], append=len(rank)))  # the last box of each distinct score
    hits = right[order].cumsum()[last]
    precision = hits / (last + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float((np.diff(hits, prepend=0) * envelope).sum() / wanted)
