"""The global 3D heatmap: points averaged over all their sightings, in a hashed voxel map."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float32Array, Float64Array, UInt8Array
from cuboid.geometry.se3 import inverse
from cuboid.heatmap.carrying import average, keys_of, moved_with, oldest
from cuboid.heatmap.room import Room, resident_mb
from cuboid.heatmap.row_blocks import RowBlocks
from cuboid.heatmap.shelf import Shelf, TemporaryShelf
from cuboid.kernels import claims as kernel_claims
from cuboid.kernels import cubes as kernel_cubes
from cuboid.kernels import voxels as kernel
from cuboid.kernels.cubes import BLOCK_BITS, BLOCK_ROWS, CUBE_BITS, HEATS, LEVELS, PLACES, ROW
from cuboid.working import WorkingImage

Rows = npt.NDArray[np.int64]

# Points that a frame looks through: all in view where these are few, else a part of them in turn.
LOOK_POINTS = 40_000
# A reading this far behind a voxel passes through it, metres (two voxels of 1 cm: pose error and edges).
PASS_MARGIN_M = 0.02
# Votes that a voxel keeps for its owner: so many frames of another opinion change it.
MOST_VOTES = 8
# A voxel is its owner's when the votes are one in so many of the frames that saw it.
VOTES_SHARE = 3
# A cube is packed when this share of its rows is dead, and so many.
DEAD_SHARE, LEAST_DEAD = 0.125, 32
# What is put aside beyond what memory is short of, in units of 2**20 bytes: not a little each frame.
SPARE_MB = 8.0
# Points hang on keyframes up to this one: hours of video.
LAST_ANCHOR = 0xFFFF


class VoxelMap:
    """Points of the scene with color, heat, and the object that each belongs to, in cubes of voxels.

    Cubes that no frame looks at are put aside where memory is short, and come back when they are looked at or asked
    for; no result depends on it. Rows of points have the same numbers while the map is not carried and their cube is
    not packed, which both happen between frames.

    Parameters
    ----------
    voxel_m : float
    noise_per_m : float
        Standard deviation of depth is this times z squared.
    max_depth_m : float
    memory_mb : float
        Memory of the process, in units of 2**20 bytes, beyond which cubes that are out of view are put aside.

    Attributes
    ----------
    before_visit : callable or None
        Called with rows of points that are as they were before the visit, when these are to be made ready for it.
    """

    def __init__(self, voxel_m: float, noise_per_m: float, max_depth_m: float, memory_mb: float = float("inf")) -> None:
        self.voxel_m = voxel_m
        self.noise_per_m = noise_per_m
        self.memory_mb = memory_mb
        self._max_depth_m = max_depth_m
        # How many looks there were, and the cube that the next one begins with.
        self._looks = self._next_look = 0
        self.before_visit: Callable[[Rows], None] | None = None
        self._visit, self._most_hits = 0, 0
        self._blocks = RowBlocks()
        self._begin(TemporaryShelf())

    def _begin(self, shelf: Shelf) -> None:
        self._room, self._shelf = Room(), shelf
        self._points, self._cubes = self._room.points, self._room.cubes
        self._seen = np.zeros(len(self._cubes.key), np.int64)
        # Of each cube, the last look that had it in view; of each block, the visit that it was made ready for.
        self._last_look = np.zeros(len(self._cubes.key), np.int32)
        self._ready = np.zeros(len(self._cubes.cube_of), np.uint16)

    @property
    def owner(self) -> npt.NDArray[np.int32]:
        """Number of the object that each row belongs to, 0 none; written by this class alone."""
        return self._points.owner

    @property
    def hits(self) -> npt.NDArray[np.uint16]:
        """Frames that saw each row."""
        return self._points.hits

    @property
    def anchor(self) -> npt.NDArray[np.uint16]:
        """Keyframe that the last frame to see each row hangs on, 0 none."""
        return self._points.anchor

    @property
    def looks(self) -> int:
        """How many frames have looked through the map."""
        return self._looks

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
        self._bring(cubes)
        keys, visits = self._cubes.key[cubes].tolist(), self._ready[blocks].tolist()
        # As bytes: NumPy copies records field by field.
        copied = self._room.rows.view(np.uint8).reshape(-1, BLOCK_ROWS * ROW.itemsize)[blocks].view(ROW)
        rows = [copied[k, : self._room.rows_in(block)] for k, block in enumerate(blocks.tolist())]
        return list(zip(keys, visits, rows, strict=True))

    def restore(self, blocks: Iterable[tuple[int, int, int, int, int]], shelf: Shelf) -> None:
        """Take the place of a map whose blocks lie on a shelf; `RowBlocks` and the like are not touched.

        Parameters
        ----------
        blocks : iterable of (int, int, int, int, int)
            Number, key of the cube, rows, living ones among them, and visit of each, ascending by number.
        shelf : Shelf
        """
        self._begin(shelf)
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

    def put_on(self, shelf: Shelf) -> None:
        """Put what leaves memory from now on elsewhere; all is in memory yet."""
        self._shelf = shelf

    def refill(self, voxels: npt.NDArray[np.int64], rows: npt.NDArray[Any]) -> None:
        """Have these points and no others.

        Parameters
        ----------
        voxels : (N, 3) int64
            Of the world, each another one.
        rows : (N,) of type ROW
            Their points; `voxel` is not read.
        """
        self._begin(self._shelf if not isinstance(self._shelf, TemporaryShelf) else TemporaryShelf())
        cube, within = voxels >> CUBE_BITS, voxels & ((1 << CUBE_BITS) - 1)
        inside = (within[:, 0] << (2 * CUBE_BITS)) | (within[:, 1] << CUBE_BITS) | within[:, 2]
        place = np.empty(len(voxels), np.int64)
        kernel_cubes.enter(keys_of(cube), inside, self._cubes, self._points.voxel, place)
        there = place >= 0
        rows["voxel"] = inside
        self._room.rows[place[there]] = rows[there]
        self._cubes.changed[1 : self.blocks] = True
        self._ready[:] = self._visit
        self._blocks = RowBlocks()
        self._blocks.give_rows(rows["owner"][there], place[there] >> BLOCK_BITS)

    def begin_visit(self, most_hits: int) -> None:
        """Let what was seen so far count as no more than so many sightings: the world may have changed since.

        What is not in memory is made ready when it comes back.
        """
        self._most_hits = most_hits
        self._visit += 1
        self._ready_for_visit(np.flatnonzero(self._cubes.bits[: self._cubes.used[0]]))

    def _ready_for_visit(self, cubes: Rows) -> None:
        all_of = (block for cube in cubes.tolist() for block in self._room.blocks_of(cube))
        blocks = [block for block in all_of if self._ready[block] != self._visit]
        if blocks and self.before_visit is not None:
            rows = (np.array(blocks)[:, None] * BLOCK_ROWS + np.arange(BLOCK_ROWS)).ravel()
            self.before_visit(rows[self._points.weight[rows] > 0])
        for block in blocks:
            part = self._room.block(block)
            hits = part["hits"]
            part["weight"] *= (np.minimum(hits, self._most_hits) / np.maximum(hits, 1)).astype(np.float32)
            np.minimum(hits, self._most_hits, out=hits)
            part["passes"] = 0
            self._ready[block] = self._visit

    def looked_at(self, keys: npt.NDArray[np.int64], since: int) -> npt.NDArray[np.bool_]:
        """Tell which cubes (N,), by their keys, were in view from a look on.

        With 0, those of which this visit may have changed anything, in earlier processes too.
        """
        used = int(self._cubes.used[0])
        seen = self._last_look[:used] >= since
        if since == 0:
            seen = np.zeros(used, bool)
            seen[self._cubes.cube_of[np.flatnonzero(self._ready[: self.blocks] == self._visit)]] = True
        cubes = np.empty(len(keys), np.int64)
        kernel_cubes.cubes_at(keys, self._cubes, cubes)
        return np.asarray((cubes >= 0) & seen[np.maximum(cubes, 0)]) if used else np.zeros(len(keys), bool)

    def _bring(self, cubes: Rows) -> None:
        """Have cubes (N,) in memory."""
        away = np.unique(cubes[self._cubes.bits[cubes] == 0])
        if not len(away):
            return
        blocks = [(block, self._room.rows_in(block)) for cube in away for block in self._room.blocks_of(cube)]
        blocks = [(block, count) for block, count in blocks if count]
        found = self._shelf.get([block for block, _ in blocks], [count for _, count in blocks])
        for (block, _), rows in zip(blocks, found, strict=True):
            self._room.block(block)[:] = rows
        for cube in away:
            kernel_cubes.fill_index(cube, self._cubes, self._points.voxel)
        self._ready_for_visit(away)

    def _bring_all(self) -> None:
        self._bring(np.arange(self._cubes.used[0]))

    def relieve(self, keep: Rows | None = None) -> None:
        """Put cubes aside where memory is short, those first that were out of view for longest; not those to keep."""
        held = resident_mb() if self.memory_mb < float("inf") else None
        if held is None or held <= self.memory_mb:
            return
        cubes = self._cubes
        there = cubes.bits[: cubes.used[0]] > 0
        if keep is not None:
            there[keep] = False
        waiting = np.flatnonzero(there)
        waiting = waiting[np.argsort(self._last_look[waiting], kind="stable")]
        blocks = cubes.blocks[waiting].astype(np.int64)
        stays = (blocks > 0) & ~self._shelf.takes(blocks.ravel()).reshape(blocks.shape)
        waiting = waiting[~stays.any(1)]
        freed = np.cumsum(self._room.bytes_of(waiting)) / 2**20
        for cube in waiting[: 1 + int(np.searchsorted(freed, held - self.memory_mb + SPARE_MB))].tolist():
            for block in self._room.blocks_of(cube):
                self._shelf.put(block, self._room.block(block))
            self._room.let_go(cube)

    def _in_view(self, image: WorkingImage, T_camera_world: Float64Array) -> Rows:
        """Return the cubes that a frame may see, or see through."""
        count = kernel_cubes.in_view(
            np.ascontiguousarray(T_camera_world), _pinhole(image), image.camera.width, image.camera.height,
            float(image.depth_m.max(initial=0.0)), self.voxel_m, self._cubes, self._seen,
        )  # fmt: skip
        return np.array(self._seen[:count])

    def _pack(self, cubes: Rows) -> None:
        """Pack those of some cubes that have many dead rows."""
        dead = self._cubes.dead[cubes]
        due = cubes[(dead >= LEAST_DEAD) & (dead > DEAD_SHARE * self._cubes.rows[cubes])]
        if not len(due):
            return
        plain = self._room.rows.view(np.uint8).reshape(-1, ROW.itemsize)
        for cube in due:
            kernel.pack(cube, self._cubes, plain, self._points)
            for block in self._room.blocks_of(cube):
                owner = self._room.block(block)["owner"]
                self._blocks.give_rows(owner, np.full(len(owner), block))

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
        seen = self._in_view(image, inverse(T_world_camera))
        self._last_look[seen] = self._looks
        self.relieve(seen)
        self._bring(seen)
        self._pack(seen)
        slots, before = np.empty(heat.shape, np.int32), self.blocks
        kernel.fuse(
            image.depth_m, image.color, heat, _pinhole(image), np.ascontiguousarray(T_world_camera), self.voxel_m,
            self._max_depth_m, frame, self._cubes, self._points, slots,
        )  # fmt: skip
        self._ready[before : self.blocks] = self._visit
        if anchor:
            self.anchor[slots[slots >= 0]] = anchor if anchor <= LAST_ANCHOR else 0
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
        rows = self._room.rows[alive]
        xyz = moved_with(self.xyz(alive), rows["anchor"], moved) / self.voxel_m
        voxels = np.floor(xyz).astype(np.int64)
        order = np.argsort(keys_of(voxels), kind="stable")
        rows, voxels = rows[order], voxels[order]
        keys = keys_of(voxels)
        first = np.flatnonzero(np.diff(keys, prepend=keys[0] - 1) > 0)
        values = np.column_stack([xyz[order] - voxels, rows["color"], rows["heat"], rows["weight"].astype(np.float64)])
        means = average(values, first)
        met = np.zeros(len(first), ROW)
        met["place"] = np.clip(means[:, :3] * PLACES, 0, PLACES - 1)
        met["color"], met["heat"], met["weight"] = np.rint(means[:, 3:6]), np.rint(means[:, 6]), means[:, 7]
        for name in ("hits", "passes"):
            met[name] = np.minimum(np.add.reduceat(rows[name].astype(np.int64), first), kernel.MOST_HITS)
        met["owner"] = oldest(rows["owner"], first)
        for name in ("confidence", "anchor", "last_frame"):
            met[name] = np.maximum.reduceat(rows[name], first)
        self.refill(voxels[first], met)

    def look_through(self, image: WorkingImage, T_camera_world: Float64Array) -> None:
        """Count the points that this frame sees through, and remove those that are passed more often than hit."""
        seen = self._in_view(image, T_camera_world)
        self._bring(seen)
        in_turn = np.concatenate([seen[seen >= self._next_look], seen[seen < self._next_look]])
        points = np.cumsum(self._cubes.rows[in_turn])
        now = in_turn[: 1 + int(np.searchsorted(points, LOOK_POINTS))]
        turns = max(1, -(-int(points[-1]) // LOOK_POINTS)) if len(points) else 1
        self._next_look = int(now[-1]) + 1 if len(now) < len(in_turn) else 0
        kernel.see_through(
            now, image.depth_m, _pinhole(image),
            np.ascontiguousarray(T_camera_world), self.noise_per_m, max(PASS_MARGIN_M, 2 * self.voxel_m), turns,
            self.voxel_m, self._cubes, self._points,
        )  # fmt: skip
        self._looks += 1

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
        held = np.flatnonzero(self._cubes.bits[:used])
        places = sum(column[:1].nbytes for column in self._cubes if column.ndim == 2 or column is self._cubes.key)
        return int(self._room.bytes_of(held).sum()) + used * places

    def living(self) -> Rows:
        """Return the rows of all points."""
        self._bring_all()
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

    def _all_of(self, number: int) -> Rows:
        """Return the rows of an object, dead ones too."""
        blocks = self._blocks.of(number)
        self._bring(self._cubes.cube_of[blocks].astype(np.int64))
        rows = np.empty(len(blocks) * BLOCK_ROWS, np.int64)
        return rows[: kernel.rows_of(number, blocks, BLOCK_ROWS, self.owner, rows)]

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
        confidence, hits = self._points.confidence[rows].astype(np.int64), self.hits[rows]
        borne_out = (confidence >= votes) & (VOTES_SHARE * confidence >= np.minimum(hits, MOST_VOTES))
        return np.asarray(rows[borne_out & (self.heat(rows) >= hot)], dtype=np.int64)

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
            claim, number_of, place, allowed, candidate, slots, self.hits, MOST_VOTES, self.owner,
            self._points.confidence, self._points.voted,
        )  # fmt: skip
        # Blocks of an object's rows: a row that the vote did not give it does no harm there.
        pairs = np.empty(claim.size, np.int64)
        pairs = np.unique(pairs[: kernel.blocks_touched(claim, slots, pairs)])
        number, block = number_of[pairs >> 32].astype(np.int64), pairs & 0xFFFFFFFF
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
        rows = self._all_of(gone)
        self.owner[rows] = kept
        self._cubes.changed[rows >> BLOCK_BITS] = True
        self._blocks.pass_on(gone, kept)

    def release(self, numbers: Sequence[int]) -> None:
        """Let objects have no rows: these are no one's, and no votes hold them."""
        for number in numbers:
            rows = self._all_of(number)
            self.owner[rows] = self._points.confidence[rows] = 0
            self._cubes.changed[rows >> BLOCK_BITS] = True
            self._blocks.release(number)

    def seen_since(self, rows: Rows, frame: int) -> npt.NDArray[np.bool_]:
        """Tell of which rows (N,) a frame from some number on saw the point."""
        return np.asarray(self._points.last_frame[rows] >= frame)

    def rows_at(self, points: Float64Array) -> Rows:
        """Return the rows (N,) of the voxels at places (N, 3) of the world, -1 where there is no point."""
        points = np.ascontiguousarray(points)
        rows, missing = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
        asked = self.voxel_m, self._cubes, self._points.voxel, self._points.weight, rows, missing
        while absent := kernel_cubes.rows_at(points, *asked):
            self._bring(missing[:absent])
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
        xyz = np.empty((len(rows), 3), np.float32)
        kernel_cubes.places(rows, self.voxel_m, self._cubes, self._points, xyz)
        return xyz

    def rgb(self, rows: Rows) -> UInt8Array:
        """Return colors (N, 3) of these rows."""
        return np.minimum(np.rint(self._points.color[rows] / LEVELS), 255).astype(np.uint8)

    def weight(self, rows: Rows) -> Float64Array:
        """Return the summed weight (N,) of the sightings of these rows: the larger, the nearer and the more."""
        return np.asarray(self._points.weight[rows], dtype=np.float64)

    def heat(self, rows: Rows) -> Float32Array:
        """Return the heat (N,) of these rows, 0..1."""
        return np.asarray(self._points.heat[rows] / np.float32(HEATS - 1), dtype=np.float32)


def _pinhole(image: WorkingImage) -> Float64Array:
    c = image.camera
    return np.array([c.fx, c.fy, c.cx, c.cy])
