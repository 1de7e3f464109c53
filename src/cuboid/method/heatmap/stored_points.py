"""The points of the map in memory: rows in blocks, rows of each object, and eviction of regions out of view."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.state import Record
from cuboid.method.heatmap.anchors import Anchors
from cuboid.method.heatmap.kernels import cubes as kernel_cubes
from cuboid.method.heatmap.kernels import lookup, owners
from cuboid.method.heatmap.kernels import voxels as kernel
from cuboid.method.heatmap.kernels.cubes import (
    BLOCK_BITS,
    BLOCK_ROWS,
    FINE,
    HEATS,
    LEVELS,
    MAX_BLOCKS,
    ROW,
    Points,
    columns_of,
)
from cuboid.method.heatmap.row_blocks import RowBlocks, RowBlocksState
from cuboid.method.heatmap.row_memory import BlockStore, RowMemory, TemporaryBlockStore, resident_mb

Rows = npt.NDArray[np.int64]

# A cube is packed if this fraction of its rows, and at least this number, is dead.
DEAD_FRACTION, MIN_DEAD = 0.125, 32
# Eviction frees this much more memory than needed, in units of 2**20 bytes, so that it does not recur each frame.
SPARE_MB = 8.0


@dataclass(frozen=True, slots=True)
class StoredPointsState(Record):
    """State of `StoredPoints`, except for the rows, which are saved block by block.

    Attributes
    ----------
    visit : int
        Number of earlier visits to the place.
    most_hits : int
        Largest weight of the sightings of earlier visits, in sightings.
    carving_passes : int
        Number of frames that have carved free space.
    owned_blocks : RowBlocksState
    """

    visit: int
    most_hits: int
    carving_passes: int
    owned_blocks: RowBlocksState


class StoredPoints:
    """Rows of points in cubes of voxels, and the object that owns each point.

    Cubes out of view are evicted if memory is short, and loaded again when they are accessed; results do not depend on
    it. Points with a pending motion of their keyframe (`Anchors`) keep their position until their region is accessed.
    Row numbers are valid until the cube is packed, which happens between frames and when a region with pending motions
    is accessed.

    Parameters
    ----------
    voxel_m : float
        Edge of the map's voxels, metres.
    anchors : Anchors
        Anchors of the points.
    memory_mb : float
        Memory limit of the process, in units of 2**20 bytes, above which cubes out of view are evicted.

    Attributes
    ----------
    before_visit : callable or None
        Called with rows of points from earlier visits before they are prepared for the current visit.
    visit, most_hits, carving_passes, owned_blocks
        As in `StoredPointsState`.
    memory : RowMemory
    points, cubes
        Columns of the rows, and the tables that find them, as views of the memory.
    seen, marks
        Buffers for kernels: numbers of cubes, and a mark for each cube.
    unindexed : (N,) bool
        For each cube, whether its rows are in memory without an index.
    last_viewed : (N,) int32
        For each cube, the last carving pass in which it was in view.
    ready : (M,) uint16
        For each block, the visit for which it was prepared.
    """

    # The rows are saved block by block; the tables that find them follow from the rows.
    NOT_SAVED = frozenset(
        {
            *("voxel_m", "memory_mb", "before_visit", "anchors", "memory", "block_store", "points", "cubes"),
            *("seen", "marks", "unindexed", "last_viewed", "ready"),
        }
    )

    def __init__(self, voxel_m: float, anchors: Anchors, memory_mb: float) -> None:
        self.voxel_m = voxel_m
        self.memory_mb = memory_mb
        self.before_visit: Callable[[Rows], None] | None = None
        self.visit, self.most_hits = 0, 0
        self.carving_passes = 0
        self.owned_blocks, self.anchors = RowBlocks(), anchors
        self._begin(TemporaryBlockStore())

    def state(self) -> StoredPointsState:
        """Return the current state; later updates do not change it."""
        return StoredPointsState(self.visit, self.most_hits, self.carving_passes, self.owned_blocks.state())

    @classmethod
    def from_state(cls, state: StoredPointsState, voxel_m: float, anchors: Anchors, memory_mb: float) -> StoredPoints:
        """Return points that continue from a state, without their rows: `restore` or `refill` must follow."""
        stored = cls(voxel_m, anchors, memory_mb)
        stored.visit, stored.most_hits, stored.carving_passes = state.visit, state.most_hits, state.carving_passes
        stored.owned_blocks = RowBlocks.from_state(state.owned_blocks)
        return stored

    def _begin(self, block_store: BlockStore) -> None:
        self.memory, self.block_store = RowMemory(), block_store
        self.points = self.memory.points
        self.cubes = self.memory.cubes._replace(pending=self.anchors.pending)
        self.seen = np.zeros(len(self.cubes.key), np.int64)
        self.marks = np.zeros(len(self.cubes.key), bool)
        self.unindexed = np.zeros(len(self.cubes.key), bool)
        self.last_viewed = np.zeros(len(self.cubes.key), np.int32)
        self.ready = np.zeros(len(self.cubes.cube_of), np.uint16)

    @property
    def owner(self) -> npt.NDArray[np.int32]:
        """Number of the object that owns each row, 0: none."""
        return self.points.owner

    @property
    def hits(self) -> npt.NDArray[np.uint16]:
        """Number of frames that saw each row."""
        return self.points.hits

    def keyframe(self, rows: Rows) -> npt.NDArray[np.uint16]:
        """Return the keyframe to which the last frame that saw each row (N,) is anchored."""
        return self.anchors.keyframes(self.points.anchor[rows])

    def keyframe_of(self, rows: Rows) -> int:
        """Return the keyframe to which most of rows (N,) are anchored, the first of equals; 0 without rows."""
        return int(np.bincount(self.keyframe(rows), minlength=1).argmax())

    @property
    def revisited(self) -> bool:
        """Whether the map may contain points from before this visit."""
        return self.visit > 0

    @property
    def blocks(self) -> int:
        """One more than the highest block number; number 0 is not used."""
        return int(self.cubes.used[1])

    def note_new_blocks(self, first_new: int) -> None:
        """Record that the blocks from a number on were created in this visit."""
        self.ready[first_new : self.blocks] = self.visit

    def fuse(
        self,
        pixels: kernel.Pixels,
        far_m: float,
        frame: int,
        turn: int,
        keyframe: int,
        slots: npt.NDArray[np.int32],
        level: int = 0,
    ) -> Rows:
        """Fuse the pixels of a frame; return the cubes that contain its points. See `kernels.voxels.fuse`."""
        first_new, anchor = self.blocks, self.anchors.current_anchor(keyframe)
        voxel_m = self.voxel_m / 2 if level == FINE else self.voxel_m
        kernel.fuse(
            pixels, voxel_m, far_m, frame, self.carving_passes & 1, turn, anchor, level, self.cubes, self.points, slots
        )
        self.note_new_blocks(first_new)
        touched = self.seen[: lookup.touched(slots, self.cubes.cube_of, self.marks, self.seen)]
        self.anchors.has_points_in(anchor, touched)
        return touched

    def take_changed(self) -> Rows:
        """Return the blocks with rows that have changed since the last call, ascending."""
        changed = np.flatnonzero(self.cubes.changed[: self.blocks])
        self.cubes.changed[:] = False
        return changed

    def has_changed(self, blocks: Rows) -> npt.NDArray[np.bool_]:
        """Return which blocks (N,) have changed since `take_changed`."""
        return self.cubes.changed[blocks]

    def copies(self, blocks: Rows) -> list[tuple[int, int, npt.NDArray[Any]]]:
        """Return for each block (N,) the key of its cube, the visit that it is prepared for, and a copy of its rows."""
        cubes = self.cubes.cube_of[blocks].astype(np.int64)
        self.load(cubes)
        keys, visits = self.cubes.key[cubes].tolist(), self.ready[blocks].tolist()
        # Copied as bytes: NumPy copies records field by field.
        copied = self.memory.rows.view(np.uint8).reshape(-1, BLOCK_ROWS * ROW.itemsize)[blocks].view(ROW)
        rows = [copied[k, : self.memory.rows_in(block)] for k, block in enumerate(blocks.tolist())]
        return list(zip(keys, visits, rows, strict=True))

    def restore(self, blocks: Iterable[tuple[int, int, int, int, int]], block_store: BlockStore) -> None:
        """Restore a map from `from_state` whose blocks are in a block store.

        Parameters
        ----------
        blocks : iterable of (int, int, int, int, int)
            Block number, key of the cube, number of rows, number of living rows, and visit, ascending by number.
        block_store : BlockStore
        """
        self._begin(block_store)
        cubes = self.cubes
        for block, key, rows, living, visit in blocks:
            cube = kernel_cubes.make_cube(np.int64(key), cubes)
            turn = np.count_nonzero(cubes.blocks[cube])
            cubes.blocks[cube, turn] = block
            cubes.cube_of[block], cubes.turn[block] = cube, turn
            cubes.rows[cube] += rows
            cubes.dead[cube] += rows - living
            cubes.bits[cube] = 0
            cubes.used[1] = block + 1
            self.ready[block] = visit
        if self.anchors.cubes > cubes.used[0]:
            raise ValueError(f"points are in {self.anchors.cubes} cubes, expected {cubes.used[0]}")

    def begin_anew(self) -> None:
        """Remove all points."""
        self._begin(
            self.block_store if not isinstance(self.block_store, TemporaryBlockStore) else TemporaryBlockStore()
        )
        self.owned_blocks = RowBlocks()

    def use_store(self, block_store: BlockStore) -> None:
        """Evict to another block store from now on; all blocks must be in memory."""
        self.block_store = block_store

    def refill(self, keys: npt.NDArray[np.int64], rows: npt.NDArray[Any]) -> None:
        """Replace all points by these.

        Parameters
        ----------
        keys : (N,) int64
            Keys of their cubes.
        rows : (N,) of type ROW
            One row per voxel.
        """
        self.begin_anew()
        places = np.empty(len(keys), np.int64)
        kernel_cubes.allocate_rows(keys, rows["voxel"], rows["anchor"], self.cubes, self.points, places)
        placed = places >= 0
        self.memory.rows[places[placed]] = rows[placed]
        self.cubes.changed[1 : self.blocks] = True
        self.ready[:] = self.visit
        self.owned_blocks.add_rows(rows["owner"][placed], places[placed] >> BLOCK_BITS)
        self._find_anchors()
        self.cubes.index_stale[self.anchors.pending_cubes[0]] = True

    def begin_visit(self, most_hits: int) -> None:
        """Limit the weight of earlier sightings to `most_hits`: the world may have changed since.

        Cubes that are not in memory are prepared when they are loaded.
        """
        self.most_hits = most_hits
        self.visit += 1
        self._prepare_for_visit(np.flatnonzero(self.in_memory()))

    def _prepare_for_visit(self, cubes: Rows) -> None:
        held = (block for cube in cubes.tolist() for block in self.memory.blocks_of(cube))
        blocks = [block for block in held if self.ready[block] != self.visit]
        if blocks and self.before_visit is not None:
            coarse = np.array(blocks)[~self.is_fine(self.cubes.cube_of[blocks])]
            rows = (coarse[:, None] * BLOCK_ROWS + np.arange(BLOCK_ROWS)).ravel()
            self.before_visit(rows[self.points.weight[rows] > 0])
        for block in blocks:
            part = self.memory.block(block)
            hits = part["hits"]
            if (hits > self.most_hits).any() or part["passes"].any():
                self.cubes.changed[block] = True
            part["weight"] *= (np.minimum(hits, self.most_hits) / np.maximum(hits, 1)).astype(np.float32)
            np.minimum(hits, self.most_hits, out=hits)
            part["passes"] = 0
            self.ready[block] = self.visit

    def viewed_since(self, keys: npt.NDArray[np.int64], since: int) -> npt.NDArray[np.bool_]:
        """Return which cubes (N,), by their keys, were in view since a carving pass.

        For 0, return the cubes that this visit may have changed, in earlier processes too.
        """
        used = int(self.cubes.used[0])
        seen = self.last_viewed[:used] >= since
        if since == 0:
            seen = np.zeros(used, bool)
            seen[self.cubes.cube_of[np.flatnonzero(self.ready[: self.blocks] == self.visit)]] = True
        cubes = np.empty(len(keys), np.int64)
        kernel_cubes.cubes_at(keys, self.cubes, cubes)
        return np.asarray((cubes >= 0) & seen[np.maximum(cubes, 0)]) if used else np.zeros(len(keys), bool)

    def is_fine(self, cubes: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
        """Return which cubes (N,) are fine ones: their voxels have half the edge; see `FinePoints`."""
        return np.asarray(self.cubes.key[cubes] < 0)

    def in_memory(self) -> npt.NDArray[np.bool_]:
        """Return for each cube whether its rows are in memory."""
        used = int(self.cubes.used[0])
        return np.asarray((self.cubes.bits[:used] > 0) | self.unindexed[:used])

    def load(self, cubes: Rows) -> None:
        """Load the rows of cubes (N,) as stored: a row may represent several voxels."""
        missing = cubes[(self.cubes.bits[cubes] == 0) & ~self.unindexed[cubes]]
        if not len(missing):
            return
        missing = np.unique(missing)
        blocks = [(block, self.memory.rows_in(block)) for cube in missing for block in self.memory.blocks_of(cube)]
        blocks = [(block, count) for block, count in blocks if count]
        loaded = self.block_store.get([block for block, _ in blocks], [count for _, count in blocks])
        for (block, _), rows in zip(blocks, loaded, strict=True):
            self.memory.block(block)[:] = rows
        self.unindexed[missing] = True
        self._prepare_for_visit(missing)

    def evict(self, keep: Rows | None = None) -> None:
        """Evict cubes if memory is short, those out of view for longest first; `keep` are never evicted."""
        used_mb = resident_mb() if self.memory_mb < float("inf") else None
        if used_mb is None or used_mb <= self.memory_mb:
            return
        cubes, evictable = self.cubes, self.in_memory()
        if keep is not None:
            evictable[keep] = False
        candidates = np.flatnonzero(evictable)
        candidates = candidates[np.argsort(self.last_viewed[candidates], kind="stable")]
        blocks = cubes.blocks[candidates].astype(np.int64)
        is_kept = (blocks > 0) & ~self.block_store.takes(blocks.ravel()).reshape(blocks.shape)
        candidates = candidates[~is_kept.any(1)]
        freed = np.cumsum(self.memory.bytes_of(candidates)) / 2**20
        for cube in candidates[: 1 + int(np.searchsorted(freed, used_mb - self.memory_mb + SPARE_MB))].tolist():
            for block in self.memory.blocks_of(cube):
                self.block_store.put(block, self.memory.block(block))
            self.memory.free(cube)
            self.unindexed[cube] = False

    def pack(self, cubes: Rows) -> None:
        """Pack those of some cubes that have many dead rows."""
        dead = self.cubes.dead[cubes]
        self.pack_all(cubes[(dead >= MIN_DEAD) & (dead > DEAD_FRACTION * self.cubes.rows[cubes])])

    def pack_all(self, cubes: Rows) -> None:
        """Pack cubes (N,): dead rows are removed."""
        if not len(cubes):
            return
        plain = self.memory.rows.view(np.uint8).reshape(-1, ROW.itemsize)
        for cube in cubes:
            kernel.pack(cube, self.cubes, plain, self.points)
        blocks = np.array([block for cube in cubes.tolist() for block in self.memory.blocks_of(cube)])
        owners = [self.memory.block(block)["owner"] for block in blocks.tolist()]
        self.owned_blocks.add_rows(np.concatenate(owners), np.repeat(blocks, [len(rows) for rows in owners]))

    def _find_anchors(self) -> None:
        rows = np.flatnonzero(self.points.weight[BLOCK_ROWS : self.blocks * BLOCK_ROWS] > 0) + BLOCK_ROWS
        self.anchors.begin_anew(self.points.anchor[rows], self.cubes.cube_of[rows >> BLOCK_BITS])

    @property
    def count(self) -> int:
        """Number of used rows, dead ones included."""
        return int(self.cubes.rows[: self.cubes.used[0]].sum())

    @property
    def alive(self) -> int:
        """Number of points."""
        return self.count - int(self.cubes.dead[: self.cubes.used[0]].sum())

    @property
    def nbytes(self) -> int:
        """Memory of the loaded points and of the tables that find them, bytes."""
        used = int(self.cubes.used[0])
        loaded = np.flatnonzero(self.in_memory())
        table_bytes = sum(column[:1].nbytes for column in self.cubes if column.ndim == 2 or column is self.cubes.key)
        return int(self.memory.bytes_of(loaded).sum()) + used * table_bytes

    def living(self, *, fine: bool = False) -> Rows:
        """Return the rows of all points in the map's voxels (a row may represent several), or in fine voxels."""
        rows = self.all_living()
        return np.asarray(rows[self.is_fine(self.cubes.cube_of[rows >> BLOCK_BITS]) == fine])

    def all_living(self) -> Rows:
        """Return the rows of all points, including fine ones."""
        self.load(np.arange(self.cubes.used[0]))
        rows = np.flatnonzero(self.points.weight[BLOCK_ROWS : self.blocks * BLOCK_ROWS] > 0)
        return np.asarray(rows + BLOCK_ROWS)

    def spread(self, rows: Rows) -> tuple[Float32Array, Rows]:
        """Return the world points (M, 3) of all voxels that rows (N,) represent, and the index of the row of each."""
        marks = self.points.mark[rows]
        bits = np.unpackbits(np.where(marks > 0, marks, 1)[:, None], axis=1, bitorder="little")
        index, eighth = np.nonzero(bits)
        return self._places(rows[index], eighth.astype(np.uint8)), index

    def xyz(self, rows: Rows) -> Float32Array:
        """Return the world points (N, 3) of these rows, which represent one voxel each."""
        return self._places(rows, np.zeros(len(rows), np.uint8))

    def _places(self, rows: Rows, eighths: npt.NDArray[np.uint8]) -> Float32Array:
        xyz = np.empty((len(rows), 3), np.float32)
        lookup.places(rows, eighths, self.voxel_m, self.cubes, self.points, self.anchors.motions, xyz)
        return xyz

    def rgb(self, rows: Rows) -> UInt8Array:
        """Return colors (N, 3) of these rows."""
        return np.minimum(np.rint(self.points.color[rows] / LEVELS), 255).astype(np.uint8)

    def weight(self, rows: Rows) -> Float64Array:
        """Return the summed weight (N,) of the sightings of these rows: larger for nearer and for more sightings."""
        return np.asarray(self.points.weight[rows], dtype=np.float64)

    def heat(self, rows: Rows) -> Float32Array:
        """Return the heat (N,) of these rows, 0..1."""
        return np.asarray(self.points.heat[rows] / np.float32(HEATS - 1), dtype=np.float32)

    def seen_since(self, rows: Rows, frame: int) -> npt.NDArray[np.bool_]:
        """Return which rows (N,) were seen by a frame from a number on."""
        return np.asarray(self.points.last_frame[rows] >= frame)

    def owned(self) -> dict[int, Rows]:
        """Return the rows of each object by number, ascending."""
        found = ((number, self.rows_of(number)) for number in self.owned_blocks.numbers())
        return {number: rows for number, rows in found if len(rows)}

    def owns(self, number: int) -> bool:
        """Return whether an object may have rows; if False, it has none in the whole map."""
        return len(self.owned_blocks.of(number)) > 0

    def rows_of(self, number: int) -> Rows:
        """Return the rows of an object, ascending."""
        rows = self._all_of(number)
        return np.asarray(rows[self.points.weight[rows] > 0], dtype=np.int64)

    def have_rows(self, numbers: Sequence[int], min_rows: Sequence[int]) -> list[bool]:
        """Return whether each object (n,) has at least `min_rows` (n,) rows: faster than `rows_of`."""
        of = [self.owned_blocks.of(number) for number in numbers]
        blocks = np.concatenate([np.zeros(0, np.int64), *of])
        ends = np.cumsum([len(each) for each in of], dtype=np.int64)
        self.load(self.cubes.cube_of[blocks].astype(np.int64))
        found = np.empty(len(of), np.bool_)
        wanted = np.array(numbers, np.int64), np.array(min_rows, np.int64)
        owners.have_rows(*wanted, blocks, ends, BLOCK_ROWS, self.owner, self.points.weight, found)
        return found.tolist()

    def blocks_of(self, number: int) -> Rows:
        """Load the blocks that may contain rows of an object, and return them, ascending."""
        blocks = self.owned_blocks.of(number)
        self.load(self.cubes.cube_of[blocks].astype(np.int64))
        return blocks

    def _all_of(self, number: int) -> Rows:
        """Return the rows of an object, including dead ones."""
        blocks = self.blocks_of(number)
        rows = np.empty(len(blocks) * BLOCK_ROWS, np.int64)
        return rows[: owners.rows_of(number, blocks, BLOCK_ROWS, self.owner, rows)]

    def transfer(self, gone: int, kept: int) -> None:
        """Transfer all rows of one object to another."""
        rows = self._all_of(gone)
        self.owner[rows] = kept
        self.cubes.changed[rows >> BLOCK_BITS] = True
        self.owned_blocks.transfer(gone, kept)

    def remove(self, number: int) -> None:
        """Remove all points of an object from the map."""
        rows = self.rows_of(number)
        p, blocks = self.points, rows >> BLOCK_BITS
        p.weight[rows], p.hits[rows], p.passes[rows] = 0.0, 0, 0
        np.add.at(self.cubes.dead, self.cubes.cube_of[blocks], 1)
        self.cubes.changed[blocks] = True

    def release(self, numbers: Sequence[int]) -> None:
        """Remove the ownership and the votes of objects from all their rows."""
        if not numbers:
            return
        blocks, gone = self.owned_blocks.release(numbers), np.zeros(max(numbers) + 1, bool)
        gone[list(numbers)] = True
        self.load(self.cubes.cube_of[blocks].astype(np.int64))
        owners.release(gone, blocks, BLOCK_ROWS, self.owner, self.points.confidence, self.cubes.changed)


def words_of(rows: npt.NDArray[Any]) -> npt.NDArray[np.uint32]:
    """Return rows (N,) of type ROW as words (N, W), as a view."""
    return rows.view(np.uint32).reshape(-1, ROW.itemsize // 4)


@cache
def rows_of_a_cube() -> tuple[npt.NDArray[np.uint32], Points]:
    """Return a buffer for the largest number of rows of a cube, as words and as columns."""
    rows = np.empty(MAX_BLOCKS * BLOCK_ROWS, ROW)
    return words_of(rows), columns_of(rows)
