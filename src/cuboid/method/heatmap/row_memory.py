"""The rows of the map, in memory or evicted to disk.

The largest possible amount of memory is reserved; the system provides it page by page when it is written.
"""

from __future__ import annotations

import mmap
import sys
import tempfile
from collections.abc import Sequence
from io import RawIOBase
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.errors import OutputError
from cuboid.method.heatmap.kernels.cubes import BLOCK_ROWS, ROW, TABLE_BITS, Cubes, Points, columns_of, empty_cubes

# Largest and smallest number of blocks to reserve; if a reservation fails, the number is halved. Windows counts
# reserved memory as used: 0.6 GB of rows and 2.1 GB of tables.
MAX_BLOCKS, MIN_BLOCKS = 1 << (14 if sys.platform == "win32" else 18), 1 << 8
BLOCK_BYTES = BLOCK_ROWS * ROW.itemsize
_STATM = Path("/proc/self/statm")
# Linux flag for memory that is only reserved; Python has a name for it since 3.13.
_NO_RESERVE = 0x4000 if sys.platform == "linux" else 0


class RowMemory:
    """Rows, and the tables that find them, at fixed addresses; freed parts read as zeros again.

    Attributes
    ----------
    rows : (N,) of type ROW
    points : Points
        The columns of the rows, as views.
    cubes : Cubes
    """

    def __init__(self) -> None:
        blocks = MAX_BLOCKS
        while True:
            try:
                self._rows, self._index = _reserved(blocks * BLOCK_BYTES), _reserved(blocks << (TABLE_BITS + 1))
                break
            except (OSError, ValueError):
                if blocks <= MIN_BLOCKS:
                    raise MemoryError("no memory can be reserved for the map") from None
                blocks >>= 1
        self.rows: npt.NDArray[Any] = np.frombuffer(self._rows, ROW)
        self.points: Points = columns_of(self.rows)
        self.cubes: Cubes = empty_cubes(blocks, np.frombuffer(self._index, np.uint16))

    def block(self, block: int) -> npt.NDArray[Any]:
        """Return the used rows of a block, as a view."""
        first = block * BLOCK_ROWS
        return self.rows[first : first + self.rows_in(block)]

    def rows_in(self, block: int) -> int:
        """Return the number of used rows of a block."""
        count = int(self.cubes.rows[self.cubes.cube_of[block]]) - int(self.cubes.turn[block]) * BLOCK_ROWS
        return min(max(count, 0), BLOCK_ROWS)

    def blocks_of(self, cube: int) -> list[int]:
        """Return the blocks of a cube, ascending."""
        blocks = self.cubes.blocks[cube]
        return [int(block) for block in blocks[blocks > 0]]

    def free(self, cube: int) -> None:
        """Release the memory of a cube."""
        for block in self.blocks_of(cube):
            _discard_pages(self._rows, block * BLOCK_BYTES, BLOCK_BYTES)
        if self.cubes.bits[cube]:
            _discard_pages(self._index, cube << (TABLE_BITS + 1), 2 << int(self.cubes.bits[cube]))
            self.cubes.bits[cube] = 0

    def shrink(self, cube: int, before: int) -> None:
        """Release the memory of a cube's table, and of rows that it no longer uses; it had `before` rows."""
        for block in self.blocks_of(cube):
            used_now = -(-self.rows_in(block) * ROW.itemsize // mmap.PAGESIZE) * mmap.PAGESIZE
            used_before = min(max(before - int(self.cubes.turn[block]) * BLOCK_ROWS, 0), BLOCK_ROWS) * ROW.itemsize
            if used_now < used_before:
                _discard_pages(self._rows, block * BLOCK_BYTES + used_now, BLOCK_BYTES - used_now)
        if self.cubes.bits[cube]:
            _discard_pages(self._index, cube << (TABLE_BITS + 1), 2 << int(self.cubes.bits[cube]))
            self.cubes.bits[cube] = 0

    def bytes_of(self, cubes: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Return the memory of cubes (N,) when they are loaded, bytes: pages of rows, and tables."""
        used = self.cubes.rows[cubes].astype(np.int64)
        whole, rest = used // BLOCK_ROWS, used % BLOCK_ROWS
        rows = whole * BLOCK_BYTES + -(-rest * ROW.itemsize // mmap.PAGESIZE) * mmap.PAGESIZE
        bits = self.cubes.bits[cubes].astype(np.int64)
        return np.asarray(rows + np.where(bits > 0, 2 << bits, 0))


def resident_mb() -> float | None:
    """Return the resident memory of this process, in units of 2**20 bytes; None if the system does not report it."""
    try:
        return int(_STATM.read_bytes().split()[1]) * mmap.PAGESIZE / 2**20
    except OSError:
        return None


if sys.platform == "win32":

    def _reserved(size: int) -> mmap.mmap:
        """Return zeroed memory."""
        return mmap.mmap(-1, size)

else:

    def _reserved(size: int) -> mmap.mmap:
        """Return zeroed memory that the system provides page by page."""
        memory = mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | _NO_RESERVE)
        if hasattr(mmap, "MADV_NOHUGEPAGE"):
            memory.madvise(mmap.MADV_NOHUGEPAGE)
        return memory


def _discard_pages(memory: mmap.mmap, first: int, size: int) -> None:
    if sys.platform == "linux":
        memory.madvise(mmap.MADV_DONTNEED, first, size)
    else:  # elsewhere discarded pages may keep their content
        np.frombuffer(memory, np.uint8)[first : first + size] = 0


Rows = npt.NDArray[Any]


class BlockStore(Protocol):
    """Stores blocks of rows by number."""

    def takes(self, blocks: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """Return which blocks (N,) may be stored now."""

    def put(self, block: int, rows: Rows) -> None:
        """Store the rows (N,) of a block.

        Raises
        ------
        OutputError
            If they cannot be written.
        """

    def get(self, blocks: Sequence[int], counts: Sequence[int]) -> list[Rows]:
        """Return the rows of blocks, with `counts` rows each.

        Raises
        ------
        InputError
            If they are damaged.
        """


class TemporaryBlockStore:
    """A temporary file that is removed when the process ends."""

    def __init__(self) -> None:
        self._file: RawIOBase | None = None

    def takes(self, blocks: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """Return which blocks (N,) may be stored now: all."""
        return np.ones(len(blocks), bool)

    def put(self, block: int, rows: Rows) -> None:
        """Store the rows (N,) of a block; raises OutputError if the disk is full."""
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
        """Return the rows of blocks, with `counts` rows each."""
        return [self._read(block, count) for block, count in zip(blocks, counts, strict=True)]

    def _read(self, block: int, count: int) -> Rows:
        assert self._file is not None, "only blocks that were put are read"
        self._file.seek(block * BLOCK_BYTES)
        return np.frombuffer(self._file.read(count * ROW.itemsize) or b"", ROW)

    def __del__(self) -> None:
        if self._file is not None:
            self._file.close()
