"""The ground plan of a plane: the area that it covers, seen from above.

All plans use the same grid of cells, `CELL_M` wide and numbered from the origin of the plan frame; each plan has a
window of the grid that is as large as its plane.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.state import WatchedRecord
from cuboid.ground.core.tolerances import MIN_READINGS

# Edge of a cell of the ground plan, metres: finer than any table, coarser than depth noise.
CELL_M = 0.05
# Holes up to twice this width are filled, metres: objects on a plane hide it.
CLOSE_M = 0.2
# A plane extends this far beyond its readings, metres: at its rim readings are removed as mixed pixels.
RIM_M = CELL_M
# A plane may continue this far beyond its covered area, metres.
NEARBY_M = 2.0 * CLOSE_M
# Largest width of a window, cells (200 m).
LIMIT_CELLS = 4000
# A window that must grow gets this many extra cells, or this fraction of its size, so that it seldom grows.
SLACK_CELLS, SLACK_FRACTION = 16, 0.25
# In a window wider than WHOLE_CELLS only the changed part is recomputed, with AROUND_CELLS around it: 8 m, the width of
# the largest hole that is filled.
WHOLE_CELLS, AROUND_CELLS = 400, 160

Places = npt.NDArray[np.int64]


def _disc(radius_m: float) -> UInt8Array:
    r = max(1, round(radius_m / CELL_M))
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * r + 1, 2 * r + 1)).astype(np.uint8)


_CLOSE, _RIM, _NEARBY = (
    _disc(CLOSE_M),
    _disc(RIM_M),
    np.ones((2 * round(NEARBY_M / CELL_M) + 1,) * 2, np.uint8),
)
# Distance in cells from a reading to the border of its window: the nearby area of the reading lies inside the window.
_MARGIN = _RIM.shape[0] // 2 + _NEARBY.shape[0] // 2
# Distance in cells over which a reading may change the covered and nearby areas.
_UNSURE = _MARGIN + 2 * (_CLOSE.shape[0] // 2)


def cells_of(points: Float32Array | Float64Array) -> Places:
    """Return the cells (N, 2) of plan coordinates (N, 2 or 3), metres."""
    return np.floor(points[:, :2] / np.float64(CELL_M)).astype(np.int64)


def _numbers(cells: Places) -> Places:
    """Return a unique number (N,) for each cell (N, 2)."""
    return np.asarray((cells[:, 0] << 32) + cells[:, 1])


@dataclass(slots=True, eq=False)
class GroundPlan(WatchedRecord):
    """Number of readings on one plane by cell, and the area that follows from them.

    Attributes
    ----------
    corner : (2,) int64
        First cell of the window.
    seen : (N, M) int32
        Readings by cell.
    keyframes : (N, M) uint16
        Keyframe that saw each cell last.
    covered : (N, M) uint8
        1 where the plane is; holes under objects are filled.
    nearby : (N, M) uint8
        1 where the plane is or may continue, within `NEARBY_M`.
    stale : bool
        Whether cells have become known since the last `refresh`.
    late : bool
        Whether the plane has moved since then: its area is recomputed on access; see `refresh_if_late`.
    changed : (4,) int64
        Window around the cells that have become known since the last `refresh`.
    places : (K, 2) float32
        Plan coordinates of all cells with readings: the cell centres, until a correction moves them.
    known : int
        Number of cells with at least `MIN_READINGS` readings.
    """

    corner: Places = field(default_factory=lambda: np.zeros(2, np.int64))
    seen: npt.NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 0), np.int32))
    keyframes: npt.NDArray[np.uint16] = field(default_factory=lambda: np.zeros((0, 0), np.uint16))
    covered: UInt8Array = field(default_factory=lambda: np.zeros((0, 0), np.uint8))
    nearby: UInt8Array = field(default_factory=lambda: np.zeros((0, 0), np.uint8))
    stale: bool = False
    late: bool = False
    changed: Places = field(default_factory=lambda: np.zeros(4, np.int64))
    places: Float32Array = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    known: int = 0

    @property
    def window(self) -> Places:
        """First cell and the cell after the last, (4,); outside the window nothing is covered or nearby."""
        return np.concatenate([self.corner, self.corner + self.seen.shape])

    @property
    def wide(self) -> bool:
        """Whether recomputing the covered area takes long."""
        return bool(max(self.seen.shape) > WHOLE_CELLS)

    def grow_to(self, low: Places, high: Places) -> None:
        """Grow the window so that it can hold readings in cells from `low` to `high` (2,), inclusive."""
        if self.seen.size == 0:
            self.corner = low - _MARGIN
        elif (low - _MARGIN >= self.corner).all() and (high + _MARGIN < self.corner + self.seen.shape).all():
            return
        window = self._grown(low, high)
        pads = np.abs(window - self.window)
        if pads.any():
            padding = ((pads[0], pads[2]), (pads[1], pads[3]))
            self.seen, self.keyframes = np.pad(self.seen, padding), np.pad(self.keyframes, padding)
            self.covered, self.nearby = np.pad(self.covered, padding), np.pad(self.nearby, padding)
            self.corner = window[:2]

    def _grown(self, low: Places, high: Places) -> Places:
        """Return the window (4,) extended to cells from `low` to `high`; unchanged if it would become too wide."""
        before = np.maximum(0, self.corner - low + _MARGIN)
        after = np.maximum(0, high + _MARGIN + 1 - self.window[2:])
        slack = np.maximum(SLACK_CELLS, (SLACK_FRACTION * np.array(self.seen.shape)).astype(np.int64))
        before, after = before + (before > 0) * slack, after + (after > 0) * slack
        if (self.seen.shape + before + after).max() > LIMIT_CELLS:
            return self.window
        return np.asarray(self.window + np.concatenate([-before, after]))

    def begin(self, points: Float64Array, area_m2: Float64Array, keyframe: int = 0) -> None:
        """Start the plan from areas that were seen around these plan coordinates (N, 2)."""
        cells = cells_of(points)
        half = np.rint(np.sqrt(area_m2) / 2 / CELL_M).astype(np.int64)
        self.grow_to((cells - half[:, None]).min(0), (cells + half[:, None]).max(0))
        for (i, j), k in zip(cells - self.corner, half, strict=True):
            self.seen[max(0, i - k) : max(0, i + k + 1), max(0, j - k) : max(0, j + k + 1)] = MIN_READINGS
        self.keyframes[:] = keyframe
        self._all_changed()

    def add(self, readings: npt.NDArray[np.int32], corner: Places, keyframe: int | npt.NDArray[np.uint16] = 0) -> None:
        """Add readings (n, m) by cell, starting at cell `corner`, from one keyframe or (n, m) keyframes."""
        i = np.flatnonzero(readings.any(1))
        if len(i) == 0:
            return
        j = np.flatnonzero(readings[i[0] : i[-1] + 1].any(0))
        update_window = np.concatenate([corner, corner + readings.shape])
        # Crop to the cells with readings.
        cropped = slice(i[0], i[-1] + 1), slice(j[0], j[-1] + 1)
        readings, corner = readings[cropped], corner + np.array([i[0], j[0]])
        keyframe = keyframe if isinstance(keyframe, int) else keyframe[cropped]
        self.grow_to(corner, corner + readings.shape - 1)
        window = np.concatenate([corner, corner + readings.shape])
        plan_part, new_part = window_intersection(self.window, window)
        before = int(np.count_nonzero(self.seen[plan_part] >= MIN_READINGS))
        new, is_read = readings[new_part], readings[new_part] > 0
        first = np.argwhere(is_read & (self.seen[plan_part] == 0))
        if len(first):
            self._add_places(first + np.maximum(self.window[:2], window[:2]))
        self.keyframes[plan_part][is_read] = keyframe if isinstance(keyframe, int) else keyframe[new_part][is_read]
        self.seen[plan_part] += new
        self.note_change()
        grown = int(np.count_nonzero(self.seen[plan_part] >= MIN_READINGS)) - before
        if grown:
            self.known += grown
            self.changed = _union(self.changed, update_window) if self.stale else update_window
            self.stale = True

    def absorb(self, other: GroundPlan) -> None:
        """Add the readings of another plan."""
        self.add(other.seen, other.corner, other.keyframes)
        self.refresh()

    def apply_correction(self, moved: Mapping[int, Float64Array], normal: Float64Array, offset: float) -> None:
        """Move the cells with the keyframes that saw them; of several in one cell, the one with most readings stays.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old in the plan frame for each keyframe that moved.
        normal : (3,) float64
        offset : float
            The plane before the correction: normal.p + offset = 0.
        """
        old = cells_of(self.places)
        i, j = (old - self.corner).T
        readings, keyframes = self.seen[i, j], self.keyframes[i, j]
        names, of = np.unique(keyframes, return_inverse=True)
        T = np.array([moved.get(name, np.eye(4)) for name in names.tolist()]).reshape(-1, 4, 4)[of]
        places = self.places.astype(np.float64)
        on_plane = np.column_stack([places, -(places @ normal[:2] + offset) / normal[2]])
        self.places = (np.einsum("nij,nj->ni", T[:, :2, :3], on_plane) + T[:, :2, 3]).astype(np.float32)
        cells = cells_of(self.places)
        if not np.array_equal(cells, old):
            self._move(old, cells, readings, keyframes)

    def _move(
        self, old: Places, cells: Places, readings: npt.NDArray[np.int32], keyframes: npt.NDArray[np.uint16]
    ) -> None:
        """Move cells (N, 2), with their readings (N,) and keyframes (N,)."""
        window = self._grown(cells.min(0), cells.max(0))
        inside = np.flatnonzero(((cells >= window[:2]) & (cells < window[2:])).all(1))
        order = inside[np.argsort(-readings[inside], kind="stable")]
        order = order[np.unique(_numbers(cells[order]), return_index=True)[1]]
        self.places, cells = self.places[order], cells[order]
        i, j = (old - self.corner).T
        self.seen[i, j] = 0
        if (window != self.window).any():
            new_part, old_part = window_intersection(window, self.window)
            for name in ("covered", "nearby"):
                layer = np.zeros(window[2:] - window[:2], np.uint8)
                layer[new_part] = getattr(self, name)[old_part]
                setattr(self, name, layer)
            self.seen, self.keyframes = np.zeros(layer.shape, np.int32), np.zeros(layer.shape, np.uint16)
            self.corner = window[:2]
        i, j = (cells - self.corner).T
        self.seen[i, j], self.keyframes[i, j] = readings[order], keyframes[order]
        cells = self._filled(cells)
        i, j = (cells - self.corner).T
        self.known = int(np.count_nonzero(self.seen[i, j] >= MIN_READINGS))
        both = np.concatenate([old, cells])
        self.changed = np.concatenate([both.min(0), both.max(0) + 1])
        self.stale = self.late = True

    def refresh_if_late(self) -> None:
        """Recompute the covered area if the plane has moved; wide planes are skipped and refreshed in turn."""
        if self.late and not self.wide:
            self.refresh()

    def _filled(self, cells: Places) -> Places:
        """Fill single empty cells between two with readings and return all cells: a rotated grid has such gaps."""
        found = [cells]
        for step in (np.array([1, 0]), np.array([0, 1])):
            inside = (cells + 2 * step - self.corner < self.seen.shape).all(1)
            first = (cells[inside] - self.corner).T
            gap, second = first + step[:, None], first + 2 * step[:, None]
            empty = (self.seen[*gap] == 0) & (self.seen[*second] > 0)
            first, gap, second = first[:, empty], gap[:, empty], second[:, empty]
            self.seen[*gap] = np.minimum(self.seen[*first], self.seen[*second])
            self.keyframes[*gap] = self.keyframes[*first]
            found.append(gap.T + self.corner)
            self._add_places(found[-1])
        return np.concatenate(found)

    def _add_places(self, cells: Places) -> None:
        """Add the centres of cells (N, 2) that have readings now."""
        self.places = np.concatenate([self.places, ((cells + 0.5) * CELL_M).astype(np.float32)])

    def _all_changed(self) -> None:
        self.places = self.places[:0]
        self._add_places(np.argwhere(self.seen > 0) + self.corner)
        self.known = int(np.count_nonzero(self.seen >= MIN_READINGS))
        self.changed = self.window
        self.stale = True
        self.refresh()

    def refresh(self) -> None:
        """Recompute the covered and nearby areas where readings changed."""
        if not self.stale:
            return
        self.stale = self.late = False
        part = self.window
        if self.wide:
            wide = self.changed + AROUND_CELLS * np.array([-1, -1, 1, 1])
            part = np.concatenate([np.maximum(part[:2], wide[:2]), np.minimum(part[2:], wide[2:])])
            if (part[2:] <= part[:2]).any():  # the window has its maximum width and the change lies outside it
                return
        window_part, _ = window_intersection(self.window, part)
        covered = _covered(self.seen[window_part])
        nearby = cv2.dilate(covered, _NEARBY)
        # Near an inner border of the part, the surroundings are not complete: keep the old values there.
        inner = part + np.where(part == self.window, 0, _UNSURE * np.array([1, 1, -1, -1]))
        window_part, update_part = window_intersection(self.window, inner)[0], window_intersection(part, inner)[0]
        self.covered[window_part], self.nearby[window_part] = covered[update_part], nearby[update_part]

    def area_m2(self) -> float:
        """Return the area of the cells with enough readings, square metres."""
        return float(self.known) * CELL_M**2

    def near(self, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Return which plan coordinates (N, 2) lie where the plane is or may continue, (N,)."""
        self.refresh_if_late()
        return self._look_up(self.nearby, points)

    def covers(self, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Return which plan coordinates (N, 2) the plane covers, (N,)."""
        self.refresh_if_late()
        return self._look_up(self.covered, points)

    def overlaps(self, other: GroundPlan) -> bool:
        """Return whether two planes cover a common cell."""
        self.refresh_if_late()
        other.refresh_if_late()
        part, other_part = window_intersection(self.window, other.window)
        return bool((self.covered[part] & other.covered[other_part]).any())

    def fraction_over(self, other: GroundPlan) -> float:
        """Return the fraction of this plane's known cells that another plane covers."""
        other.refresh_if_late()
        part, other_part = window_intersection(self.window, other.window)
        over = np.count_nonzero((self.seen[part] >= MIN_READINGS) & (other.covered[other_part] > 0))
        return over / max(1, self.known)

    def _look_up(self, layer: UInt8Array, points: Float64Array) -> npt.NDArray[np.bool_]:
        i, j = (cells_of(points) - self.corner).T
        inside = np.asarray((i >= 0) & (j >= 0) & (i < layer.shape[0]) & (j < layer.shape[1]))
        return inside & (layer[np.where(inside, i, 0), np.where(inside, j, 0)] > 0)

    def outline(self) -> Float64Array:
        """Return the outline (N, 2) of the largest connected part of the plane, in plan coordinates."""
        covered = _covered(self.seen) if self.late else self.covered
        contours, _ = cv2.findContours(covered, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        if not contours:
            return np.zeros((0, 2))
        largest = max(contours, key=cv2.contourArea)
        smooth = cv2.approxPolyDP(largest, 1.0, closed=True)[:, 0, ::-1]
        return np.asarray((self.corner + smooth + 0.5) * CELL_M, dtype=np.float64)


def _covered(seen: npt.NDArray[np.int32]) -> UInt8Array:
    """Return the area covered by readings (N, M): gaps closed, holes filled, and a rim added."""
    n = _CLOSE.shape[0]
    measured = np.pad((seen >= MIN_READINGS).astype(np.uint8), n)
    closed = cv2.morphologyEx(measured, cv2.MORPH_CLOSE, _CLOSE)
    contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros_like(closed)
    cv2.drawContours(filled, contours, -1, 1, cv2.FILLED)
    return np.ascontiguousarray(cv2.dilate(filled, _RIM)[n:-n, n:-n], np.uint8)


def _union(a: Places, b: Places) -> Places:
    """Return the smallest window (4,) that contains two windows."""
    return np.concatenate([np.minimum(a[:2], b[:2]), np.maximum(a[2:], b[2:])])


def window_intersection(a: Places, b: Places) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the intersection of two windows (4,), as slices into each of them."""
    # Python numbers are faster than NumPy for four values.
    (ax, ay, ax_end, ay_end), (bx, by, bx_end, by_end) = a.tolist(), b.tolist()
    x, y = max(ax, bx), max(ay, by)
    x_end, y_end = max(x, min(ax_end, bx_end)), max(y, min(ay_end, by_end))
    in_a = slice(x - ax, x_end - ax), slice(y - ay, y_end - ay)
    return in_a, (slice(x - bx, x_end - bx), slice(y - by, y_end - by))
