"""The points of the map in memory: rows in blocks, those of each object, and eviction of what is out of view."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.heatmap.anchors import Anchors
from cuboid.heatmap.block_store import BlockStore, TemporaryBlockStore
from cuboid.heatmap.kernels import cubes as kernel_cubes
from cuboid.heatmap.kernels import levels, owners
from cuboid.heatmap.kernels import voxels as kernel
from cuboid.heatmap.kernels.cubes import BLOCK_BITS, BLOCK_ROWS, MAX_BLOCKS, ROW, Points, columns_of
from cuboid.heatmap.row_blocks import RowBlocks
from cuboid.heatmap.row_memory import RowMemory, resident_mb

Rows = npt.NDArray[np.int64]

# A cube is packed when this fraction of its rows is dead, and this many.
DEAD_FRACTION, MIN_DEAD = 0.125, 32
# Eviction frees this much more memory than is missing, in units of 2**20 bytes, so that it does not recur each frame.
SPARE_MB = 8.0


class StoredPoints:
    """Rows of points in cubes of voxels, and the object that each belongs to.

    Cubes that are out of view are evicted where memory is short, and loaded again when they are accessed; no result
    depends on it. Points with a pending motion of their keyframe (`Anchors`) keep their place until their region is
    accessed. Rows of points keep their numbers while their cube is not packed, which happens between frames, and where
    a region with pending motions is accessed.

    Parameters
    ----------
    voxel_m : float
    memory_mb : float
        Memory of the process, in units of 2**20 bytes, beyond which cubes that are out of view are evicted.

    Attributes
    ----------
    before_visit : callable or None
        Called with rows of points that are as they were before the visit, when these are to be made ready for it.
    """

    def __init__(self, voxel_m: float, memory_mb: float) -> None:
        self.voxel_m = voxel_m
        self.memory_mb = memory_mb
        self.before_visit: Callable[[Rows], None] | None = None
        self._visit, self._most_hits = 0, 0
        # How many carving passes there were; how many moments there were at which the camera had moved since the one
        # before; and the cubes (N, 2) of which each voxel has a row of its own since it was accessed, with that moment,
        # those out of view for longest first.
        self._looks, self._moments, self._parted = 0, 0, np.zeros((0, 2), np.int64)
        self._blocks, self._anchors = RowBlocks(), Anchors()
        self._begin(TemporaryBlockStore())

    def _begin(self, block_store: BlockStore) -> None:
        self._row_memory, self._block_store = RowMemory(), block_store
        self._points, self._cubes = (
            self._row_memory.points,
            self._row_memory.cubes._replace(pending=self._anchors.pending),
        )
        self._seen = np.zeros(len(self._cubes.key), np.int64)
        self._marks = np.zeros(len(self._cubes.key), bool)
        # Of each cube, whether its rows are in memory without an index; the last carving pass that had it in
        # view; of each block, the visit that it was made ready for.
        self._unindexed = np.zeros(len(self._cubes.key), bool)
        self._last_viewed = np.zeros(len(self._cubes.key), np.int32)
        self._ready = np.zeros(len(self._cubes.cube_of), np.uint16)

    @property
    def owner(self) -> npt.NDArray[np.int32]:
        """Number of the object that each row belongs to, 0 none; written by this class alone."""
        return self._points.owner

    @property
    def hits(self) -> npt.NDArray[np.uint16]:
        """Frames that saw each row."""
        return self._points.hits

    def keyframe(self, rows: Rows) -> npt.NDArray[np.uint16]:
        """Return the keyframe that the last frame to see each row (N,) is anchored to."""
        return self._anchors.keyframes(self._points.anchor[rows])

    def keyframe_of(self, rows: Rows) -> int:
        """Return the keyframe that most of some rows (N,) are anchored to, of equals the first; 0 if there are none."""
        return int(np.bincount(self.keyframe(rows), minlength=1).argmax())

    @property
    def revisited(self) -> bool:
        """Whether something may be known from before this visit."""
        return self._visit > 0

    @property
    def blocks(self) -> int:
        """One more than the highest number of a block; no block is 0."""
        return int(self._cubes.used[1])

    def take_changed(self) -> Rows:
        """Return the blocks of rows in which any has changed since this was asked last, ascending."""
        changed = np.flatnonzero(self._cubes.changed[: self.blocks])
        self._cubes.changed[:] = False
        return changed

    def has_changed(self, blocks: Rows) -> npt.NDArray[np.bool_]:
        """Tell which blocks (N,) have changed since `take_changed`."""
        return self._cubes.changed[blocks]

    def copies(self, blocks: Rows) -> list[tuple[int, int, npt.NDArray[Any]]]:
        """Return of each block (N,) the key of its cube, the visit that it is ready for, and a copy of its rows."""
        cubes = self._cubes.cube_of[blocks].astype(np.int64)
        self._load_rows(cubes)
        keys, visits = self._cubes.key[cubes].tolist(), self._ready[blocks].tolist()
        # As bytes: NumPy copies records field by field.
        copied = self._row_memory.rows.view(np.uint8).reshape(-1, BLOCK_ROWS * ROW.itemsize)[blocks].view(ROW)
        rows = [copied[k, : self._row_memory.rows_in(block)] for k, block in enumerate(blocks.tolist())]
        return list(zip(keys, visits, rows, strict=True))

    def restore(self, blocks: Iterable[tuple[int, int, int, int, int]], block_store: BlockStore) -> None:
        """Restore a map from `from_state` whose blocks are in a block store.

        Parameters
        ----------
        blocks : iterable of (int, int, int, int, int)
            Number, key of the cube, rows, living ones among them, and visit of each, ascending by number.
        block_store : BlockStore
        """
        self._begin(block_store)
        cubes = self._cubes
        for block, key, rows, living, visit in blocks:
            cube = kernel_cubes.make_cube(np.int64(key), cubes)
            turn = np.count_nonzero(cubes.blocks[cube])
            cubes.blocks[cube, turn] = block
            cubes.cube_of[block], cubes.turn[block] = cube, turn
            cubes.rows[cube] += rows
            cubes.dead[cube] += rows - living
            cubes.bits[cube] = 0
            cubes.used[1] = block + 1
            self._ready[block] = visit
        if self._anchors.cubes > cubes.used[0]:
            raise ValueError(f"points are in {self._anchors.cubes} cubes, expected {cubes.used[0]}")

    def _begin_anew(self) -> None:
        self._begin(
            self._block_store if not isinstance(self._block_store, TemporaryBlockStore) else TemporaryBlockStore()
        )
        self._blocks, self._parted = RowBlocks(), self._parted[:0]

    def use_store(self, block_store: BlockStore) -> None:
        """Evict to another block store from now on; all blocks are in memory."""
        self._block_store = block_store

    def refill(self, keys: npt.NDArray[np.int64], rows: npt.NDArray[Any]) -> None:
        """Have these points and no others.

        Parameters
        ----------
        keys : (N,) int64
            Of their cubes.
        rows : (N,) of type ROW
            Each of another voxel.
        """
        self._begin_anew()
        place = np.empty(len(keys), np.int64)
        kernel_cubes.allocate_rows(keys, rows["voxel"], rows["anchor"], self._cubes, self._points, place)
        there = place >= 0
        self._row_memory.rows[place[there]] = rows[there]
        self._cubes.changed[1 : self.blocks] = True
        self._ready[:] = self._visit
        self._blocks.add_rows(rows["owner"][there], place[there] >> BLOCK_BITS)
        self._find_anchors()
        self._cubes.index_stale[self._anchors.pending_cubes[0]] = True

    def begin_visit(self, most_hits: int) -> None:
        """Let what was seen so far count as no more than this many sightings: the world may have changed since.

        What is not in memory is made ready when it comes back.
        """
        self._most_hits = most_hits
        self._visit += 1
        self._ready_for_visit(np.flatnonzero(self._in_memory()))

    def _ready_for_visit(self, cubes: Rows) -> None:
        all_of = (block for cube in cubes.tolist() for block in self._row_memory.blocks_of(cube))
        blocks = [block for block in all_of if self._ready[block] != self._visit]
        if blocks and self.before_visit is not None:
            some = np.array(blocks)[~self._fine(self._cubes.cube_of[blocks])]
            rows = (some[:, None] * BLOCK_ROWS + np.arange(BLOCK_ROWS)).ravel()
            self.before_visit(rows[self._points.weight[rows] > 0])
        for block in blocks:
            part = self._row_memory.block(block)
            hits = part["hits"]
            if (hits > self._most_hits).any() or part["passes"].any():
                self._cubes.changed[block] = True
            part["weight"] *= (np.minimum(hits, self._most_hits) / np.maximum(hits, 1)).astype(np.float32)
            np.minimum(hits, self._most_hits, out=hits)
            part["passes"] = 0
            self._ready[block] = self._visit

    def viewed_since(self, keys: npt.NDArray[np.int64], since: int) -> npt.NDArray[np.bool_]:
        """Tell which cubes (N,), by their keys, were in view from a carving pass on.

        With 0, those of which this visit may have changed anything, in earlier processes too.
        """
        used = int(self._cubes.used[0])
        seen = self._last_viewed[:used] >= since
        if since == 0:
            seen = np.zeros(used, bool)
            seen[self._cubes.cube_of[np.flatnonzero(self._ready[: self.blocks] == self._visit)]] = True
        cubes = np.empty(len(keys), np.int64)
        kernel_cubes.cubes_at(keys, self._cubes, cubes)
        return np.asarray((cubes >= 0) & seen[np.maximum(cubes, 0)]) if used else np.zeros(len(keys), bool)

    def _fine(self, cubes: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
        """Tell which cubes (N,) are fine ones: their voxels have half the edge; see `FineVoxels`."""
        return np.asarray(self._cubes.key[cubes] < 0)

    def _in_memory(self) -> npt.NDArray[np.bool_]:
        """Tell of each cube whether its rows are in memory."""
        used = int(self._cubes.used[0])
        return np.asarray((self._cubes.bits[:used] > 0) | self._unindexed[:used])

    def _load_rows(self, cubes: Rows) -> None:
        """Load the rows of cubes (N,) as they are: some may stand for several voxels."""
        away = cubes[(self._cubes.bits[cubes] == 0) & ~self._unindexed[cubes]]
        if not len(away):
            return
        away = np.unique(away)
        blocks = [
            (block, self._row_memory.rows_in(block)) for cube in away for block in self._row_memory.blocks_of(cube)
        ]
        blocks = [(block, count) for block, count in blocks if count]
        found = self._block_store.get([block for block, _ in blocks], [count for _, count in blocks])
        for (block, _), rows in zip(blocks, found, strict=True):
            self._row_memory.block(block)[:] = rows
        self._unindexed[away] = True
        self._ready_for_visit(away)

    def _load(self, cubes: Rows) -> None:
        """Load cubes (N,), with a row of its own for each voxel, and an index of these."""
        if self._cubes.bits[cubes].all():
            return
        bare = np.unique(cubes[self._cubes.bits[cubes] == 0])
        self._load_rows(bare)
        begun, parted = self.blocks, np.empty(len(bare), bool)
        levels.split_cells(bare, self._cubes, words_of(self._row_memory.rows), self._points, *rows_of_a_cube(), parted)
        self._ready[begun : self.blocks] = self._visit
        self._unindexed[bare] = False
        self._mark_viewed(bare[parted])

    def _mark_viewed(self, cubes: Rows) -> None:
        """Note that cubes (N,), each named once, are accessed now."""
        cubes = cubes[~self._fine(cubes)]
        self._marks[cubes] = True
        others = self._parted[~self._marks[self._parted[:, 0]]]
        self._marks[cubes] = False
        now = np.empty((len(cubes), 2), np.int64)
        now[:, 0], now[:, 1] = cubes, self._moments
        self._parted = np.concatenate([others, now])

    def _load_all(self) -> None:
        self._load(np.arange(self._cubes.used[0]))

    def evict(self, keep: Rows | None = None) -> None:
        """Evict cubes where memory is short, those out of view for longest first; not those to keep."""
        held = resident_mb() if self.memory_mb < float("inf") else None
        if held is None or held <= self.memory_mb:
            return
        cubes, there = self._cubes, self._in_memory()
        if keep is not None:
            there[keep] = False
        waiting = np.flatnonzero(there)
        waiting = waiting[np.argsort(self._last_viewed[waiting], kind="stable")]
        blocks = cubes.blocks[waiting].astype(np.int64)
        stays = (blocks > 0) & ~self._block_store.takes(blocks.ravel()).reshape(blocks.shape)
        waiting = waiting[~stays.any(1)]
        freed = np.cumsum(self._row_memory.bytes_of(waiting)) / 2**20
        for cube in waiting[: 1 + int(np.searchsorted(freed, held - self.memory_mb + SPARE_MB))].tolist():
            for block in self._row_memory.blocks_of(cube):
                self._block_store.put(block, self._row_memory.block(block))
            self._row_memory.free(cube)
            self._unindexed[cube] = False

    def _pack(self, cubes: Rows) -> None:
        """Pack those of some cubes that have many dead rows."""
        dead = self._cubes.dead[cubes]
        self._pack_all(cubes[(dead >= MIN_DEAD) & (dead > DEAD_FRACTION * self._cubes.rows[cubes])])

    def _pack_all(self, cubes: Rows) -> None:
        if not len(cubes):
            return
        plain = self._row_memory.rows.view(np.uint8).reshape(-1, ROW.itemsize)
        for cube in cubes:
            kernel.pack(cube, self._cubes, plain, self._points)
        blocks = np.array([block for cube in cubes.tolist() for block in self._row_memory.blocks_of(cube)])
        owners = [self._row_memory.block(block)["owner"] for block in blocks.tolist()]
        self._blocks.add_rows(np.concatenate(owners), np.repeat(blocks, [len(some) for some in owners]))

    def _find_anchors(self) -> None:
        rows = np.flatnonzero(self._points.weight[BLOCK_ROWS : self.blocks * BLOCK_ROWS] > 0) + BLOCK_ROWS
        self._anchors.begin_anew(self._points.anchor[rows], self._cubes.cube_of[rows >> BLOCK_BITS])

    @property
    def count(self) -> int:
        """Rows in use, dead ones included."""
        return int(self._cubes.rows[: self._cubes.used[0]].sum())

    @property
    def alive(self) -> int:
        """How many points there are."""
        return self.count - int(self._cubes.dead[: self._cubes.used[0]].sum())

    @property
    def nbytes(self) -> int:
        """Memory of the points that are in it, and of the tables that find them, bytes."""
        used = int(self._cubes.used[0])
        held = np.flatnonzero(self._in_memory())
        places = sum(column[:1].nbytes for column in self._cubes if column.ndim == 2 or column is self._cubes.key)
        return int(self._row_memory.bytes_of(held).sum()) + used * places

    def living(self, *, fine: bool = False) -> Rows:
        """Return the rows of all points of the map's voxels, of which some may stand for several; or of fine ones."""
        rows = self._all_living()
        return np.asarray(rows[self._fine(self._cubes.cube_of[rows >> BLOCK_BITS]) == fine])

    def _all_living(self) -> Rows:
        self._load_rows(np.arange(self._cubes.used[0]))
        rows = np.flatnonzero(self._points.weight[BLOCK_ROWS : self.blocks * BLOCK_ROWS] > 0)
        return np.asarray(rows + BLOCK_ROWS)

    def owned(self) -> dict[int, Rows]:
        """Return the rows of each object, by number, ascending."""
        found = ((number, self.rows_of(number)) for number in self._blocks.numbers())
        return {number: rows for number, rows in found if len(rows)}

    def owns(self, number: int) -> bool:
        """Tell whether an object may have rows: it has none in the whole map where not."""
        return len(self._blocks.of(number)) > 0

    def rows_of(self, number: int) -> Rows:
        """Return the rows of an object, ascending."""
        rows = self._all_of(number)
        return np.asarray(rows[self._points.weight[rows] > 0], dtype=np.int64)

    def has_rows(self, number: int, least: int) -> bool:
        """Tell whether an object has this many rows: faster than `rows_of`."""
        blocks = self._blocks_of(number)
        return bool(owners.has_rows(number, blocks, BLOCK_ROWS, self.owner, self._points.weight, least))

    def _blocks_of(self, number: int) -> Rows:
        """Have the blocks in memory that may hold rows of an object, and return them, ascending."""
        blocks = self._blocks.of(number)
        self._load_rows(self._cubes.cube_of[blocks].astype(np.int64))
        return blocks

    def _all_of(self, number: int) -> Rows:
        """Return the rows of an object, dead ones too."""
        blocks = self._blocks_of(number)
        rows = np.empty(len(blocks) * BLOCK_ROWS, np.int64)
        return rows[: owners.rows_of(number, blocks, BLOCK_ROWS, self.owner, rows)]

    def transfer(self, gone: int, kept: int) -> None:
        """Transfer all rows of one object to another."""
        rows = self._all_of(gone)
        self.owner[rows] = kept
        self._cubes.changed[rows >> BLOCK_BITS] = True
        self._blocks.transfer(gone, kept)

    def release(self, numbers: Sequence[int]) -> None:
        """Let objects have no rows: these are no one's, and no votes hold them."""
        if not numbers:
            return
        blocks, gone = self._blocks.release(numbers), np.zeros(max(numbers) + 1, bool)
        gone[list(numbers)] = True
        self._load_rows(self._cubes.cube_of[blocks].astype(np.int64))
        owners.release(gone, blocks, BLOCK_ROWS, self.owner, self._points.confidence, self._cubes.changed)


def words_of(rows: npt.NDArray[Any]) -> npt.NDArray[np.uint32]:
    """Return rows (N,) of type ROW as words (N, W): a view."""
    return rows.view(np.uint32).reshape(-1, ROW.itemsize // 4)


@cache
def rows_of_a_cube() -> tuple[npt.NDArray[np.uint32], Points]:
    """Return room for as many rows as a cube may have, as words and as columns: rows go through it."""
    rows = np.empty(MAX_BLOCKS * BLOCK_ROWS, ROW)
    return words_of(rows), columns_of(rows)
