"""Backing store for evicted blocks of the map."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from io import RawIOBase
from typing import Any, Protocol, cast

import numpy as np
import numpy.typing as npt

from cuboid.core.errors import OutputError
from cuboid.heatmap.kernels.cubes import ROW
from cuboid.heatmap.row_memory import BLOCK_BYTES

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
        """Return the rows of blocks that have this many.

        Raises
        ------
        InputError
            They are damaged.
        """


class TemporaryBlockStore:
    """A temporary file, which is gone with the process."""

    def __init__(self) -> None:
        self._file: RawIOBase | None = None

    def takes(self, blocks: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """Tell which blocks (N,) may be put here now: all."""
        return np.ones(len(blocks), bool)

    def put(self, block: int, rows: Rows) -> None:
        """Keep the rows (N,) of a block; raises OutputError where the disk is full."""
        try:
            if self._file is None:
                file = tempfile.TemporaryFile(prefix="cuboid-map-", buffering=0)  # noqa: SIM115 as long as the map
                self._file = cast(RawIOBase, file)
            data = memoryview(rows.tobytes())
            self._file.seek(block * BLOCK_BYTES)
            while len(data):
                data = data[self._file.write(data) :]
        except OSError as error:
            raise OutputError(f"{tempfile.gettempdir()}: parts of the map cannot be evicted: {error}") from error

    def get(self, blocks: Sequence[int], counts: Sequence[int]) -> list[Rows]:
        """Return the rows of blocks that have this many."""
        return [self._read(block, count) for block, count in zip(blocks, counts, strict=True)]

    def _read(self, block: int, count: int) -> Rows:
        assert self._file is not None, "only blocks that were put are read"
        self._file.seek(block * BLOCK_BYTES)
        return np.frombuffer(self._file.read(count * ROW.itemsize) or b"", ROW)

    def __del__(self) -> None:
        if self._file is not None:
            self._file.close()
