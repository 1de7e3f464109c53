"""The blocks of rows that contain points of each object; other blocks need not be searched."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.state import Record

Blocks = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class RowBlocksState(Record):
    """State of `RowBlocks`.

    Attributes
    ----------
    of : dict of int to tuple of int
        Blocks of each object, ascending, by the number of the object.
    """

    of: dict[int, tuple[int, ...]]


class RowBlocks:
    """Stores the blocks of each object; a listed block without rows of the object does no harm."""

    NOT_SAVED: frozenset[str] = frozenset()

    def __init__(self) -> None:
        self._of: dict[int, set[int]] = {}

    def state(self) -> RowBlocksState:
        """Return the current state; later updates do not change it."""
        return RowBlocksState({number: tuple(sorted(blocks)) for number, blocks in self._of.items()})

    @classmethod
    def from_state(cls, state: RowBlocksState) -> RowBlocks:
        """Return the blocks of a state."""
        blocks = cls()
        blocks._of = {number: set(numbers) for number, numbers in state.of.items()}
        return blocks

    def add(self, numbers: npt.NDArray[np.int64], blocks: Blocks) -> None:
        """Record that objects (N,), ascending, have rows in blocks (N,)."""
        bounds = [*np.flatnonzero(np.diff(numbers, prepend=-1)).tolist(), len(numbers)]
        for begin, end in pairwise(bounds):
            self._of.setdefault(int(numbers[begin]), set()).update(blocks[begin:end].tolist())

    def add_rows(self, owner: npt.NDArray[np.int32], blocks: Blocks) -> None:
        """Record that the owners of rows (N,), 0: none, have rows in the blocks (N,) of these rows."""
        owned = owner > 0
        pairs = np.unique((owner[owned].astype(np.int64) << 32) | blocks[owned])
        self.add(pairs >> 32, pairs & 0xFFFFFFFF)

    def transfer(self, gone: int, kept: int) -> None:
        """Transfer the blocks of one object to another."""
        self._of.setdefault(kept, set()).update(self._of.pop(gone, set()))

    def release(self, numbers: Iterable[int]) -> Blocks:
        """Remove objects; return the blocks in which they may have had rows, ascending."""
        return np.array(sorted(set().union(*(self._of.pop(number, ()) for number in numbers))), np.int64)

    def of(self, number: int) -> Blocks:
        """Return the blocks of an object, ascending."""
        return np.array(sorted(self._of.get(number, ())), np.int64)

    def numbers(self) -> list[int]:
        """Return the objects that have blocks, ascending."""
        return sorted(self._of)
