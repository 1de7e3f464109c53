"""What the map expects of a frame: proposals that are objects it knows count for more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float64Array, UInt8Array
from cuboid.heatmap.pixel_heat import WeighedProposals
from cuboid.kernels.claims import common
from cuboid.objects.entry import MapObject
from cuboid.working import WorkingImage

# What a proposal that is exactly what is seen of a sure object gains, as a share of its weight.
EXPECTED = 1.0


def prior_of(
    objects: Sequence[MapObject],
    image: WorkingImage,
    candidate: UInt8Array,
    pixel_owner: npt.NDArray[np.int32],
    weighed: WeighedProposals,
) -> Float64Array:
    """Return what each proposal's weight is multiplied by (N,): 1 plus its IoU with an object times how sure that is.

    Parameters
    ----------
    objects : sequence of MapObject
        Those that may be seen.
    image : WorkingImage
    candidate : (h, w) uint8
    pixel_owner : (h, w) int32
        Number of the object that each working pixel belongs to, 0 none.
    weighed : WeighedProposals
    """
    n, m = len(weighed.weights), len(objects)
    if n == 0 or m == 0:
        return np.ones(n)
    place = np.full(int(max(pixel_owner.max(), max(o.number for o in objects))) + 1, -1)
    place[[o.number for o in objects]] = np.arange(m)
    place[0] = -1
    table = np.empty((n, m + 1), np.int64)
    common(
        candidate, pixel_owner, place, m, weighed.boxes, weighed.masks, weighed.starts, image.step,
        np.array(image.phase, dtype=np.int64), table,
    )  # fmt: skip
    sight = np.bincount(pixel_owner.ravel(), minlength=len(place))[[o.number for o in objects]]
    mine = table[:, :m]
    iou = mine / np.maximum(table[:, m:] + sight[None] - mine, 1)
    sure = np.array([o.score if o.confirmed else 0.0 for o in objects])
    return np.asarray(1.0 + EXPECTED * (iou * sure).max(1))
