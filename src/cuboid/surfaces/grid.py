"""The ground plan: which parts of the scene, seen from above, each supporting plane covers."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.frame import Float64Array, UInt8Array

# Edge of a cell of the ground plan, metres: finer than any table, coarser than depth noise.
CELL_M = 0.05
# Holes up to twice this are filled, metres: what stands on a plane hides it.
CLOSE_M = 0.2
# What is seen of a plane reaches this much further, metres: its rim is lost to mixed pixels.
RIM_M = 0.05
# The border of a plane is so wide, metres: what it is said to reach beyond what was seen, twice, and a lip of 5 cm.
BORDER_M = 0.15
# A plane may go on this far beyond what is covered, metres.
NEARBY_M = 0.4
# Readings that a cell needs before it counts.
CELL_READINGS = 8
# A plan is never wider than this many cells (200 m).
LIMIT_CELLS = 4000


def _disc(radius_m: float) -> UInt8Array:
    r = max(1, round(radius_m / CELL_M))
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * r + 1, 2 * r + 1)).astype(np.uint8)


_CLOSE, _RIM, _BORDER, _NEARBY = (
    _disc(CLOSE_M),
    _disc(RIM_M),
    _disc(BORDER_M),
    np.ones((2 * round(NEARBY_M / CELL_M) + 1,) * 2, np.uint8),
)


class GroundPlan:
    """Counts of readings on each plane by cell, and the outline that follows from them.

    Attributes
    ----------
    origin : (2,) float64
        Plan coordinates of the corner of cell (0, 0), metres.
    seen : (P, N, M) int32
        Readings by plane and cell.
    covered : (P, N, M) uint8
        1 where the plane is, holes under objects filled.
    nearby : (P, N, M) uint8
        1 where the plane is or may go on, within `NEARBY_M`.
    """

    def __init__(self) -> None:
        self.origin: Float64Array = np.zeros(2)
        self.seen: npt.NDArray[np.int32] = np.zeros((0, 0, 0), np.int32)
        self.covered: UInt8Array = np.zeros((0, 0, 0), np.uint8)
        self.nearby: UInt8Array = np.zeros((0, 0, 0), np.uint8)

    def cells_of(self, points: Float64Array) -> npt.NDArray[np.int64]:
        """Return the cells (N, 2) of plan coordinates (N, 2)."""
        return np.floor((points[:, :2] - self.origin) / CELL_M).astype(np.int64)

    def reach(self, points: Float64Array) -> None:
        """Grow the plan so that it holds these plan coordinates (N, 2)."""
        if len(points) == 0:
            return
        shape = np.array(self.seen.shape[1:])
        if shape.prod() == 0:
            self.origin = np.floor(points[:, :2].min(0) / CELL_M) * CELL_M
        cells = self.cells_of(points)
        before = np.maximum(0, -cells.min(0))
        after = np.maximum(0, cells.max(0) + 1 - shape)
        if not before.any() and not after.any():
            return
        # Grow by more than asked, so that growing is rare.
        before, after = before + (before > 0) * 32, after + (after > 0) * 32
        if (shape + before + after).max() > LIMIT_CELLS:
            return
        pads = ((0, 0), (before[0], after[0]), (before[1], after[1]))
        self.seen = np.pad(self.seen, pads)
        self.covered, self.nearby = np.pad(self.covered, pads), np.pad(self.nearby, pads)
        self.origin = self.origin - before * CELL_M

    def add_plane(self, points: Float64Array, area_m2: Float64Array) -> None:
        """Add a plane that was seen at these plan coordinates (N, 2), each standing for an area."""
        self.reach(points)
        layer = np.zeros((1, *self.seen.shape[1:]), np.int32)
        for (i, j), r in zip(self.cells_of(points), np.sqrt(area_m2) / 2 / CELL_M, strict=True):
            k = round(float(r))
            layer[0, max(0, i - k) : i + k + 1, max(0, j - k) : j + k + 1] = CELL_READINGS
        self.seen = np.concatenate([self.seen, layer])
        self.covered = np.concatenate([self.covered, np.zeros_like(layer, np.uint8)])
        self.nearby = np.concatenate([self.nearby, np.zeros_like(layer, np.uint8)])
        self.refresh(len(self.seen) - 1)

    def remove_planes(self, keep: npt.NDArray[np.int64]) -> None:
        """Keep only these planes, in this order."""
        self.seen, self.covered, self.nearby = self.seen[keep], self.covered[keep], self.nearby[keep]

    def move(self, plane: int, points: Float64Array) -> None:
        """Let a plane be where its points (N, 2 or 3), in plan coordinates, now are: left cells lose their readings."""
        self.reach(points)
        seen = self.seen[plane]
        cells = self.cells_of(points)
        i, j = cells[((cells >= 0) & (cells < seen.shape)).all(1)].T
        here = np.zeros(seen.shape, np.int32)
        np.add.at(here, (i, j), 1)
        self.seen[plane] = np.where(here > 0, np.where(here > 1, np.maximum(seen, CELL_READINGS), seen), 0)
        self.refresh(plane)

    def refresh(self, plane: int) -> None:
        """Find anew what a plane covers."""
        seen = np.pad((self.seen[plane] >= CELL_READINGS).astype(np.uint8), _CLOSE.shape[0])
        closed = cv2.morphologyEx(seen, cv2.MORPH_CLOSE, _CLOSE)
        contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        filled = np.zeros_like(closed)
        cv2.drawContours(filled, contours, -1, 1, cv2.FILLED)
        n = _CLOSE.shape[0]
        self.covered[plane] = cv2.dilate(filled, _RIM)[n:-n, n:-n]
        self.nearby[plane] = cv2.dilate(self.covered[plane], _NEARBY)

    def area_m2(self, plane: int) -> float:
        """Return the area in which readings of a plane were seen."""
        return float(np.count_nonzero(self.seen[plane] >= CELL_READINGS)) * CELL_M**2

    def near(self, plane: int, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Tell which plan coordinates (N, 2) lie where a plane is or may go on."""
        return self._look_up(self.nearby[plane], points)

    def covers(self, plane: int, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Tell which plan coordinates (N, 2) a plane covers."""
        return self._look_up(self.covered[plane], points)

    def on_border(self, plane: int, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Tell which plan coordinates (N, 2) a plane covers within `BORDER_M` of where it ends."""
        covered = np.pad(self.covered[plane], 1)
        within = cv2.erode(covered, _BORDER)[1:-1, 1:-1].astype(np.uint8)
        return self._look_up(self.covered[plane], points) & ~self._look_up(within, points)

    def _look_up(self, layer: UInt8Array, points: Float64Array) -> npt.NDArray[np.bool_]:
        i, j = self.cells_of(points).T
        inside = np.asarray((i >= 0) & (j >= 0) & (i < layer.shape[0]) & (j < layer.shape[1]))
        return inside & (layer[np.where(inside, i, 0), np.where(inside, j, 0)] > 0)

    def outline(self, plane: int) -> Float64Array:
        """Return the outline (N, 2) of the largest connected part of a plane, in plan coordinates."""
        contours, _ = cv2.findContours(self.covered[plane], cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        if not contours:
            return np.zeros((0, 2))
        largest = max(contours, key=cv2.contourArea)
        smooth = cv2.approxPolyDP(largest, 1.0, closed=True)[:, 0, ::-1]
        return np.asarray(self.origin + (smooth + 0.5) * CELL_M, dtype=np.float64)
