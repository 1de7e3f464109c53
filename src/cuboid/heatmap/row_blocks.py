"""Runs of rows of the map that hold an object's points. All others need no look.

Rows are numbered as their points come into view, so that a few runs hold what is in one place.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cuboid.kernels import voxels as kernel

# Rows of a block, as bits of their number: 1,024 rows are a hand's breadth of surface.
BLOCK_BITS = 10
BLOCK_ROWS = 1 << BLOCK_BITS

Blocks = npt.NDArray[np.int64]


class RowBlocks:
    """Keeps the blocks of each object."""

    def __init__(self) -> None:
        self._of: dict[int, set[int]] = {}

    def give(self, numbers: npt.NDArray[np.int64], blocks: Blocks) -> None:
        """Let objects (N,), ascending, have rows of blocks (N,)."""
        bounds = [*np.flatnonzero(np.diff(numbers, prepend=-1)).tolist(), len(numbers)]
        for begin, end in pairwise(bounds):
            self._of.setdefault(int(numbers[begin]), set()).update(blocks[begin:end].tolist())

    def pass_on(self, gone: int, kept: int) -> None:
        """Let what belonged to one object belong to another."""
        self._of.setdefault(kept, set()).update(self._of.pop(gone, set()))

    def release(self, number: int) -> None:
        """Let an object have no rows."""
        self._of.pop(number, None)

    def rows_of(self, number: int, owner: npt.NDArray[np.int32]) -> npt.NDArray[np.int64]:
        """Return the rows of an object, ascending.

        Parameters
        ----------
        number : int
        owner : (N,) int32
            Of the map's rows in use.
        """
        blocks = np.array(sorted(self._of.get(number, ())), np.int64)
        rows = np.empty(len(blocks) * BLOCK_ROWS, np.int64)
        return rows[: kernel.rows_of(number, blocks, BLOCK_ROWS, owner, rows)]

    def rebuild(self, owner: npt.NDArray[np.int32]) -> None:
        """Begin anew after the map's rows in use, with these owners (N,), were renumbered."""
        rows = np.flatnonzero(owner > 0)
        numbers, blocks = owner[rows], rows >> BLOCK_BITS
        pairs = np.unique((numbers.astype(np.int64) << 32) | blocks)
        self.give(pairs >> 32, pairs & 0xFFFFFFFF)
