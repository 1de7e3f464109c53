"""The fine level of the map: points of small objects are also kept in voxels of half the edge."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array
from cuboid.ground.core.observation import Observation
from cuboid.method.heatmap.kernels import owners
from cuboid.method.heatmap.kernels import voxels as kernel
from cuboid.method.heatmap.kernels.cubes import CUBE_SIDE, FINE, KEY_OFFSET, keys_of
from cuboid.method.heatmap.stored_points import Rows, StoredPoints


class FinePoints:
    """Finer copies of points, in fine cubes whose voxels have half the edge.

    They are stored in cubes, blocks and rows like all other points, and are moved, evicted and carved like them; no
    decision depends on them. The owner of a fine point is the owner of the map voxel around it: a fine point has no
    owner and no votes, and does not count if that voxel has no point.

    Parameters
    ----------
    stored : StoredPoints
    """

    def __init__(self, stored: StoredPoints) -> None:
        self._stored = stored

    @property
    def fine_m(self) -> float:
        """Edge of the voxels of fine cubes, metres."""
        return self._stored.voxel_m / 2

    @property
    def reach_m(self) -> float:
        """Largest coordinate for which fine cubes have keys, along each axis, metres: 168 km for voxels of 1 cm."""
        return KEY_OFFSET * CUBE_SIDE * self.fine_m

    @property
    def small_m(self) -> float:
        """Longest side of objects that get fine voxels, metres: the side of a cube."""
        return CUBE_SIDE * self._stored.voxel_m

    def refine(
        self,
        seen: Observation,
        heat: Float32Array,
        slots: npt.NDArray[np.int32],
        numbers: npt.NDArray[np.bool_],
        far_m: float,
    ) -> None:
        """Fuse a frame's points of some objects into fine voxels, after the frame was fused and its votes counted.

        Parameters
        ----------
        seen : Observation
        heat : (h, w) float32
        slots : (h, w) int32
            The rows into which its pixels were fused.
        numbers : (M,) bool
            Whether each object, by number, is refined; objects from M on are not.
        far_m : float
            Readings beyond this distance are not precise enough for fine voxels.
        """
        stored, image = self._stored, seen.image
        chosen = np.empty_like(image.depth_m)
        top, bottom, left, right = owners.choose(slots, stored.owner, numbers, image.depth_m, far_m, chosen)
        if bottom <= top:
            return
        inside, c = (slice(top, bottom), slice(left, right)), image.camera
        depth_m, heat = (np.ascontiguousarray(image_part[inside]) for image_part in (chosen, heat))
        color = np.ascontiguousarray(image.color[inside])
        pinhole = np.array([c.fx, c.fy, c.cx - left, c.cy - top])
        pixels = kernel.Pixels(depth_m, color, heat, pinhole, np.ascontiguousarray(seen.T_world_camera))
        rows = np.empty(depth_m.shape, np.int32)
        fused_in = stored.fuse(pixels, far_m, seen.frame, seen.frame, seen.keyframe, rows, FINE)
        stored.last_viewed[fused_in] = stored.carving_passes

    def fine_replacements(self, xyz: Float32Array, replaced: npt.NDArray[np.bool_]) -> tuple[Rows, Rows]:
        """Return the rows (M,) of fine points that replace points of the map, and the indices (M,) of the latter.

        Parameters
        ----------
        xyz : (N, 3) float32
            Points of the map in the world.
        replaced : (N,) bool
            The points to replace.
        """
        fine, indices = self._stored.living(fine=True), np.flatnonzero(replaced)
        keys, wanted = self._voxels_of(xyz[indices]), self._voxels_of(self._stored.xyz(fine))
        order = np.argsort(keys, kind="stable")
        at = np.searchsorted(keys, wanted, sorter=order)
        found = at < len(keys)
        found[found] = keys[order[at[found]]] == wanted[found]
        return fine[found], indices[order[at[found]]]

    def _voxels_of(self, points: Float32Array) -> npt.NDArray[np.int64]:
        """Return a unique number of the map's voxel that contains each point (N, 3)."""
        return keys_of(np.floor(points.astype(np.float64) / self._stored.voxel_m).astype(np.int64))
