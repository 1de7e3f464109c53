"""Runs of rows of the map that hold an object's points. All others need no look.

Rows are numbered as their points come into view, so that a few runs hold what is in one place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

# Rows of a block, as bits of their number: 1,024 rows are a hand's breadth of surface.
BLOCK_BITS = 10
BLOCK_ROWS = 1 << BLOCK_BITS

Blocks = npt.NDArray[np.int64]


class RowBlocks:
    """Keeps the blocks of each object."""

    def __init__(self) -> None:
        self._of: dict[int, set[int]] = {}

    def give_block(self, number: int, block: int) -> None:
        """Let an object have rows of a block."""
        self._of.setdefault(number, set()).add(block)

    def pass_on(self, gone: int, kept: int) -> None:
        """Let what belonged to one object belong to another."""
        self._of.setdefault(kept, set()).update(self._of.pop(gone, set()))

    def release(self, number: int) -> None:
        """Let an object have no rows."""
        self._of.pop(number, None)

    def of(self, numbers: Sequence[int]) -> Blocks:
        """Return the blocks with rows of any of some objects, ascending."""
        return np.array(sorted(set().union(*(self._of.get(number, set()) for number in numbers))), np.int64)

    def rows_of(self, numbers: Sequence[int], owner: npt.NDArray[np.int32]) -> npt.NDArray[np.int64]:
        """Return the rows of some objects, ascending.

        Parameters
        ----------
        numbers : sequence of int
        owner : (N,) int32
            Of the map's rows in use.
        """
        rows = (self.of(numbers)[:, None] * BLOCK_ROWS + np.arange(BLOCK_ROWS)).ravel()
        rows = rows[: np.searchsorted(rows, len(owner))]
        wanted = np.zeros(max(numbers, default=0) + 1, bool)
        wanted[list(numbers)] = True
        held = owner[rows]
        return np.asarray(rows[(held > 0) & (held < len(wanted)) & wanted[np.clip(held, 0, len(wanted) - 1)]], np.int64)

    def rebuild(self, owner: npt.NDArray[np.int32]) -> None:
        """Begin anew after the map's rows in use, with these owners (N,), were renumbered."""
        rows = np.flatnonzero(owner > 0)
        numbers, blocks = owner[rows], rows >> BLOCK_BITS
        runs = np.flatnonzero((np.diff(numbers, prepend=-1) != 0) | (np.diff(blocks, prepend=-1) != 0))
        for number, block in zip(numbers[runs].tolist(), blocks[runs].tolist(), strict=True):
            self._of.setdefault(number, set()).add(block)
