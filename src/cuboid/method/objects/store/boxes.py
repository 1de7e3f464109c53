"""The boxes of the living objects in one table: searches compare one box with all others, batch by batch."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.kernels.overlap import BATCH, bound, near


class BoxTable:
    """A row for each object number.

    Parameters
    ----------
    rows : (capacity, 15) float64, optional
        The table of a saved store.

    Attributes
    ----------
    rows : (capacity, 15) float64
        Centre, size, rotation, see `pack`; NaN without a living object.
    """

    def __init__(self, rows: Float64Array | None = None) -> None:
        self.rows: Float64Array = np.full((BATCH, 15), np.nan) if rows is None else rows
        # Bounds of batches of boxes, and the batches that have changed since these were computed.
        self._bounds: Float64Array | None = None
        self._changed: set[int] = set()

    def place(self, number: int, box: Box) -> None:
        """Set the box of a living object."""
        if number >= len(self.rows):
            self.rows = np.concatenate([self.rows, np.full_like(self.rows, np.nan)])
        row = self.rows[number]
        row[:3], row[3:6], row[6:] = box.center, box.size, box.rotation.ravel()
        self._changed.add(number // BATCH)

    def clear(self, number: int) -> None:
        """Remove the box of an object."""
        self.rows[number] = np.nan
        self._changed.add(number // BATCH)

    @property
    def bounds(self) -> Float64Array:
        """Bounds of the boxes of each batch, (M, 7): see `kernels.overlap.bound`."""
        batches = len(self.rows) // BATCH
        if self._bounds is None or len(self._bounds) != batches:
            self._bounds, self._changed = np.zeros((batches, 7)), set(range(batches))
        for batch in self._changed:
            bound(self.rows, batch, self._bounds)
        self._changed.clear()
        return self._bounds

    def near(self, box: Box, gap_m: float, numbers: int) -> npt.NDArray[np.int64]:
        """Return the objects below `numbers` whose bounding spheres come within a gap of a box's, ascending."""
        found = np.empty(numbers, np.int64)
        radius_m = 0.5 * math.sqrt(box.size @ box.size)
        return found[: near(self.rows[:numbers], self.bounds, box.center, radius_m, gap_m, found)]
