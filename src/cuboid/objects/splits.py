"""Two things that touch, taken for one object: what the proposals of every frame say of it.

Where an object's pixels are shared out between two masks, and both reach down to the supporting plane, two things
stand there side by side. The parts of one thing seldom do both: a handle, a lid, what grows in a pot do not stand,
and a body and its brim are mostly held by one mask.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from cuboid.frame import Float32Array
from cuboid.heatmap.voxel_map import Rows
from cuboid.objects.holdings import Holdings
from cuboid.objects.validity import FLOAT_M
from cuboid.surfaces.clusters import LEAST_VOXELS

# An object is looked at when it shows this many pixels. One mask holds it with the first share of them; of two masks
# the smaller one holds at least the second, and so many pixels.
LEAST_PIXELS, ONE_SHARE, PART_SHARE, PART_PIXELS = 60, 0.8, 0.2, 25
# A mask stands when this share of its pixels is no higher than things float.
LOWEST_SHARE = 0.03
# Two stand there when so many frames saw two, and at least so many for each that saw one.
SURE_FRAMES, SURE_RATIO = 10, 0.75


class Splits:
    """Counts, for each object, of frames that saw one thing and of frames that saw two that stand side by side.

    Attributes
    ----------
    proved : set of int
        The objects that have proved to be two.
    """

    def __init__(self) -> None:
        self._counts: dict[int, list[int]] = {}
        self.proved: set[int] = set()

    def see(
        self,
        held: Holdings,
        heights: Float32Array,
        slots: npt.NDArray[np.int32],
        side: npt.NDArray[np.int32],
    ) -> None:
        """Take in a frame.

        Parameters
        ----------
        held : Holdings
            What its masks hold of the objects.
        heights : (h, w) float32
            Metres above the plane beneath, NaN without one.
        slots : (h, w) int32
            Voxel of each pixel, -1 none.
        side : (capacity,) int32, in and out
            For each voxel, frames that saw it in the first of two things less those that saw it in the second.
        """
        total = held.table.sum(1)
        for k in np.flatnonzero(total >= LEAST_PIXELS).tolist():
            ranked = np.argsort(held.table[k], kind="stable")
            second, first = (int(m) for m in ranked[-2:]) if len(ranked) > 1 else (0, 0)
            if held.table[k, first] >= ONE_SHARE * total[k]:
                self._count(int(held.numbers[k]), 0)
            elif held.table[k, second] >= max(PART_PIXELS, PART_SHARE * total[k]):
                one, other = held.of(k, first), held.of(k, second)
                if _stands(heights.ravel()[one]) and _stands(heights.ravel()[other]):
                    self._count(int(held.numbers[k]), 1)
                    _take_sides(np.unique(slots.ravel()[one]), np.unique(slots.ravel()[other]), side)

    def _count(self, number: int, which: int) -> None:
        self._counts.setdefault(number, [0, 0])[which] += 1
        (self.proved.add if self.are_two(number) else self.proved.discard)(number)

    def are_two(self, number: int) -> bool:
        """Tell whether what was taken for one object has proved to be two."""
        one, two = self._counts.get(number, (0, 0))
        return two >= SURE_FRAMES and two >= SURE_RATIO * one

    def forget(self, number: int) -> None:
        """Start anew with an object."""
        self._counts.pop(number, None)
        self.proved.discard(number)


def _stands(heights: Float32Array) -> bool:
    known = heights[np.isfinite(heights)]
    return len(known) > 0 and float(np.quantile(known, LOWEST_SHARE)) < FLOAT_M


def _take_sides(first: Rows, second: Rows, side: npt.NDArray[np.int32]) -> None:
    """Count two parts on the sides that agree best with what was counted before."""
    if int(side[first].sum()) < int(side[second].sum()):
        first, second = second, first
    side[first] += 1
    side[second] -= 1


def larger_side(points: Float32Array, side: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_] | None:
    """Return which of an object's voxels (N,) belong to the larger of two things; None where one has too few.

    A voxel that no frame told goes with the nearest one that some did.
    """
    told = side != 0
    if min(np.count_nonzero(side > 0), np.count_nonzero(side < 0)) < LEAST_VOXELS:
        return None
    first = np.asarray(side[told][cKDTree(points[told]).query(points)[1]] > 0)
    return first if np.count_nonzero(first) * 2 >= len(first) else ~first
