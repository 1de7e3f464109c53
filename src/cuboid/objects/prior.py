"""Prior of the map on proposals: those that match known objects weigh more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float64Array
from cuboid.heatmap.kernels.claims import proposal_overlaps
from cuboid.heatmap.pixel_heat import WeighedProposals
from cuboid.objects.association import index_table
from cuboid.objects.entry import MapObject


def prior_of(
    objects: Sequence[MapObject], pixel_owner: npt.NDArray[np.int32], weighed: WeighedProposals
) -> Float64Array:
    """Return what each proposal's weight is multiplied by (N,): 1 plus its IoU with an object times how sure that is.

    Parameters
    ----------
    objects : sequence of MapObject
        Those that may be seen; what has no label is not sure.
    pixel_owner : (h, w) int32
        Number of the object that each working pixel belongs to, 0 none.
    weighed : WeighedProposals
    """
    labelled = [o for o in objects if o.confirmed]
    n, m = len(weighed.weights), len(labelled)
    if n == 0 or m == 0:
        return np.ones(n)
    place = index_table([o.number for o in labelled], int(pixel_owner.max()))
    table, object_pixels = np.empty((n, m + 1), np.int64), np.empty(m + 1, np.int64)
    column = np.empty(pixel_owner.shape, np.int32)
    proposal_overlaps(
        pixel_owner, place, weighed.rectangles, weighed.starts, weighed.covered, column, table, object_pixels
    )
    mine = table[:, :m]
    iou = mine / np.maximum(table.sum(1)[:, None] + object_pixels[:m] - mine, 1)
    return np.asarray(1.0 + (iou * np.array([o.score for o in labelled])).max(1))
