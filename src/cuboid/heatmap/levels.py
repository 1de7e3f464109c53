"""Levels of detail of the map: background that is out of view is kept in cells of two voxels a side."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float32Array
from cuboid.core.tolerances import DRIFT_M
from cuboid.heatmap.kernels import levels as kernel
from cuboid.heatmap.kernels import lookup
from cuboid.heatmap.kernels.cubes import BLOCK_BITS, CUBE_BITS
from cuboid.heatmap.stored_points import Rows, StoredPoints, rows_of_a_cube, words_of

# A camera that has gone this far, metres, has left what it saw behind: an arm's length.
LEFT_BEHIND_M = 1.2
# Moments (see `StoredPoints`) after which what is out of view is kept in cells: the camera has gone by an arm's length,
# or turned by 46 degrees. Hands that shake, or look aside and back, part none.
MAX_UNVIEWED_MOMENTS = round(LEFT_BEHIND_M / DRIFT_M)
# Rows that are thinned in a frame, up to the next whole cube; more where the backlog would not be done within as many
# frames as moments.
THINNED_ROWS_PER_FRAME = 1024


class LevelledPoints(StoredPoints):
    """Points of which those without an owner share rows, cell by cell, in cubes that were out of view for a while.

    Which voxels hold a point, whether more than one frame saw it, and whether it is hot, is known of each voxel still;
    place (of each layer of the cell), color and numbers of frames are means. Voxels have rows of their own again as
    soon as their cube is accessed. All of that follows from the frames alone, not from what is in memory.
    """

    def __init__(self, voxel_m: float, memory_mb: float) -> None:
        super().__init__(voxel_m, memory_mb)
        # First frame of this visit.
        self._first_frame: int | None = None

    def begin_visit(self, most_hits: int) -> None:
        """Let what was seen so far count as no more than this many sightings; see `StoredPoints.begin_visit`."""
        self._first_frame = None
        self._parted = self._parted[:0]
        super().begin_visit(most_hits)

    def thin_all(self) -> None:
        """Thin all cubes: the visit has ended."""
        self._thin(self._parted[:, 0])
        self._parted = self._parted[:0]

    def _schedule_thinning(self, seen: Rows) -> None:
        """Mark cubes (N,) as viewed by a frame, and thin those that have been out of view for long enough."""
        self._mark_viewed(seen)
        due = int(np.searchsorted(self._parted[:, 1], self._moments - MAX_UNVIEWED_MOMENTS))
        if due:
            cubes = self._parted[:due, 0]
            rows = np.cumsum(self._cubes.rows[cubes])
            some = 1 + int(np.searchsorted(rows, max(THINNED_ROWS_PER_FRAME, rows[-1] // MAX_UNVIEWED_MOMENTS)))
            self._parted = self._parted[some:] if some < due else self._parted[due:]
            self._thin(cubes[:some])

    def _thin(self, cubes: Rows) -> None:
        if not len(cubes):
            return
        self._load_rows(cubes)
        before = self._cubes.rows[cubes]
        moved = np.empty(int(before.sum()), np.int64)
        words, cell_rows = words_of(self._row_memory.rows), rows_of_a_cube()
        count = kernel.thin(cubes, self._first_frame or 0, self._cubes, words, self._points, *cell_rows, moved)
        for cube, rows in zip(cubes.tolist(), before.tolist(), strict=True):
            self._row_memory.shrink(cube, rows)
        self._unindexed[cubes] = True
        if count:
            self._blocks.add_rows(self.owner[moved[:count]], moved[:count] >> BLOCK_BITS)

    def spread(self, rows: Rows) -> tuple[Float32Array, Rows]:
        """Return the world points (M, 3) of all voxels that rows (N,) stand for, and which of the rows each is of."""
        marks = self._points.mark[rows]
        bits = np.unpackbits(np.where(marks > 0, marks, 1)[:, None], axis=1, bitorder="little")
        of, eighth = np.nonzero(bits)
        return self._places(rows[of], eighth.astype(np.uint8)), of

    def xyz(self, rows: Rows) -> Float32Array:
        """Return world points (N, 3) of these rows, which stand for one voxel each."""
        return self._places(rows, np.zeros(len(rows), np.uint8))

    def _places(self, rows: Rows, eighths: npt.NDArray[np.uint8]) -> Float32Array:
        xyz = np.empty((len(rows), 3), np.float32)
        lookup.places(rows, eighths, self.voxel_m, self._cubes, self._points, self._anchors.motions, xyz)
        return xyz


def split_rows(rows: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return rows (N,) of type ROW of one cube as a row (M,) for each voxel that they stand for."""
    bits = np.unpackbits(np.where(rows["mark"] > 0, rows["mark"], 1)[:, None], axis=1, bitorder="little")
    of, eighth = np.nonzero(bits)
    every, shared = rows[of], rows["mark"][of] > 0
    # As `kernels.levels` has it.
    layer = (eighth[shared, None] >> np.array([2, 1, 0])) & 1
    every["place"][shared] = (((every["place"][shared] >> (8 * layer)) & 255) << 8) | 128
    every["voxel"][shared] |= (layer << np.array([2 * CUBE_BITS, CUBE_BITS, 0])).sum(1).astype(np.uint16)
    every["mark"] = 0
    return every
