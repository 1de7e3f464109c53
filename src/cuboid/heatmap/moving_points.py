"""The points of the map as poses are corrected: they owe motions, until somebody looks where they lie or belong."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float64Array
from cuboid.heatmap.anchors import of_each
from cuboid.heatmap.levels import LevelledPoints
from cuboid.heatmap.stored_points import Rows
from cuboid.kernels import carrying as kernel
from cuboid.kernels import cubes as kernel_cubes
from cuboid.kernels import lookup
from cuboid.kernels.cubes import BLOCK_BITS, columns_of

# Fewer cubes than this that hold nothing are no burden.
LEAST_DESERTED = 64


class MovingPoints(LevelledPoints):
    """Points that move with the keyframes that they hang on; see `Anchors`."""

    def carry(self, moved: Mapping[int, Float64Array]) -> None:
        """Let points move with the keyframes that they hang on: as soon as somebody looks where they are.

        Those that then meet in one voxel become one: of two, the oldest object's keeps the owner; hits and passes add
        up.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old of each keyframe whose surroundings move.
        """
        if not self._anchors.complete:
            self._bring_all()
            self._find_anchors()
        # Past moves may have left many cubes that hold nothing: then all is put down anew, without these.
        cubes = np.flatnonzero(~self._fine(np.arange(self._cubes.used[0])))
        if self._anchors.crowded or 2 * self._deserted(cubes) > max(LEAST_DESERTED, len(cubes)):
            self.settle_all()
        self._cubes.mixed[self._anchors.owe(moved)] = True

    def _deserted(self, cubes: Rows) -> int:
        """Return how many of some cubes (N,) have no living row."""
        return int(np.count_nonzero(self._cubes.rows[cubes] == self._cubes.dead[cubes]))

    def _settle_in(self, spaces: Float64Array) -> None:
        """Have nothing that owes a motion lie or belong in a region; see `lookup.reach`."""
        cube, anchor = self._anchors.owing
        if not len(cube):
            return
        reaches = np.empty(len(cube), bool)
        lookup.reach(spaces, cube, anchor, self._anchors.motions, self.voxel_m, self._cubes, reaches)
        if reaches.any():
            self._settle(np.unique(cube[reaches]).astype(np.int64))

    def _settle_around(self, points: Float64Array, beside_m: float) -> None:
        """Have nothing that owes a motion among points (N, 3) of the world, and so far beside them."""
        if len(points) and len(self._anchors.owing[0]):
            low, high = points.min(0) - beside_m, points.max(0) + beside_m
            self._settle_in(np.column_stack([np.concatenate([np.eye(3), -np.eye(3)]), np.concatenate([-low, high])]))

    def _settle(self, cubes: Rows) -> None:
        """Let all points in cubes (N,), ascending, move as they owe, and enter the cubes where they come to lie."""
        self._bring(cubes)
        rows = np.empty(int(self._cubes.rows[cubes].sum()), np.int64)
        rows = rows[: kernel.owing(cubes, self._cubes, self._points, rows)]
        taken, keys = self._room.rows[rows], self._cubes.key[self._cubes.cube_of[rows >> BLOCK_BITS]]
        kernel.leave(cubes, self._cubes, self._points)
        self._pack_all(cubes)
        to = np.empty(len(keys), np.int64)
        count = kernel.move(keys, columns_of(taken), self._anchors.owes, self._anchors.motions, self.voxel_m, to)
        found = np.empty(count, np.int64)
        kernel_cubes.cubes_at(to[:count], self._cubes, found)
        found = np.unique(found[found >= 0])
        self._bring(found)
        for cube in found[self._cubes.mixed[found]]:
            kernel_cubes.fill_index(cube, self._cubes, self._points)
        self._enter(keys, taken)
        self._anchors.settled(cubes)

    def _enter(self, keys: npt.NDArray[np.int64], taken: npt.NDArray[Any]) -> None:
        """Let points that have moved enter the cubes of these keys."""
        columns = columns_of(taken)
        now, begun, rows = self._anchors.now(columns.anchor), self.blocks, np.empty(len(keys), np.int64)
        kernel.settle(keys, columns, now, self._cubes, self._points, rows)
        self._ready[begun : self.blocks] = self._visit
        rows = rows[rows >= 0]
        cubes = self._cubes.cube_of[rows >> BLOCK_BITS]
        self._blocks.give_rows(self.owner[rows], rows >> BLOCK_BITS)
        for number, some in of_each(self._points.anchor[rows], cubes):
            self._anchors.has_points_in(number, some)
        self._opened(np.unique(cubes).astype(np.int64))

    def settle_all(self) -> None:
        """Let all points move as they owe, and put all down anew, without cubes that hold nothing."""
        self._bring_all()
        rows = self._all_living()
        taken, keys = self._room.rows[rows], self._cubes.key[self._cubes.cube_of[rows >> BLOCK_BITS]]
        columns, to = columns_of(taken), np.empty(len(keys), np.int64)
        kernel.move(keys, columns, self._anchors.owes, self._anchors.motions, self.voxel_m, to)
        columns.anchor[:] = self._anchors.keyframes(columns.anchor)
        self._anchors.begin_anew(columns.anchor[:0], rows[:0])
        self._begin_anew()
        for keyframe in np.unique(columns.anchor).tolist():
            self._anchors.hang(keyframe)
        self._enter(keys, taken)
