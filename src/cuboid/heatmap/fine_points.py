"""The fine level of the map: what belongs to small objects is kept in voxels of half the edge as well."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.core.frame import Float32Array, Float64Array
from cuboid.core.working import WorkingImage
from cuboid.heatmap.kernels import lookup, owners
from cuboid.heatmap.kernels import voxels as kernel
from cuboid.heatmap.kernels.cubes import CUBE_SIDE, FINE, KEY_OFFSET, keys_of
from cuboid.heatmap.moving_points import MovingPoints
from cuboid.heatmap.stored_points import Rows


class FinePoints(MovingPoints):
    """Points of which some are there a second time, finer: those of fine cubes, whose voxels have half the edge.

    They lie in cubes, blocks and rows as all others do, are moved, evicted and carved as these;
    nothing is decided by them. Whom a fine point belongs to is what the voxel of the map around it says: no owner and
    no votes are kept of it, and where that voxel holds no point it is not there.
    """

    @property
    def fine_m(self) -> float:
        """Edge of the voxels of fine cubes, metres."""
        return self.voxel_m / 2

    @property
    def reach_m(self) -> float:
        """How far from the world's origin, along each axis, fine cubes have keys, metres: 168 km at voxels of 1 cm."""
        return KEY_OFFSET * CUBE_SIDE * self.fine_m

    @property
    def small_m(self) -> float:
        """Longest side of what is worth finer voxels, metres: no more voxels of the map than a cube has."""
        return CUBE_SIDE * self.voxel_m

    def refine(
        self,
        image: WorkingImage,
        heat: Float32Array,
        T_world_camera: Float64Array,
        frame: int,
        anchor: int,
        slots: npt.NDArray[np.int32],
        numbers: npt.NDArray[np.bool_],
        far_m: float,
    ) -> None:
        """Fuse what a frame shows of some objects into fine voxels, after it was fused and voted.

        Parameters
        ----------
        image, heat, T_world_camera, frame, anchor
            As of `VoxelMap.fuse`.
        slots : (h, w) int32
            What that returned.
        numbers : (M,) bool
            Tells of the objects by number; there is no such object from M on.
        far_m : float
            Readings beyond are not distinguished so finely.
        """
        chosen = np.empty_like(image.depth_m)
        top, bottom, left, right = owners.choose(slots, self.owner, numbers, image.depth_m, far_m, chosen)
        if bottom <= top:
            return
        inside, c = (slice(top, bottom), slice(left, right)), image.camera
        depth, color, warm = (np.ascontiguousarray(a[inside]) for a in (chosen, image.color, heat))
        begun, rows, current_anchor = self.blocks, np.empty(depth.shape, np.int32), self._anchors.current_anchor(anchor)
        kernel.fuse(
            depth, color, warm, np.array([c.fx, c.fy, c.cx - left, c.cy - top]),
            np.ascontiguousarray(T_world_camera), self.fine_m, far_m, frame, frame, current_anchor, FINE, self._cubes,
            self._points, rows,
        )  # fmt: skip
        self._ready[begun : self.blocks] = self._visit
        count = lookup.touched(rows, self._cubes.cube_of, self._marks, self._seen)
        self._anchors.has_points_in(current_anchor, self._seen[:count])
        self._last_viewed[self._seen[:count]] = self._looks

    def fine_replacements(self, xyz: Float32Array, which: npt.NDArray[np.bool_]) -> tuple[Rows, Rows]:
        """Return the rows (M,) of fine points that are what points of the map are, finer, and which (M,) these are.

        Parameters
        ----------
        xyz : (N, 3) float32
            Points of the map in the world.
        which : (N,) bool
            Those that are asked for.
        """
        fine, own = self.living(fine=True), np.flatnonzero(which)
        keys, asked = (keys_of(np.floor(p.astype(np.float64) / self.voxel_m).astype(np.int64))
                       for p in (xyz[own], self.xyz(fine)))  # fmt: skip
        order = np.argsort(keys, kind="stable")
        at = np.searchsorted(keys, asked, sorter=order)
        there = at < len(keys)
        there[there] = keys[order[at[there]]] == asked[there]
        return fine[there], own[order[at[there]]]
