"""The global 3D heatmap: points averaged over all their sightings, in a hashed voxel map."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float32Array, Float64Array, UInt8Array
from cuboid.geometry.se3 import inverse
from cuboid.heatmap.carrying import motions_of
from cuboid.heatmap.stored_points import Rows, StoredPoints
from cuboid.kernels import carrying as kernel_carrying
from cuboid.kernels import claims as kernel_claims
from cuboid.kernels import lookup, owners
from cuboid.kernels import voxels as kernel
from cuboid.kernels.cubes import BLOCK_BITS, HEATS, LEVELS, columns_of
from cuboid.tolerances import LEAST_READINGS
from cuboid.working import WorkingImage

# Points that a frame looks through: all in view where these are few, else a part of them in turn.
LOOK_POINTS = 40_000
# Votes that a voxel keeps for its owner: so many frames of another opinion change it.
MOST_VOTES = LEAST_READINGS
# A voxel is its owner's when the votes are one in so many of the frames that saw it.
VOTES_SHARE = 3
# Points hang on keyframes up to this one: hours of video.
LAST_ANCHOR = 0xFFFF


class VoxelMap(StoredPoints):
    """Points of the scene with color, heat, and the object that each belongs to, in cubes of voxels.

    How they lie in memory, and where else: `StoredPoints`.

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
        super().__init__(memory_mb)
        self.voxel_m = voxel_m
        self.noise_per_m = noise_per_m
        self._max_depth_m = max_depth_m
        # How many looks there were, and the cube that the next one begins with.
        self._looks = self._next_look = 0

    @property
    def looks(self) -> int:
        """How many frames have looked through the map."""
        return self._looks

    def _in_view(self, image: WorkingImage, T_camera_world: Float64Array) -> Rows:
        """Return the cubes that a frame may see, or see through."""
        count = lookup.in_view(
            np.ascontiguousarray(T_camera_world), _pinhole(image), image.camera.width, image.camera.height,
            float(image.depth_m.max(initial=0.0)), self.voxel_m, self._cubes, self._seen,
        )  # fmt: skip
        return np.array(self._seen[:count])

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
        begun, slots = self.blocks, np.empty(heat.shape, np.int32)
        kernel.fuse(
            image.depth_m, image.color, heat, _pinhole(image), np.ascontiguousarray(T_world_camera), self.voxel_m,
            self._max_depth_m, frame, self._cubes, self._points, slots,
        )  # fmt: skip
        self._ready[begun : self.blocks] = self._visit
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
        motions = motions_of(moved, self.anchor[alive])
        going = alive[motions.moves[self.anchor[alive]]]
        if not len(going):
            return
        # Where much moves, and where past moves left much behind, all is put down anew, without what is dead.
        anew = 2 * len(going) > len(alive) or 2 * self._deserted() > self._cubes.used[0]
        going = alive if anew else going
        taken, keys = self._room.rows[going], self._cubes.key[self._cubes.cube_of[going >> BLOCK_BITS]]
        if anew:
            self._begin_anew()
        else:
            kernel_carrying.leave(going, self._cubes, self._points)
        begun, rows = self.blocks, np.empty(len(going), np.int64)
        kernel_carrying.settle(keys, columns_of(taken), *motions, self.voxel_m, self._cubes, self._points, rows)
        self._ready[begun : self.blocks] = self._visit
        rows = rows[rows >= 0]
        self._blocks.give_rows(self.owner[rows], rows >> BLOCK_BITS)

    def _deserted(self) -> int:
        """Return how many cubes have no living row."""
        used = self._cubes.used[0]
        return int(np.count_nonzero(self._cubes.rows[:used] == self._cubes.dead[:used]))

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
            np.ascontiguousarray(T_camera_world), self.noise_per_m, 2 * self.voxel_m, turns,
            self.voxel_m, self._cubes, self._points,
        )  # fmt: skip
        self._looks += 1

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
        pairs = np.unique(pairs[: owners.blocks_touched(claim, len(number_of), slots, pairs)])
        number, block = number_of[pairs >> 32].astype(np.int64), pairs & 0xFFFFFFFF
        order = np.argsort(number, kind="stable")
        order = order[number[order] > 0]
        self._blocks.give(number[order], block[order])

    def owner_of(self, slots: npt.NDArray[np.int32]) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.bool_]]:
        """Return the number of the object (h, w) that each pixel's voxel belongs to, 0 none; and which were known."""
        owner, known = np.empty(slots.shape, np.int32), np.empty(slots.shape, np.bool_)
        owners.owner_of(slots, self.owner, self.hits, owner, known)
        return owner, known

    def seen_since(self, rows: Rows, frame: int) -> npt.NDArray[np.bool_]:
        """Tell of which rows (N,) a frame from some number on saw the point."""
        return np.asarray(self._points.last_frame[rows] >= frame)

    def rows_at(self, points: Float64Array) -> Rows:
        """Return the rows (N,) of the voxels at places (N, 3) of the world, -1 where there is no point."""
        points = np.ascontiguousarray(points)
        rows, missing = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
        asked = self.voxel_m, self._cubes, self._points.voxel, self._points.weight, rows, missing
        while absent := lookup.rows_at(points, *asked):
            self._bring(missing[:absent])
        return rows

    def holds(self, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Tell which places (N, 3) of the world lie in a voxel that holds a point."""
        return self.rows_at(points) >= 0

    def holds_around(self, ground: Float64Array, axes: Float64Array, least: int) -> npt.NDArray[np.bool_]:
        """Tell of places (N, 3) on a plane whether so many of the nine voxels around each hold a point, one up or down.

        `axes` (3, 3) are, row by row, two axes of the plane and its normal.
        """
        ground, missing = np.ascontiguousarray(ground), np.empty(27 * len(ground), np.int64)
        seen = np.empty(len(ground), np.bool_)
        asked = self.voxel_m, self._cubes, self._points.voxel, self._points.weight, seen, missing
        while absent := lookup.seen_around(ground, axes, self.voxel_m, least, *asked):
            self._bring(missing[:absent])
        return seen

    def owner_at(self, points: Float64Array) -> npt.NDArray[np.int32]:
        """Return the owner of what was seen more than once at places (N, 3) of the world, -1 where nothing was."""
        rows = self.rows_at(points)
        return np.where((rows >= 0) & (self.hits[rows] > 1), self.owner[rows], -1).astype(np.int32)

    def xyz(self, rows: Rows) -> Float32Array:
        """Return world points (N, 3) of these rows."""
        xyz = np.empty((len(rows), 3), np.float32)
        lookup.places(rows, self.voxel_m, self._cubes, self._points, xyz)
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
