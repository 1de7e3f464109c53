"""The global 3D heatmap: points averaged over all their sightings, in a hashed voxel map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.state import Record
from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.ground.core.working import WorkingImage
from cuboid.ground.geometry.se3 import inverse
from cuboid.method.heatmap.anchors import Anchors, AnchorsState
from cuboid.method.heatmap.fine_points import FinePoints
from cuboid.method.heatmap.kernels import claims as kernel_claims
from cuboid.method.heatmap.kernels import lookup, owners
from cuboid.method.heatmap.kernels import voxels as kernel
from cuboid.method.heatmap.kernels.cubes import BLOCK_BITS, BLOCK_ROWS
from cuboid.method.heatmap.levels import Levels, LevelsState
from cuboid.method.heatmap.moving_points import MovingPoints
from cuboid.method.heatmap.stored_points import Rows, StoredPoints, StoredPointsState

# Points that a frame carves: all in view if there are few, otherwise a part of them in turn.
MAX_CARVED_POINTS = 40_000
# Largest number of votes of a voxel for its owner: this many frames with another opinion change it.
MAX_VOTES = MIN_READINGS
# A voxel belongs to its owner if the votes are at least 1/VOTES_RATIO of the frames that saw it.
VOTES_RATIO = 3


@dataclass(frozen=True, slots=True)
class PixelVoxels:
    """The voxel at each working pixel, with its owner.

    Attributes
    ----------
    slots : (h, w) int32
        Row of the voxel, -1: none; valid until the next frame is fused.
    owner : (h, w) int32
        Number of the object that owns it, 0: none.
    mapped : (h, w) bool
        Whether the map had a point there before this frame.
    """

    slots: npt.NDArray[np.int32]
    owner: npt.NDArray[np.int32]
    mapped: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class VoxelMapState(Record):
    """State of a `VoxelMap`, except for its rows, which are saved block by block.

    Attributes
    ----------
    stored : StoredPointsState
    anchors : AnchorsState
    levels : LevelsState
    waiting : int
        Number of frames since the last carving pass.
    next_look : int
        First cube of the next carving pass.
    next_fine_look : int
        First fine cube of the next carving pass.
    """

    stored: StoredPointsState
    anchors: AnchorsState
    levels: LevelsState
    waiting: int
    next_look: int
    next_fine_look: int


class VoxelMap:
    """Points of the scene with color, heat and owning object, in cubes of voxels.

    Parameters
    ----------
    voxel_m : float
    noise_per_m : float
        The standard deviation of depth is this value times z squared.
    max_depth_m : float
    memory_mb : float
        Memory limit of the process, in units of 2**20 bytes, above which cubes out of view are evicted.

    Attributes
    ----------
    stored : StoredPoints
        The points, their storage, and their owners.
    levels : Levels
        Levels of detail: points that share a row.
    moving : MovingPoints
        Pose corrections of the points.
    fine : FinePoints
        Finer copies of points of small objects.
    """

    NOT_SAVED = frozenset({"voxel_m", "noise_per_m", "_max_depth_m", "moving", "fine"})

    def __init__(self, voxel_m: float, noise_per_m: float, max_depth_m: float, memory_mb: float = float("inf")) -> None:
        stored = StoredPoints(voxel_m, Anchors(), memory_mb)
        self._assemble(stored, Levels(stored), noise_per_m, max_depth_m)

    def _assemble(self, stored: StoredPoints, levels: Levels, noise_per_m: float, max_depth_m: float) -> None:
        self.voxel_m, self.noise_per_m, self._max_depth_m = stored.voxel_m, noise_per_m, max_depth_m
        self.stored, self.anchors, self.levels = stored, stored.anchors, levels
        self.moving, self.fine = MovingPoints(stored, levels), FinePoints(stored)
        # First cube and first fine cube of the next carving pass.
        self._next_look = self._next_fine_look = 0
        # Number of frames of each camera of the rig since its last pass.
        self._waiting: dict[str, int] = {}

    def state(self) -> VoxelMapState:
        """Return the current state; later updates do not change it."""
        parts = self.stored.state(), self.anchors.state(), self.levels.state()
        return VoxelMapState(*parts, self._waiting.get("", 0), self._next_look, self._next_fine_look)

    @classmethod
    def from_state(
        cls, state: VoxelMapState, voxel_m: float, noise_per_m: float, max_depth_m: float, memory_mb: float
    ) -> VoxelMap:
        """Return a map that continues from a state, without its rows: `restore` or `refill` must follow."""
        voxels = cls.__new__(cls)
        stored = StoredPoints.from_state(state.stored, voxel_m, Anchors.from_state(state.anchors), memory_mb)
        voxels._assemble(stored, Levels.from_state(state.levels, stored), noise_per_m, max_depth_m)
        voxels._waiting, voxels._next_look = {"": state.waiting}, state.next_look
        voxels._next_fine_look = state.next_fine_look
        return voxels

    def refill(self, keys: npt.NDArray[np.int64], rows: npt.NDArray[Any]) -> None:
        """Replace all points by these; see `StoredPoints.refill`."""
        self.levels.forget()
        self.stored.refill(keys, rows)

    def begin_visit(self, most_hits: int) -> None:
        """Limit the weight of earlier sightings to `most_hits`; see `StoredPoints.begin_visit`."""
        self.levels.begin_visit()
        self.stored.begin_visit(most_hits)

    def _cubes_in_frustum(self, image: WorkingImage, T_camera_world: Float64Array) -> Rows:
        """Return the cubes in the camera's frustum."""
        T, pinhole, camera = np.ascontiguousarray(T_camera_world), image.camera.pinhole, image.camera
        far_m, stored = float(image.depth_m.max(initial=0.0)), self.stored
        view = T, pinhole, camera.width, camera.height, far_m, self.voxel_m, stored.cubes, stored.seen
        return np.array(stored.seen[: lookup.cubes_in_frustum(*view)])

    def relocate_in_frustum(self, image: WorkingImage, T_camera_world: Float64Array) -> None:
        """Apply the pending motions of points that lie in the camera's frustum, or move into it."""
        if not len(self.anchors.pending_cubes[0]):
            return
        c, R, t = image.camera, T_camera_world[:3, :3], T_camera_world[:3, 3]
        # One pixel larger on each side than the image.
        sides = [(c.fx, 0, c.cx + 1), (-c.fx, 0, c.width - c.cx), (0, c.fy, c.cy + 1), (0, -c.fy, c.height - c.cy)]
        normals = np.array([*sides, (0, 0, 1), (0, 0, -1)], np.float64)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        far_m = np.array([0, 0, 0, 0, 0, float(image.depth_m.max(initial=0.0))])
        self.moving.relocate_in(np.column_stack([normals @ R, normals @ t + far_m]))

    def fuse(
        self,
        image: WorkingImage,
        heat: Float32Array,
        T_world_camera: Float64Array,
        frame: int,
        anchor: int = 0,
        new_viewpoint: bool = True,
    ) -> npt.NDArray[np.int32]:
        """Fuse a frame: points in an occupied voxel are averaged with its point, others are added.

        Parameters
        ----------
        image : WorkingImage
        heat : (h, w) float32
        T_world_camera : (4, 4) float64
        frame : int
        anchor : int
            Keyframe to which the frame is anchored: its points move with it; see `apply_correction`.
        new_viewpoint : bool
            Whether the frame, or the previous one, is from a new viewpoint; otherwise cold pixels, such as walls and
            floors, are not fused.

        Returns
        -------
        (h, w) int32
            Row of each working pixel, -1 if it was not fused; valid until the next call.
        """
        T_camera_world, stored = inverse(T_world_camera), self.stored
        self.relocate_in_frustum(image, T_camera_world)
        seen = self._cubes_in_frustum(image, T_camera_world)
        stored.last_viewed[seen] = stored.carving_passes
        if new_viewpoint:
            stored.evict(seen)
        self.levels.load(seen)
        stored.pack(seen)
        self.levels.note_frame(frame)
        used, slots, turn = int(stored.cubes.used[0]), np.empty(heat.shape, np.int32), self.levels.moments
        pixels = kernel.Pixels(
            image.depth_m, image.color, heat, image.camera.pinhole, np.ascontiguousarray(T_world_camera)
        )
        stored.fuse(pixels, self._max_depth_m, frame, turn if new_viewpoint else -1, anchor, slots)
        self.levels.moments += new_viewpoint
        self.levels.schedule_thinning(np.concatenate([seen, np.arange(used, stored.cubes.used[0])]))
        return slots

    def carve_free_space(
        self, image: WorkingImage, T_camera_world: Float64Array, new_viewpoint: bool = True, camera: str = ""
    ) -> None:
        """Carve free space: count the points that rays of this frame pass, and remove those passed more often than hit.

        A frame from the same viewpoint as the last pass of its camera (`new_viewpoint` is False) would carve the same
        points: the next pass of this camera counts for it, too.
        """
        self.stored.carving_passes += 1
        waiting = self._waiting[camera] = self._waiting.get(camera, 0) + 1
        if not new_viewpoint:
            return
        seen = self._cubes_in_frustum(image, T_camera_world)
        self.levels.load(seen)
        fine = self.stored.is_fine(seen)
        view = image, T_camera_world, waiting
        self._next_look = self._carve_in_turn(seen[~fine], self._next_look, *view)
        self._next_fine_look = self._carve_in_turn(seen[fine], self._next_fine_look, *view)
        self._waiting[camera] = 0

    def _carve_in_turn(
        self, seen: Rows, first: int, image: WorkingImage, T_camera_world: Float64Array, frames: int
    ) -> int:
        """Carve the points of cubes (N,) within the limit of a pass, from cube `first` on; return the next cube.

        The pass counts for `frames` frames.
        """
        in_turn = np.concatenate([seen[seen >= first], seen[seen < first]])
        stored = self.stored
        count = np.cumsum(stored.cubes.rows[in_turn])
        chosen = in_turn[: 1 + int(np.searchsorted(count, MAX_CARVED_POINTS))]
        turns = max(1, -(-int(count[-1]) // MAX_CARVED_POINTS)) if len(count) else 1
        T, noise, cubes, points = np.ascontiguousarray(T_camera_world), self.noise_per_m, stored.cubes, stored.points
        margin_m, step, view = 2 * self.voxel_m, turns * frames, (image.depth_m, image.camera.pinhole, T)
        kernel.carve_free_space(chosen, *view, noise, margin_m, step, self.voxel_m, cubes, points)
        return int(chosen[-1]) + 1 if len(chosen) < len(in_turn) else 0

    def solid_rows_of(self, number: int, hot: float, votes: int) -> Rows:
        """Return the rows of an object, ascending, that are hot and have enough votes.

        Parameters
        ----------
        number : int
        hot : float
            Smallest heat.
        votes : int
            Smallest number of votes.
        """
        blocks, p, warm = self.stored.blocks_of(number), self.stored.points, np.float32(hot)
        rows = np.empty(len(blocks) * BLOCK_ROWS, np.int64)
        columns = p.owner, p.weight, p.confidence, p.hits, p.heat
        limits = warm, votes, VOTES_RATIO, MAX_VOTES
        return rows[: owners.solid_rows_of(number, blocks, BLOCK_ROWS, *columns, *limits, rows)]

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
        p, frame = self.stored.points, (claim, number_of, place, allowed, candidate, slots)
        pairs = kernel_claims.vote_owners(*frame, p.hits, MAX_VOTES, p.owner, p.confidence, p.mark)
        pairs = np.unique(pairs)
        self.stored.owned_blocks.add(pairs >> 32, pairs & 0xFFFFFFFF)

    def claim(self, rows: Rows, number: int) -> None:
        """Assign rows (N,) without an owner to an object, with the largest number of votes."""
        rows = np.unique(rows[self.stored.owner[rows] == 0])
        self.stored.owner[rows], self.stored.points.confidence[rows] = number, MAX_VOTES
        self.stored.owned_blocks.add_rows(self.stored.owner[rows], rows >> BLOCK_BITS)

    def look_up(self, slots: npt.NDArray[np.int32]) -> PixelVoxels:
        """Return the voxel of each pixel, given its row (h, w), with its owner and whether it was mapped before."""
        owner, mapped = np.empty(slots.shape, np.int32), np.empty(slots.shape, np.bool_)
        owners.owner_of(slots, self.stored.owner, self.stored.hits, owner, mapped)
        return PixelVoxels(slots, owner, mapped)

    def rows_at(self, points: Float64Array) -> Rows:
        """Return the rows (N,) of the voxels at world points (N, 3), -1 if there is no point."""
        points = np.ascontiguousarray(points)
        self.moving.relocate_around(points, self.voxel_m)
        rows, missing = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
        tables = self.voxel_m, self.stored.cubes, self.stored.points.voxel, self.stored.points.weight, rows, missing
        while count := lookup.rows_at(points, *tables):
            self.levels.load(missing[:count])
        return rows

    def is_occupied_around(self, ground: Float64Array, axes: Float64Array, min_columns: int) -> npt.NDArray[np.bool_]:
        """Return around which places (N, 3) on a plane at least `min_columns` of nine columns hold a point.

        A column is three voxels high along the normal. The rows of `axes` (3, 3) are two axes of the plane and its
        normal.
        """
        ground, missing = np.ascontiguousarray(ground), np.empty(27 * len(ground), np.int64)
        self.moving.relocate_around(ground, 2 * self.voxel_m)
        occupied = np.empty(len(ground), np.bool_)
        tables = self.voxel_m, self.stored.cubes, self.stored.points.voxel, self.stored.points.weight, occupied, missing
        while count := lookup.seen_around(ground, axes, self.voxel_m, min_columns, *tables):
            self.levels.load(missing[:count])
        return occupied

    def owner_at(self, points: Float64Array) -> npt.NDArray[np.int32]:
        """Return the owners at world points (N, 3), from points that two frames or more saw; 0: none, -1: no point."""
        rows = self.rows_at(points)
        return np.where((rows >= 0) & (self.stored.hits[rows] > 1), self.stored.owner[rows], -1).astype(np.int32)
