"""Lazy pose correction of the map's points: motions stay pending until the region of the points is accessed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.method.heatmap.anchors import of_each
from cuboid.method.heatmap.kernels import corrections as kernel
from cuboid.method.heatmap.kernels import cubes as kernel_cubes
from cuboid.method.heatmap.kernels import lookup
from cuboid.method.heatmap.kernels.cubes import BLOCK_BITS, Points, columns_of
from cuboid.method.heatmap.levels import Levels
from cuboid.method.heatmap.stored_points import Rows, StoredPoints

# Up to this number, empty cubes are tolerated.
MIN_EMPTY_CUBES = 64


class MovingPoints:
    """Moves points with the keyframes to which they are anchored; see `Anchors`.

    Parameters
    ----------
    stored : StoredPoints
    levels : Levels
    """

    def __init__(self, stored: StoredPoints, levels: Levels) -> None:
        self._stored, self._levels = stored, levels
        self._anchors = stored.anchors

    def apply_correction(self, moved: Mapping[int, Float64Array]) -> None:
        """Move points with their keyframes, lazily: when the region of the points is accessed.

        Points that then meet in one voxel are merged: the owner is the oldest of their objects; hits and passes are
        added.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old of each keyframe that moved.
        """
        # Past motions may have left many empty cubes: then the map is rebuilt without them.
        cubes = np.flatnonzero(~self._stored.is_fine(np.arange(self._stored.cubes.used[0])))
        if self._anchors.crowded or 2 * self._count_empty(cubes) > max(MIN_EMPTY_CUBES, len(cubes)):
            self.relocate_all()
        self._stored.cubes.index_stale[self._anchors.add_pending(moved)] = True

    def _count_empty(self, cubes: Rows) -> int:
        """Return the number of cubes among some (N,) without a living row."""
        return int(np.count_nonzero(self._stored.cubes.rows[cubes] == self._stored.cubes.dead[cubes]))

    def relocate_in(self, spaces: Float64Array) -> None:
        """Apply all pending motions of points that lie in a region, or move into it; see `lookup.cubes_meeting`."""
        cube, anchor = self._anchors.pending_cubes
        if not len(cube):
            return
        meets = np.empty(len(cube), bool)
        lookup.cubes_meeting(
            spaces, cube, anchor, self._anchors.motions, self._stored.voxel_m, self._stored.cubes, meets
        )
        if meets.any():
            self._relocate(np.unique(cube[meets]).astype(np.int64))

    def relocate_around(self, points: Float64Array, margin_m: float) -> None:
        """Apply all pending motions around points (N, 3) of the world, within a distance."""
        if len(points) and len(self._anchors.pending_cubes[0]):
            low, high = points.min(0) - margin_m, points.max(0) + margin_m
            self.relocate_in(np.column_stack([np.concatenate([np.eye(3), -np.eye(3)]), np.concatenate([-low, high])]))

    def _relocate(self, cubes: Rows) -> None:
        """Apply the pending motions in cubes (N,), ascending, and insert the points into their new cubes."""
        self._levels.load(cubes)
        rows = np.empty(int(self._stored.cubes.rows[cubes].sum()), np.int64)
        rows = rows[: kernel.pending_rows(cubes, self._stored.cubes, self._stored.points, rows)]
        taken, keys = self._copied(rows)
        kernel.remove_pending(cubes, self._stored.cubes, self._stored.points)
        self._stored.pack_all(cubes)
        new_keys = self._apply_motions(keys, columns_of(taken))
        new_cubes = np.empty(len(new_keys), np.int64)
        kernel_cubes.cubes_at(new_keys, self._stored.cubes, new_cubes)
        new_cubes = np.unique(new_cubes[new_cubes >= 0])
        self._levels.load(new_cubes)
        for cube in new_cubes[self._stored.cubes.index_stale[new_cubes]]:
            kernel_cubes.fill_index(cube, self._stored.cubes, self._stored.points)
        self._enter(keys, taken)
        self._anchors.clear_pending(cubes)

    def _copied(self, rows: Rows) -> tuple[npt.NDArray[Any], npt.NDArray[np.int64]]:
        """Return copies of rows (N,) of the map, and the keys (N,) of their cubes."""
        cubes = self._stored.cubes
        return self._stored.memory.rows[rows], cubes.key[cubes.cube_of[rows >> BLOCK_BITS]]

    def _apply_motions(self, keys: npt.NDArray[np.int64], columns: Points) -> npt.NDArray[np.int64]:
        """Move points with their keys, in place; return the keys of their new cubes. See `kernel.apply_motions`."""
        anchors, new_keys = self._anchors, np.empty(len(keys), np.int64)
        motions = anchors.pending, anchors.motions
        return new_keys[: kernel.apply_motions(keys, columns, *motions, self._stored.voxel_m, new_keys)]

    def _enter(self, keys: npt.NDArray[np.int64], taken: npt.NDArray[Any]) -> None:
        """Insert moved points into the cubes with these keys."""
        columns = columns_of(taken)
        current, first_new = self._anchors.anchors_after_motion(columns.anchor), self._stored.blocks
        rows = np.empty(len(keys), np.int64)
        kernel.insert_points(keys, columns, current, self._stored.cubes, self._stored.points, rows)
        self._stored.note_new_blocks(first_new)
        rows = rows[rows >= 0]
        cubes = self._stored.cubes.cube_of[rows >> BLOCK_BITS]
        self._stored.owned_blocks.add_rows(self._stored.owner[rows], rows >> BLOCK_BITS)
        for number, cubes_of_anchor in of_each(self._stored.points.anchor[rows], cubes):
            self._anchors.has_points_in(number, cubes_of_anchor)
        self._levels.mark_viewed(np.unique(cubes).astype(np.int64))

    def relocate_all(self) -> None:
        """Apply all pending motions, and rebuild the map without empty cubes."""
        self._levels.load(np.arange(self._stored.cubes.used[0]))
        rows = self._stored.all_living()
        taken, keys = self._copied(rows)
        columns = columns_of(taken)
        self._apply_motions(keys, columns)
        columns.anchor[:] = self._anchors.keyframes(columns.anchor)
        self._anchors.begin_anew(columns.anchor[:0], rows[:0])
        self._levels.forget()
        self._stored.begin_anew()
        for keyframe in np.unique(columns.anchor).tolist():
            self._anchors.current_anchor(keyframe)
        self._enter(keys, taken)
