"""Where the objects are, in one table, and which of them wait or are gone: no look goes through all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float64Array, UInt8Array
from cuboid.geometry.box import Box
from cuboid.geometry.overlap import pack
from cuboid.objects.entry import MapObject


class ObjectIndex:
    """The boxes and sizes of living objects, a row a number, and lists of the others.

    Attributes
    ----------
    boxes : (capacity, 15) float64
        See `pack`; NaN where no object lives.
    unlabelled, retired : dict of int to MapObject
        Living ones without a label, ascending; those that are retired.
    """

    def __init__(self) -> None:
        self.boxes: Float64Array = np.full((64, 15), np.nan)
        self._points: npt.NDArray[np.int64] = np.zeros(64, np.int64)
        self.unlabelled: dict[int, MapObject] = {}
        self.retired: dict[int, MapObject] = {}

    def note(self, entry: MapObject) -> None:
        """Take in a new object, or what has become of one."""
        number = entry.number
        if number >= len(self.boxes):
            self.boxes = np.concatenate([self.boxes, np.full_like(self.boxes, np.nan)])
            self._points = np.concatenate([self._points, np.zeros_like(self._points)])
        self.drop(number, keep_order=not entry.confirmed)
        if entry.retired:
            self.retired[number] = entry
            return
        self.boxes[number] = pack([entry.box])[0]
        self._points[number] = len(entry.points)
        if not entry.confirmed:
            self.unlabelled[number] = entry

    def drop(self, number: int, *, keep_order: bool = False) -> None:
        """Take out an object; `keep_order` leaves it among those without a label."""
        self.boxes[number], self._points[number] = np.nan, 0
        self.retired.pop(number, None)
        if not keep_order:
            self.unlabelled.pop(number, None)

    def large(self, count: int, voxels: int) -> UInt8Array:
        """Return which of the first so many numbers (count,) are objects of more than so many voxels."""
        return np.asarray(self._points[:count] > voxels, dtype=np.uint8)

    def near(self, center: Float64Array, reach_m: float) -> list[int]:
        """Return the numbers of objects with their centers that near a place, ascending."""
        apart = self.boxes[:, :3] - center
        return [int(k) for k in np.flatnonzero((apart**2).sum(1) <= reach_m**2)]

    def beside(self, box: Box, gap_m: float) -> list[int]:
        """Return the numbers of objects whose bounding spheres come that near a box's, ascending."""
        apart = np.sqrt(((self.boxes[:, :3] - box.center) ** 2).sum(1))
        radii = np.sqrt((self.boxes[:, 3:6] ** 2).sum(1)) + float(np.linalg.norm(box.size))
        return [int(k) for k in np.flatnonzero(apart <= 0.5 * radii + gap_m)]

    def around(self, numbers: Sequence[int], reach_m: float) -> list[int]:
        """Return the numbers of objects in the region that some objects take up, and that far around it, ascending."""
        centers = self.boxes[numbers, :3]
        known = centers[np.isfinite(centers[:, 0])]
        if len(known) == 0:
            return []
        low, high = known.min(0) - reach_m, known.max(0) + reach_m
        return [int(k) for k in np.flatnonzero(((self.boxes[:, :3] >= low) & (self.boxes[:, :3] <= high)).all(1))]
