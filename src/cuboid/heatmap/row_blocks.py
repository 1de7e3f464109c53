"""Runs of rows of the map: which were seen of late, which hold an object's points. All others need no look.

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
    """Keeps the last frame of each block, and the blocks of each object; asks for no row that is out of view.

    Parameters
    ----------
    capacity : int
        Rows of the map.
    """

    def __init__(self, capacity: int) -> None:
        # The last one stands for pixels without a row, -1.
        self._seen: npt.NDArray[np.int32] = np.full((capacity >> BLOCK_BITS) + 1, -1, np.int32)
        self._of: dict[int, set[int]] = {}

    def see(self, slots: npt.NDArray[np.int32], frame: int) -> None:
        """Take in the rows of a frame's pixels, -1 none."""
        self._seen[slots.ravel() >> BLOCK_BITS] = frame

    def give(self, rows: npt.NDArray[np.int64], number: int) -> None:
        """Let rows belong to an object."""
        self._of.setdefault(number, set()).update(np.unique(rows >> BLOCK_BITS).tolist())

    def give_block(self, number: int, block: int) -> None:
        """Let an object have rows of a block."""
        self._of.setdefault(number, set()).add(block)

    def pass_on(self, gone: int, kept: int) -> None:
        """Let what belonged to one object belong to another."""
        self._of.setdefault(kept, set()).update(self._of.pop(gone, set()))

    def release(self, number: int) -> None:
        """Let an object have no rows."""
        self._of.pop(number, None)

    def seen_since(self, frame: int) -> Blocks:
        """Return the blocks with rows seen since a frame, ascending."""
        return np.flatnonzero(self._seen[:-1] >= frame)

    def of(self, numbers: list[int]) -> Blocks:
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
        rows = (self.of(list(numbers))[:, None] * BLOCK_ROWS + np.arange(BLOCK_ROWS)).ravel()
        rows = rows[: np.searchsorted(rows, len(owner))]
        wanted = np.zeros(max(numbers, default=0) + 1, bool)
        wanted[list(numbers)] = True
        held = owner[rows]
        return np.asarray(rows[(held > 0) & (held < len(wanted)) & wanted[np.clip(held, 0, len(wanted) - 1)]], np.int64)

    def rebuild(self, owner: npt.NDArray[np.int32], last_frame: npt.NDArray[np.int32]) -> None:
        """Begin anew after the map's rows in use, with these owners and last frames (N,), were renumbered."""
        used = -(-len(owner) // BLOCK_ROWS)
        if used:
            self._seen[:used] = np.maximum.reduceat(last_frame, np.arange(used) * BLOCK_ROWS)
        rows = np.flatnonzero(owner > 0)
        numbers, blocks = owner[rows], rows >> BLOCK_BITS
        runs = np.flatnonzero((np.diff(numbers, prepend=-1) != 0) | (np.diff(blocks, prepend=-1) != 0))
        for number, block in zip(numbers[runs].tolist(), blocks[runs].tolist(), strict=True):
            self._of.setdefault(number, set()).add(block)
