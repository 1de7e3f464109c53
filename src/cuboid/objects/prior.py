"""What the map expects of a frame: proposals that are objects it knows count for more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float64Array
from cuboid.heatmap.pixel_heat import WeighedProposals
from cuboid.kernels.claims import common
from cuboid.objects.association import places_of
from cuboid.objects.entry import MapObject

# What a proposal that is exactly what is seen of a sure object gains, as a share of its weight.
EXPECTED = 1.0


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
    place = places_of([o.number for o in labelled], int(pixel_owner.max()))
    table, sight = np.empty((n, m + 1), np.int64), np.empty(m + 1, np.int64)
    column = np.empty(pixel_owner.shape, np.int32)
    common(pixel_owner, place, weighed.rectangles, weighed.starts, weighed.covered, column, table, sight)
    mine = table[:, :m]
    iou = mine / np.maximum(table.sum(1)[:, None] + sight[:m] - mine, 1)
    return np.asarray(1.0 + EXPECTED * (iou * np.array([o.score for o in labelled])).max(1))
