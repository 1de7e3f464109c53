"""The global 3D heatmap: points averaged over all their sightings, in a hashed voxel map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float32Array, Float64Array, UInt8Array
from cuboid.core.state import Record
from cuboid.core.tolerances import MIN_READINGS
from cuboid.core.working import WorkingImage
from cuboid.geometry.se3 import inverse
from cuboid.heatmap.anchors import Anchors, AnchorsState
from cuboid.heatmap.fine_points import FinePoints
from cuboid.heatmap.kernels import claims as kernel_claims
from cuboid.heatmap.kernels import lookup, owners
from cuboid.heatmap.kernels import voxels as kernel
from cuboid.heatmap.kernels.cubes import BLOCK_ROWS, HEATS, LEVELS
from cuboid.heatmap.row_blocks import RowBlocks, RowBlocksState
from cuboid.heatmap.stored_points import Rows

# Points that a frame carves: all in view where these are few, else a part of them in turn.
MAX_CARVED_POINTS = 40_000
# Votes that a voxel keeps for its owner: this many frames of another opinion change it.
MAX_VOTES = MIN_READINGS
# A voxel is its owner's when the votes are one in this many of the frames that saw it.
VOTES_RATIO = 3


@dataclass(frozen=True, slots=True)
class PixelVoxels:
    """The voxel at each working pixel, and what the map knows of it.

    Attributes
    ----------
    slots : (h, w) int32
        Row of the voxel, -1 none; valid until the next frame is fused.
    owner : (h, w) int32
        Number of the object that it belongs to, 0 none.
    known : (h, w) bool
        Whether the map had a point there before this frame.
    """

    slots: npt.NDArray[np.int32]
    owner: npt.NDArray[np.int32]
    known: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class VoxelMapState(Record):
    """State of a `VoxelMap`, but for its rows: these are saved block by block.

    Attributes
    ----------
    visit : int
        Visits of the place before this one.
    most_hits : int
        As how many sightings those of earlier visits count, at most.
    first_frame : int or None
        Of this visit.
    looks : int
        Carving passes.
    waiting : int
        Frames since the last one.
    next_look : int
        The cube that the next one begins with.
    next_fine_look : int
        The fine cube that it begins with.
    moments : int
        Moments at which the camera had moved since the one before.
    parted : (N, 2) int64
        Cubes of which each voxel has a row of its own, and the moment since when; out of view for longest first.
    blocks : RowBlocksState
    anchors : AnchorsState
    """

    visit: int
    most_hits: int
    first_frame: int | None
    looks: int
    waiting: int
    next_look: int
    next_fine_look: int
    moments: int
    parted: npt.NDArray[np.int64]
    blocks: RowBlocksState
    anchors: AnchorsState


class VoxelMap(FinePoints):
    """Points of the scene with color, heat, and the object that each belongs to, in cubes of voxels.

    How they lie in memory, and where else: `StoredPoints`; how they follow corrections of poses: `MovingPoints`; which
    of them are there finer as well: `FinePoints`.

    Parameters
    ----------
    voxel_m : float
    noise_per_m : float
        Standard deviation of depth is this times z squared.
    max_depth_m : float
    memory_mb : float
        Memory of the process, in units of 2**20 bytes, beyond which cubes that are out of view are evicted.

    Attributes
    ----------
    before_visit : callable or None
        Called with rows of points that are as they were before the visit, when these are to be made ready for it.
    """

    # Rows are saved in blocks; what finds them follows from these.
    NOT_SAVED = frozenset(
        {
            *("voxel_m", "noise_per_m", "_max_depth_m", "memory_mb", "before_visit"),
            *("_row_memory", "_block_store", "_points", "_cubes", "_seen", "_marks", "_unindexed", "_last_viewed"),
            "_ready",
        }
    )

    def __init__(self, voxel_m: float, noise_per_m: float, max_depth_m: float, memory_mb: float = float("inf")) -> None:
        super().__init__(voxel_m, memory_mb)
        self.noise_per_m = noise_per_m
        self._max_depth_m = max_depth_m
        # The cube that the next carving pass begins with; the fine one.
        self._next_look = self._next_fine_look = 0
        # Frames since the last one.
        self._waiting = 0

    def state(self) -> VoxelMapState:
        """Return the state of now; nothing in it changes any more."""
        return VoxelMapState(
            self._visit, self._most_hits, self._first_frame, self._looks, self._waiting, self._next_look,
            self._next_fine_look, self._moments, self._parted.copy(), self._blocks.state(), self._anchors.state(),
        )  # fmt: skip

    @classmethod
    def from_state(
        cls, state: VoxelMapState, voxel_m: float, noise_per_m: float, max_depth_m: float, memory_mb: float
    ) -> VoxelMap:
        """Return a map that goes on from a state, without its rows: `restore` or `refill` must follow."""
        voxels = cls(voxel_m, noise_per_m, max_depth_m, memory_mb)
        voxels._visit, voxels._most_hits, voxels._first_frame = state.visit, state.most_hits, state.first_frame
        voxels._looks, voxels._waiting, voxels._moments = state.looks, state.waiting, state.moments
        voxels._next_look, voxels._next_fine_look = state.next_look, state.next_fine_look
        voxels._parted = state.parted
        voxels._blocks, voxels._anchors = RowBlocks.from_state(state.blocks), Anchors.from_state(state.anchors)
        return voxels

    @property
    def carving_passes(self) -> int:
        """How many frames have carved free space."""
        return self._looks

    def _cubes_in_frustum(self, image: WorkingImage, T_camera_world: Float64Array) -> Rows:
        """Return the cubes in the camera's frustum."""
        count = lookup.cubes_in_frustum(
            np.ascontiguousarray(T_camera_world), _pinhole(image), image.camera.width, image.camera.height,
            float(image.depth_m.max(initial=0.0)), self.voxel_m, self._cubes, self._seen,
        )  # fmt: skip
        return np.array(self._seen[:count])

    def relocate_in_frustum(self, image: WorkingImage, T_camera_world: Float64Array) -> None:
        """Apply the pending motions of points that lie, or come to lie, in the camera's frustum."""
        if not len(self._anchors.pending_cubes[0]):
            return
        c, R, t = image.camera, T_camera_world[:3, :3], T_camera_world[:3, 3]
        # A pixel more on each side than there is.
        sides = [(c.fx, 0, c.cx + 1), (-c.fx, 0, c.width - c.cx), (0, c.fy, c.cy + 1), (0, -c.fy, c.height - c.cy)]
        normals = np.array([*sides, (0, 0, 1), (0, 0, -1)], np.float64)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        beyond = np.array([0, 0, 0, 0, 0, float(image.depth_m.max(initial=0.0))])
        self._relocate_in(np.column_stack([normals @ R, normals @ t + beyond]))

    def fuse(
        self,
        image: WorkingImage,
        heat: Float32Array,
        T_world_camera: Float64Array,
        frame: int,
        anchor: int = 0,
        new_viewpoint: bool = True,
    ) -> npt.NDArray[np.int32]:
        """Fuse a frame: points that match a point of the map are averaged with it, others are added.

        Parameters
        ----------
        image : WorkingImage
        heat : (h, w) float32
        T_world_camera : (4, 4) float64
        frame : int
        anchor : int
            Keyframe that the frame is anchored to: its points move with it; see `apply_correction`.
        new_viewpoint : bool
            Whether the frame, or the one before it, is from a new viewpoint: else what is cold, walls and floors, is
            left out.

        Returns
        -------
        (h, w) int32
            Row of each working pixel, -1 where it was not fused; valid until the next call.
        """
        T_camera_world = inverse(T_world_camera)
        self.relocate_in_frustum(image, T_camera_world)
        seen = self._cubes_in_frustum(image, T_camera_world)
        self._last_viewed[seen] = self._looks
        if new_viewpoint:
            self.evict(seen)
        self._load(seen)
        self._pack(seen)
        used = int(self._cubes.used[0])
        begun, slots, current_anchor = self.blocks, np.empty(heat.shape, np.int32), self._anchors.current_anchor(anchor)
        if self._first_frame is None:
            self._first_frame = frame
        kernel.fuse(
            image.depth_m, image.color, heat, _pinhole(image), np.ascontiguousarray(T_world_camera), self.voxel_m,
            self._max_depth_m, frame, self._moments if new_viewpoint else -1, current_anchor, 0, self._cubes,
            self._points, slots,
        )  # fmt: skip
        self._moments += new_viewpoint
        self._ready[begun : self.blocks] = self._visit
        count = lookup.touched(slots, self._cubes.cube_of, self._marks, self._seen)
        self._anchors.has_points_in(current_anchor, self._seen[:count])
        self._schedule_thinning(np.concatenate([seen, np.arange(used, self._cubes.used[0])]))
        return slots

    def carve_free_space(self, image: WorkingImage, T_camera_world: Float64Array, new_viewpoint: bool = True) -> None:
        """Carve free space: count the points that rays of this frame pass, and remove those passed more often than hit.

        From the viewpoint of the last pass (not `new_viewpoint`) a frame carves the same: the next pass counts for it
        too.
        """
        self._looks += 1
        self._waiting += 1
        if not new_viewpoint:
            return
        seen = self._cubes_in_frustum(image, T_camera_world)
        self._load(seen)
        fine = self._fine(seen)
        self._next_look = self._carve_in_turn(seen[~fine], self._next_look, image, T_camera_world)
        self._next_fine_look = self._carve_in_turn(seen[fine], self._next_fine_look, image, T_camera_world)
        self._waiting = 0

    def _carve_in_turn(self, seen: Rows, first: int, image: WorkingImage, T_camera_world: Float64Array) -> int:
        """Carve the points of some cubes (N,), as many as a pass may, from one on; return the next one."""
        in_turn = np.concatenate([seen[seen >= first], seen[seen < first]])
        points = np.cumsum(self._cubes.rows[in_turn])
        now = in_turn[: 1 + int(np.searchsorted(points, MAX_CARVED_POINTS))]
        turns = max(1, -(-int(points[-1]) // MAX_CARVED_POINTS)) if len(points) else 1
        kernel.carve_free_space(
            now, image.depth_m, _pinhole(image),
            np.ascontiguousarray(T_camera_world), self.noise_per_m, 2 * self.voxel_m, turns * self._waiting,
            self.voxel_m, self._cubes, self._points,
        )  # fmt: skip
        return int(now[-1]) + 1 if len(now) < len(in_turn) else 0

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
        blocks = self._blocks_of(number)
        rows = np.empty(len(blocks) * BLOCK_ROWS, np.int64)
        p = self._points
        return rows[: owners.solid_rows_of(
            number, blocks, BLOCK_ROWS, p.owner, p.weight, p.confidence, p.hits, p.heat, np.float32(hot), votes,
            VOTES_RATIO, MAX_VOTES, rows,
        )]  # fmt: skip

    def vote_owners(
        self,
        claim: npt.NDArray[np.int32],
        number_of: npt.NDArray[np.int32],
        place: npt.NDArray[np.int64],
        allowed: UInt8Array,
        candidate: UInt8Array,
        slots: npt.NDArray[np.int32],
    ) -> None:
        """Let a frame's segments vote for the owners of their voxels; see `kernels.claims.vote_owners`."""
        pairs = np.unique(kernel_claims.vote_owners(
            claim, number_of, place, allowed, candidate, slots, self.hits, MAX_VOTES, self.owner,
            self._points.confidence, self._points.mark,
        ))  # fmt: skip
        self._blocks.add(pairs >> 32, pairs & 0xFFFFFFFF)

    def look_up(self, slots: npt.NDArray[np.int32]) -> PixelVoxels:
        """Return what the map knows of the voxel (h, w) of each pixel, -1 none."""
        owner, known = np.empty(slots.shape, np.int32), np.empty(slots.shape, np.bool_)
        owners.owner_of(slots, self.owner, self.hits, owner, known)
        return PixelVoxels(slots, owner, known)

    def seen_since(self, rows: Rows, frame: int) -> npt.NDArray[np.bool_]:
        """Tell of which rows (N,) a frame from some number on saw the point."""
        return np.asarray(self._points.last_frame[rows] >= frame)

    def rows_at(self, points: Float64Array) -> Rows:
        """Return the rows (N,) of the voxels at places (N, 3) of the world, -1 where there is no point."""
        points = np.ascontiguousarray(points)
        self._relocate_around(points, self.voxel_m)
        rows, missing = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
        asked = self.voxel_m, self._cubes, self._points.voxel, self._points.weight, rows, missing
        while absent := lookup.rows_at(points, *asked):
            self._load(missing[:absent])
        return rows

    def is_occupied(self, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Tell which places (N, 3) of the world lie in an occupied voxel."""
        return self.rows_at(points) >= 0

    def is_occupied_around(self, ground: Float64Array, axes: Float64Array, least: int) -> npt.NDArray[np.bool_]:
        """Tell at which places (N, 3) on a plane `least` of the nine voxels around, one up or down, hold a point.

        `axes` (3, 3) are, row by row, two axes of the plane and its normal.
        """
        ground, missing = np.ascontiguousarray(ground), np.empty(27 * len(ground), np.int64)
        self._relocate_around(ground, 2 * self.voxel_m)
        seen = np.empty(len(ground), np.bool_)
        asked = self.voxel_m, self._cubes, self._points.voxel, self._points.weight, seen, missing
        while absent := lookup.seen_around(ground, axes, self.voxel_m, least, *asked):
            self._load(missing[:absent])
        return seen

    def owner_at(self, points: Float64Array) -> npt.NDArray[np.int32]:
        """Return the owner of what was seen more than once at places (N, 3) of the world, -1 where nothing was."""
        rows = self.rows_at(points)
        return np.where((rows >= 0) & (self.hits[rows] > 1), self.owner[rows], -1).astype(np.int32)

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
