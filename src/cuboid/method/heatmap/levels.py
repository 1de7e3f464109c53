"""Levels of detail of the map: background out of view is stored in cells of two voxels per side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.state import Record
from cuboid.ground.core.tolerances import DRIFT_M
from cuboid.method.heatmap.kernels import levels as kernel
from cuboid.method.heatmap.kernels.cubes import BLOCK_BITS, CUBE_BITS
from cuboid.method.heatmap.stored_points import Rows, StoredPoints, rows_of_a_cube, words_of

# After this distance, metres, a camera has left the region that it saw: an arm's length.
LEFT_BEHIND_M = 1.2
# Number of moments (see `LevelsState`) after which a region out of view is stored in cells: the camera has moved by an
# arm's length, or turned by 46 degrees. Shaking, or a short look aside, does not reach it.
MAX_UNVIEWED_MOMENTS = round(LEFT_BEHIND_M / DRIFT_M)
# Rows that are thinned per frame, up to the next whole cube; more if the backlog would not be finished within as many
# frames as `MAX_UNVIEWED_MOMENTS`.
THINNED_ROWS_PER_FRAME = 1024


@dataclass(frozen=True, slots=True)
class LevelsState(Record):
    """State of `Levels`.

    Attributes
    ----------
    first_frame : int or None
        First frame of this visit.
    moments : int
        Number of moments; a new moment begins when the camera has moved.
    parted : (N, 2) int64
        Cubes in which each voxel has its own row because they were accessed, and the moment of that; those out of
        view for longest first.
    """

    first_frame: int | None
    moments: int
    parted: npt.NDArray[np.int64]


class Levels:
    """Levels of detail: points without an owner share one row per cell in cubes that were out of view for a while.

    For each voxel it stays known whether it holds a point, whether more than one frame saw it, and whether it is hot;
    the position (for each layer of the cell), the color and the numbers of frames are averaged. Voxels get rows of
    their own again as soon as their cube is accessed. All this depends only on the frames, not on which cubes are in
    memory.

    Parameters
    ----------
    stored : StoredPoints

    Attributes
    ----------
    first_frame, moments, parted
        As in `LevelsState`.
    """

    NOT_SAVED = frozenset({"_stored"})

    def __init__(self, stored: StoredPoints) -> None:
        self._stored = stored
        self.first_frame: int | None = None
        self.moments, self.parted = 0, np.zeros((0, 2), np.int64)

    def state(self) -> LevelsState:
        """Return the current state; later updates do not change it."""
        return LevelsState(self.first_frame, self.moments, self.parted.copy())

    @classmethod
    def from_state(cls, state: LevelsState, stored: StoredPoints) -> Levels:
        """Return levels that continue from a state."""
        levels = cls(stored)
        levels.first_frame, levels.moments, levels.parted = state.first_frame, state.moments, state.parted
        return levels

    def begin_visit(self) -> None:
        """Begin a visit: no frame of it has been seen yet."""
        self.first_frame = None
        self.forget()

    def forget(self) -> None:
        """Forget which cubes were accessed, because the map begins anew."""
        self.parted = self.parted[:0]

    def note_frame(self, frame: int) -> None:
        """Record that a frame is seen; the first one is the first frame of the visit."""
        if self.first_frame is None:
            self.first_frame = frame

    def load(self, cubes: Rows) -> None:
        """Load cubes (N,) with one row per voxel and an index of the rows."""
        stored = self._stored
        if stored.cubes.bits[cubes].all():
            return
        undivided = np.unique(cubes[stored.cubes.bits[cubes] == 0])
        stored.load(undivided)
        first_new, parted = stored.blocks, np.empty(len(undivided), bool)
        words = words_of(stored.memory.rows)
        kernel.split_cells(undivided, stored.cubes, words, stored.points, *rows_of_a_cube(), parted)
        stored.note_new_blocks(first_new)
        stored.unindexed[undivided] = False
        self.mark_viewed(undivided[parted])

    def mark_viewed(self, cubes: Rows) -> None:
        """Record that cubes (N,), each listed once, are accessed now."""
        stored = self._stored
        cubes = cubes[~stored.is_fine(cubes)]
        stored.marks[cubes] = True
        others = self.parted[~stored.marks[self.parted[:, 0]]]
        stored.marks[cubes] = False
        now = np.empty((len(cubes), 2), np.int64)
        now[:, 0], now[:, 1] = cubes, self.moments
        self.parted = np.concatenate([others, now])

    def thin_all(self) -> None:
        """Thin all cubes, because the visit has ended."""
        self._thin(self.parted[:, 0])
        self.forget()

    def schedule_thinning(self, seen: Rows) -> None:
        """Mark cubes (N,) as viewed by a frame, and thin cubes that have been out of view for long enough."""
        self.mark_viewed(seen)
        due = int(np.searchsorted(self.parted[:, 1], self.moments - MAX_UNVIEWED_MOMENTS))
        if due:
            cubes = self.parted[:due, 0]
            rows = np.cumsum(self._stored.cubes.rows[cubes])
            count = 1 + int(np.searchsorted(rows, max(THINNED_ROWS_PER_FRAME, rows[-1] // MAX_UNVIEWED_MOMENTS)))
            self.parted = self.parted[count:] if count < due else self.parted[due:]
            self._thin(cubes[:count])

    def _thin(self, cubes: Rows) -> None:
        if not len(cubes):
            return
        cubes = np.array(cubes)  # of one layout, so that the kernel is compiled once
        self._stored.load(cubes)
        before = self._stored.cubes.rows[cubes]
        moved = np.empty(int(before.sum()), np.int64)
        words, cell_rows = words_of(self._stored.memory.rows), rows_of_a_cube()
        count = kernel.thin(
            cubes, self.first_frame or 0, self._stored.cubes, words, self._stored.points, *cell_rows, moved
        )
        for cube, rows in zip(cubes.tolist(), before.tolist(), strict=True):
            self._stored.memory.shrink(cube, rows)
        self._stored.unindexed[cubes] = True
        if count:
            self._stored.owned_blocks.add_rows(self._stored.owner[moved[:count]], moved[:count] >> BLOCK_BITS)


def split_rows(rows: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return rows (N,) of type ROW of one cube expanded to one row (M,) for each voxel that they represent."""
    bits = np.unpackbits(np.where(rows["mark"] > 0, rows["mark"], 1)[:, None], axis=1, bitorder="little")
    index, eighth = np.nonzero(bits)
    split, shared = rows[index], rows["mark"][index] > 0
    # The same layout as in `kernels.levels`.
    layer = (eighth[shared, None] >> np.array([2, 1, 0])) & 1
    split["place"][shared] = (((split["place"][shared] >> (8 * layer)) & 255) << 8) | 128
    split["voxel"][shared] |= (layer << np.array([2 * CUBE_BITS, CUBE_BITS, 0])).sum(1).astype(np.uint16)
    split["mark"] = 0
    return split
