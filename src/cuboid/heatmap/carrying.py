"""Points that move with the keyframes they hang on, and what becomes of those that meet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float32Array, Float64Array
from cuboid.kernels import carrying as kernel
from cuboid.kernels.cubes import KEY_BITS, KEY_OFFSET


class Motions(NamedTuple):
    """How each keyframe moves.

    Attributes
    ----------
    T_new_old : (A, 3, 4) float64
        By number of the keyframe.
    moves : (A,) bool
        Whether it moves at all.
    """

    T_new_old: Float64Array
    moves: npt.NDArray[np.bool_]


def motions_of(moved: Mapping[int, Float64Array], anchor: npt.NDArray[np.integer]) -> Motions:
    """Return the motions of all keyframes up to the last that any of some points (N,) hangs on.

    Parameters
    ----------
    moved : mapping of int to (4, 4) float64
        T_new_old of the keyframes that move.
    anchor : (N,) uint16
        Keyframe of each point.
    """
    count = max(int(anchor.max(initial=0)), *moved, 0) + 1
    T, moves = np.tile(np.eye(4)[:3], (count, 1, 1)), np.zeros(count, bool)
    for keyframe, T_new_old in moved.items():
        T[keyframe], moves[keyframe] = T_new_old[:3], True
    return Motions(T, moves)


def moved_with(points: Float32Array, anchor: npt.NDArray[np.integer], motions: Motions) -> Float64Array:
    """Return points (N, 3) of the world after each has moved with its keyframe.

    Parameters
    ----------
    points : (N, 3) float32
    anchor : (N,) uint16
        Keyframe of each.
    motions : Motions
    """
    after = np.empty(points.shape)
    kernel.move(points, anchor, *motions, after)
    return after


def keys_of(voxels: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return numbers (N,), different for different voxels (N, 3)."""
    x, y, z = (voxels + KEY_OFFSET).T
    return np.asarray((x << (2 * KEY_BITS)) | (y << KEY_BITS) | z)
