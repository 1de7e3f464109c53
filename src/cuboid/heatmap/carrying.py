"""Points that move with the keyframes they hang on, and what becomes of those that meet."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float32Array, Float64Array
from cuboid.kernels import voxels as kernel

Int32Array = npt.NDArray[np.int32]

# Stands for no one (0) where the oldest object is looked for.
_NO_ONE = np.iinfo(np.int32).max


def moved_with(points: Float32Array, anchor: Int32Array, moved: Mapping[int, Float64Array]) -> Float64Array:
    """Return points (N, 3) of the world after each has moved with its keyframe.

    Parameters
    ----------
    points : (N, 3) float32
    anchor : (N,) int32
        Keyframe of each.
    moved : mapping of int to (4, 4) float64
        T_new_old of the keyframes that move.
    """
    T = np.tile(np.eye(4), (max(int(anchor.max(initial=0)), *moved, 0) + 1, 1, 1))
    for keyframe, T_new_old in moved.items():
        T[keyframe] = T_new_old
    own = T[anchor]
    return np.asarray(np.einsum("nij,nj->ni", own[:, :3, :3], points.astype(np.float64)) + own[:, :3, 3])


def keys_of(points: Float64Array, voxel_m: float) -> npt.NDArray[np.int64]:
    """Return the keys (N,) of the voxels that hold points (N, 3)."""
    x, y, z = (np.floor(points / voxel_m).astype(np.int64) + kernel.KEY_OFFSET).T
    return np.asarray((x << (2 * kernel.KEY_BITS)) | (y << kernel.KEY_BITS) | z)


def average(values: Float32Array, points: Float64Array, first: npt.NDArray[np.int64]) -> Float32Array:
    """Return the means (M, 8) of runs of voxels' values, with these new places, and the sums of their weights.

    Parameters
    ----------
    values : (N, 8) float32
        Of the map, in the order of their voxels.
    points : (N, 3) float64
    first : (M,) int64
        Where each run begins.
    """
    weighted = values.astype(np.float64)
    weighted[:, kernel.X : kernel.Z + 1] = points
    weighted[:, : kernel.WEIGHT] *= weighted[:, kernel.WEIGHT :]
    together = np.add.reduceat(weighted, first)
    together[:, : kernel.WEIGHT] /= together[:, kernel.WEIGHT :]
    return np.asarray(together, np.float32)


def oldest(owner: Int32Array, first: npt.NDArray[np.int64]) -> Int32Array:
    """Return the oldest object (M,) of each run of owners (N,), 0 where there is none."""
    best = np.minimum.reduceat(np.where(owner > 0, owner, _NO_ONE), first)
    return np.where(best == _NO_ONE, 0, best).astype(np.int32)
