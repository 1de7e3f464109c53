"""The global 3D heatmap: points averaged over all their sightings, in a hashed voxel map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float32Array, Float64Array, UInt8Array
from cuboid.heatmap.carrying import average, keys_of, moved_with, oldest
from cuboid.heatmap.row_blocks import BLOCK_BITS, RowBlocks
from cuboid.kernels import claims as kernel_claims
from cuboid.kernels import voxels as kernel
from cuboid.working import WorkingImage

Rows = npt.NDArray[np.int64]

# Voxels that a frame looks through: all of a small map each frame, a part of a large one in turn.
LOOK_VOXELS = 40_000
# A reading this far behind a voxel passes through it, metres (two voxels of 1 cm: pose error and edges).
PASS_MARGIN_M = 0.02
# Votes that a voxel keeps for its owner: so many frames of another opinion change it.
MOST_VOTES = 8
# A voxel is its owner's when the votes are one in so many of the frames that saw it.
VOTES_SHARE = 3
# The map is packed when this share of its rows is dead.
DEAD_SHARE = 0.25
# Rows of a run of which it is known whether any changed, as bits of their number.
CHANGED_BITS = 12
CHANGED_ROWS = 1 << CHANGED_BITS


class VoxelMap:
    """Points of the scene with color, heat, and the object that each belongs to.

    Attributes
    ----------
    voxel_m : float
    noise_per_m : float
        Standard deviation of depth is this times z squared.
    count : int
        Rows in use, dead ones included.
    values : (capacity, 8) float32
        x, y, z (world, metres), red, green, blue, heat, weight; weight 0 marks a dead row.
    hits, passes : (capacity,) int32
        Frames that saw the point, and that saw through it.
    owner : (capacity,) int32
        Number of the object that the point belongs to, 0 none. Written by `vote`, `pass_on`, `release` and `carry`
        alone.
    confidence : (capacity,) uint8
        Votes that the owner is ahead of all others.
    anchor : (capacity,) int32
        Keyframe that the last frame to see the point hangs on.
    """

    def __init__(self, voxel_m: float, noise_per_m: float, max_depth_m: float) -> None:
        self.voxel_m = voxel_m
        self.noise_per_m = noise_per_m
        self._max_depth_m = max_depth_m
        self.count = 0
        self._dead = 0
        self._next_look = 0
        self._allocate(1 << 17)

    def _allocate(self, capacity: int) -> None:
        self.keys = np.zeros(capacity, np.int64)
        self.values = np.zeros((capacity, 8), np.float32)
        self.hits = np.zeros(capacity, np.int32)
        self.passes = np.zeros(capacity, np.int32)
        self.owner = np.zeros(capacity, np.int32)
        self.confidence = np.zeros(capacity, np.uint8)
        self._voted = np.zeros(capacity, np.uint8)
        self.anchor = np.zeros(capacity, np.int32)
        self._last_frame = np.full(capacity, -1, np.int32)
        self._table = np.zeros(2 * capacity, np.int32)
        self._blocks = RowBlocks()
        self._changed = np.ones(-(-capacity // CHANGED_ROWS), bool)

    def _columns(self) -> tuple[npt.NDArray[Any], ...]:
        return (
            self.keys, self.values, self.hits, self.passes, self.owner, self.confidence, self.anchor, self._last_frame,
        )  # fmt: skip

    def _reserve(self, more: int) -> None:
        """Make room for more rows: pack the living ones, into larger arrays where these are full."""
        if self.count + more <= len(self.keys) and self._dead <= DEAD_SHARE * max(self.count, 1 << 16):
            return
        alive = np.flatnonzero(self.values[: self.count, kernel.WEIGHT] > 0)
        old = self._columns()
        capacity = len(self.keys)
        while len(alive) + more > 0.75 * capacity:
            capacity *= 2
        self._allocate(capacity)
        for target, source in zip(self._columns(), old, strict=True):
            # Into its place at once: a fraction of the time that a copy in between takes.
            np.take(source, alive, axis=0, out=target[: len(alive)], mode="clip")
        self._begin_anew(len(alive))

    def _begin_anew(self, count: int) -> None:
        """Enter so many rows, all living, in fresh tables."""
        self.count, self._dead, self._next_look = count, 0, 0
        kernel.fill_table(self.keys, count, self._table)
        self._blocks.rebuild(self.owner[:count])

    @property
    def capacity(self) -> int:
        """Rows that there is room for."""
        return len(self.keys)

    @property
    def runs(self) -> int:
        """Runs of `CHANGED_ROWS` rows that the rows in use make."""
        return -(-self.count // CHANGED_ROWS)

    def take_changed(self) -> Rows:
        """Return the runs of `CHANGED_ROWS` rows in which any has changed since this was asked last, ascending."""
        changed = np.flatnonzero(self._changed[: self.runs])
        self._changed[:] = False
        return changed

    def rows_in(self, run: int) -> tuple[npt.NDArray[Any], ...]:
        """Return all that is kept of the rows in use of a run, the columns of `restore`; views of the map's arrays."""
        rows = slice(run * CHANGED_ROWS, min((run + 1) * CHANGED_ROWS, self.count))
        return tuple(column[rows] for column in self._columns())

    def restore(self, capacity: int, runs: Sequence[tuple[npt.NDArray[Any], ...]]) -> None:
        """Take back the rows of all runs, in order, into arrays of a capacity; `count` and the like are not touched."""
        self._allocate(capacity)
        for run, columns in enumerate(runs):
            for target, source in zip(self.rows_in(run), columns, strict=True):
                target[:] = source
        kernel.fill_table(self.keys, self.count, self._table)
        self._blocks.rebuild(self.owner[: self.count])
        self._changed[:] = False

    def take_back(self, columns: tuple[npt.NDArray[Any], ...]) -> None:
        """Take the rows of a saved map, all living, some of which may be lost."""
        count, capacity = len(columns[0]), len(self.keys)
        while count > 0.75 * capacity:
            capacity *= 2
        self._allocate(capacity)
        for target, source in zip(self._columns(), columns, strict=True):
            target[:count] = source
        self._begin_anew(count)

    def age(self, most_hits: int) -> None:
        """Let what was seen long ago count as no more than so many sightings: the world may have changed since."""
        if self.count == 0:
            return
        hits, weights = self.hits[: self.count], self.values[: self.count, kernel.WEIGHT]
        weights *= (np.minimum(hits, most_hits) / np.maximum(hits, 1)).astype(np.float32)
        np.minimum(hits, most_hits, out=hits)
        self.passes[: self.count] = 0
        self._changed[:] = True

    def pack(self) -> None:
        """Let all rows live."""
        if self._dead:
            alive = self.living()
            self.take_back(tuple(column[alive] for column in self._columns()))

    def fuse(
        self, image: WorkingImage, heat: Float32Array, T_world_camera: Float64Array, frame: int, anchor: int = 0
    ) -> npt.NDArray[np.int32]:
        """Fuse a frame: points that match a point of the map are averaged with it, others are added.

        Parameters
        ----------
        image : WorkingImage
        heat : (h, w) float32
        T_world_camera : (4, 4) float64
        frame : int
        anchor : int
            Keyframe that the frame hangs on: its points move with it; see `carry`.

        Returns
        -------
        (h, w) int32
            Row of each working pixel, -1 where it was not fused; valid until the next call.
        """
        self._reserve(heat.size)
        slots = np.empty(heat.shape, np.int32)
        self.count, again = kernel.fuse(
            image.depth_m, image.color, heat, _pinhole(image), np.ascontiguousarray(T_world_camera), self.voxel_m,
            self._max_depth_m, frame, self.keys, self.values, self.hits, self._last_frame, self.count, self._table,
            slots,
        )  # fmt: skip
        self._dead -= again
        self._changed[slots >> CHANGED_BITS] = True  # the last run too, where a pixel has no row: that does no harm
        if anchor:
            self.anchor[slots[slots >= 0]] = anchor
        return slots

    def carry(self, moved: Mapping[int, Float64Array]) -> None:
        """Move points with the keyframes that they hang on; those that meet in one voxel become one.

        Of two points that meet, the oldest object's keeps the owner; hits and passes add up.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old of each keyframe whose surroundings move.
        """
        alive = self.living()
        if not len(alive):
            return
        xyz = moved_with(self.xyz(alive), self.anchor[alive], moved)
        keys = keys_of(xyz, self.voxel_m)
        order = np.argsort(keys, kind="stable")
        keys, rows = keys[order], alive[order]
        first = np.flatnonzero(np.diff(keys, prepend=keys[0] - 1) > 0)
        columns = (
            keys[first],
            average(self.values[rows], xyz[order], first),
            *(np.add.reduceat(column[rows], first) for column in (self.hits, self.passes)),
            oldest(self.owner[rows], first),
            *(np.maximum.reduceat(column[rows], first) for column in (self.confidence, self.anchor, self._last_frame)),
        )
        self._allocate(len(self.keys))
        for target, source in zip(self._columns(), columns, strict=True):
            target[: len(first)] = source
        self._begin_anew(len(first))

    def look_through(self, image: WorkingImage, T_camera_world: Float64Array) -> None:
        """Count the points that this frame sees through, and remove those that are passed more often than hit."""
        if self.count == 0:
            return
        turns = -(-self.count // LOOK_VOXELS)
        size = -(-self.count // turns)
        first = self._next_look
        last = min(first + size, self.count)
        before = self.passes[first:last].copy(), self.hits[first:last].copy()
        self._dead += kernel.see_through(
            first, last, image.depth_m, _pinhole(image), np.ascontiguousarray(T_camera_world), self.noise_per_m,
            max(PASS_MARGIN_M, 2 * self.voxel_m), turns, self.values, self.hits, self.passes,
        )  # fmt: skip
        passed = (self.passes[first:last] != before[0]) | (self.hits[first:last] != before[1])
        self._changed[(first + np.flatnonzero(passed)) >> CHANGED_BITS] = True
        self._next_look = last if last < self.count else 0

    @property
    def alive(self) -> int:
        """How many points there are."""
        return self.count - self._dead

    @property
    def nbytes(self) -> int:
        """Memory of the points and of the table that finds them, room for more included, bytes."""
        return sum(column.nbytes for column in (*self._columns(), self._voted, self._table))

    def living(self) -> Rows:
        """Return the rows of all points."""
        return np.flatnonzero(self.values[: self.count, kernel.WEIGHT] > 0)

    def owned(self) -> dict[int, Rows]:
        """Return the rows of each object, by number, ascending."""
        rows = np.flatnonzero((self.owner[: self.count] > 0) & (self.values[: self.count, kernel.WEIGHT] > 0))
        order = rows[np.argsort(self.owner[rows], kind="stable")]
        numbers, first = np.unique(self.owner[order], return_index=True)
        return dict(zip(numbers.tolist(), np.split(order, first[1:]), strict=True)) if len(rows) else {}

    def rows_of(self, number: int) -> Rows:
        """Return the rows of an object, ascending."""
        rows = self._blocks.rows_of(number, self.owner[: self.count])
        return np.asarray(rows[self.values[rows, kernel.WEIGHT] > 0], dtype=np.int64)

    def solid_rows_of(self, number: int, hot: float, votes: int) -> Rows:
        """Return the rows of an object, ascending, that are hot and whose votes bear it out.

        Parameters
        ----------
        number : int
        hot : float
            Least heat.
        votes : int
            Least votes.
        """
        rows = self.rows_of(number)
        confidence, hits = self.confidence[rows].astype(np.int64), self.hits[rows]
        borne_out = (confidence >= votes) & (VOTES_SHARE * confidence >= np.minimum(hits, MOST_VOTES))
        return np.asarray(rows[borne_out & (self.values[rows, kernel.HEAT] >= hot)], dtype=np.int64)

    def vote(
        self,
        claim: npt.NDArray[np.int32],
        number_of: npt.NDArray[np.int32],
        place: npt.NDArray[np.int64],
        allowed: UInt8Array,
        candidate: UInt8Array,
        slots: npt.NDArray[np.int32],
    ) -> None:
        """Let a frame's shares vote for whom their voxels belong to; see `kernels.claims.vote`."""
        kernel_claims.vote(
            claim, number_of, place, allowed, candidate, slots, self.hits, MOST_VOTES, self.owner, self.confidence,
            self._voted,
        )  # fmt: skip
        touched = np.zeros((len(number_of), (self.count >> BLOCK_BITS) + 1), np.uint8)
        kernel.blocks_touched(claim, slots, BLOCK_BITS, touched)
        # Blocks of an object's rows: a row that the vote did not give it does no harm there.
        thing, block = np.nonzero(touched)
        number = number_of[thing].astype(np.int64)
        order = np.argsort(number, kind="stable")
        order = order[number[order] > 0]
        self._blocks.give(number[order], block[order])

    def owner_of(self, slots: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        """Return the number of the object (h, w) that each pixel's voxel belongs to, 0 none."""
        owner = np.empty(slots.shape, np.int32)
        kernel.owner_of(slots, self.owner, owner)
        return owner

    def pass_on(self, gone: int, kept: int) -> None:
        """Let all rows of one object belong to another."""
        rows = self._blocks.rows_of(gone, self.owner[: self.count])
        self.owner[rows] = kept
        self._changed[rows >> CHANGED_BITS] = True
        self._blocks.pass_on(gone, kept)

    def release(self, numbers: Sequence[int]) -> None:
        """Let objects have no rows: these are no one's, and no votes hold them."""
        for number in numbers:
            rows = self._blocks.rows_of(number, self.owner[: self.count])
            self.owner[rows] = self.confidence[rows] = 0
            self._changed[rows >> CHANGED_BITS] = True
            self._blocks.release(number)

    def seen_since(self, rows: Rows, frame: int) -> npt.NDArray[np.bool_]:
        """Tell of which rows (N,) a frame from some number on saw the point."""
        return np.asarray(self._last_frame[rows] >= frame)

    def rows_at(self, points: Float64Array) -> Rows:
        """Return the rows (N,) of the voxels at places (N, 3) of the world, -1 where there is no point."""
        rows = np.empty(len(points), np.int64)
        kernel.rows_at(np.ascontiguousarray(points), self.voxel_m, self.keys, self.values, self._table, rows)
        return rows

    def holds(self, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Tell which places (N, 3) of the world lie in a voxel that holds a point."""
        return self.rows_at(points) >= 0

    def owner_at(self, points: Float64Array) -> npt.NDArray[np.int32]:
        """Return the owner of what was seen more than once at places (N, 3) of the world, -1 where nothing was."""
        rows = self.rows_at(points)
        return np.where((rows >= 0) & (self.hits[rows] > 1), self.owner[rows], -1).astype(np.int32)

    def xyz(self, rows: Rows) -> Float32Array:
        """Return world points (N, 3) of these rows."""
        # Whole rows first: NumPy takes these several times as fast as parts of rows.
        return np.ascontiguousarray(self.values.take(rows, axis=0)[:, kernel.X : kernel.Z + 1])

    def rgb(self, rows: Rows) -> UInt8Array:
        """Return colors (N, 3) of these rows."""
        return np.clip(np.rint(self.values[rows, kernel.RED : kernel.BLUE + 1]), 0, 255).astype(np.uint8)

    def weight(self, rows: Rows) -> Float64Array:
        """Return the summed weight (N,) of the sightings of these rows: the larger, the nearer and the more."""
        return np.asarray(self.values[rows, kernel.WEIGHT], dtype=np.float64)

    def heat(self, rows: Rows) -> Float32Array:
        """Return the heat (N,) of these rows, 0..1."""
        return np.asarray(self.values[rows, kernel.HEAT])


def _pinhole(image: WorkingImage) -> Float64Array:
    c = image.camera
    return np.array([c.fx, c.fy, c.cx, c.cy])
