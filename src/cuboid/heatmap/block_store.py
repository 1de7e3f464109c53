"""Backing store for evicted blocks of the map."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from cuboid.errors import OutputError
from cuboid.heatmap.row_memory import BLOCK_BYTES
from cuboid.kernels.cubes import ROW

Rows = npt.NDArray[Any]


class BlockStore(Protocol):
    """Keeps blocks of rows by number."""

    def takes(self, blocks: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """Tell which blocks (N,) may be put here now."""

    def put(self, block: int, rows: Rows) -> None:
        """Keep the rows (N,) of a block.

        Raises
        ------
        OutputError
            They cannot be written.
        """

    def get(self, blocks: Sequence[int], counts: Sequence[int]) -> list[Rows]:
        """Return the rows of blocks that have so many.

        Raises
        ------
        InputError
            They are damaged.
        """


class TemporaryBlockStore:
    """A file that has no name and is gone with the process."""

    def __init__(self) -> None:
        self._file: int | None = None

    def takes(self, blocks: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """Tell which blocks (N,) may be put here now: all."""
        return np.ones(len(blocks), bool)

    def put(self, block: int, rows: Rows) -> None:
        """Keep the rows (N,) of a block; raises OutputError where the disk is full."""
        try:
            if self._file is None:
                self._file, name = tempfile.mkstemp(prefix="cuboid-map-")
                os.unlink(name)
            data, at = memoryview(rows.tobytes()), block * BLOCK_BYTES
            while len(data):
                written = os.pwrite(self._file, data, at)
                data, at = data[written:], at + written
        except OSError as error:
            raise OutputError(f"{tempfile.gettempdir()}: parts of the map cannot be evicted: {error}") from error

    def get(self, blocks: Sequence[int], counts: Sequence[int]) -> list[Rows]:
        """Return the rows of blocks that have so many."""
        assert self._file is not None or not blocks
        return [
            np.frombuffer(os.pread(self._file or 0, count * ROW.itemsize, block * BLOCK_BYTES), ROW)
            for block, count in zip(blocks, counts, strict=True)
        ]

    def __del__(self) -> None:
        if self._file is not None:
            os.close(self._file)
