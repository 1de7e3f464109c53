"""Points that move with the keyframes they hang on, and what becomes of those that meet."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float32Array, Float64Array
from cuboid.kernels.cubes import KEY_BITS, KEY_OFFSET

Int32Array = npt.NDArray[np.int32]

# Columns of values: x, y, z, red, green, blue, heat, weight.
_WEIGHT = 7

# Stands for no one (0) where the oldest object is looked for.
_NO_ONE = np.iinfo(np.int32).max


def moved_with(
    points: Float32Array, anchor: npt.NDArray[np.integer], moved: Mapping[int, Float64Array]
) -> Float64Array:
    """Return points (N, 3) of the world after each has moved with its keyframe.

    Parameters
    ----------
    points : (N, 3) float32
    anchor : (N,) uint16
        Keyframe of each.
    moved : mapping of int to (4, 4) float64
        T_new_old of the keyframes that move.
    """
    T = np.tile(np.eye(4), (max(int(anchor.max(initial=0)), *moved, 0) + 1, 1, 1))
    for keyframe, T_new_old in moved.items():
        T[keyframe] = T_new_old
    own = T[anchor]
    return np.asarray(np.einsum("nij,nj->ni", own[:, :3, :3], points.astype(np.float64)) + own[:, :3, 3])


def keys_of(voxels: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return numbers (N,), different for different voxels (N, 3)."""
    x, y, z = (voxels + KEY_OFFSET).T
    return np.asarray((x << (2 * KEY_BITS)) | (y << KEY_BITS) | z)


def average(values: Float64Array, first: npt.NDArray[np.int64]) -> Float64Array:
    """Return the means (M, 8) of runs of points' values, weighted, and the sums of their weights.

    Parameters
    ----------
    values : (N, 8) float64
        x, y, z, red, green, blue, heat, weight; in the order of their voxels.
    first : (M,) int64
        Where each run begins.
    """
    weighted = values.copy()
    weighted[:, :_WEIGHT] *= weighted[:, _WEIGHT:]
    together = np.add.reduceat(weighted, first)
    together[:, :_WEIGHT] /= together[:, _WEIGHT:]
    return np.asarray(together)


def oldest(owner: Int32Array, first: npt.NDArray[np.int64]) -> Int32Array:
    """Return the oldest object (M,) of each run of owners (N,), 0 where there is none."""
    best = np.minimum.reduceat(np.where(owner > 0, owner, _NO_ONE), first)
    return np.where(best == _NO_ONE, 0, best).astype(np.int32)
