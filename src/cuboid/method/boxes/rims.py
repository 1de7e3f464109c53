"""How much lower the rim of an object is than its top: it is rounded, or a lower part stands out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.geometry.box import Box

# The outline of a rounded object is this many times as far below the top as the outermost voxels, and a length between
# two such outlines is known about as badly: chosen on made bags, cylinders and boxes; see BENCHMARK.md, "Measures".
LOWER_RIM = 5.0
# The rim of a hollow top is higher than its middle by this, voxels.
HOLLOW_VOXELS = 1.5
# Error of the outline of a hollow object, metres: either side of its wall may be found.
WALL_M = 0.003
# The middle of a top is this fraction of it, per side.
MIDDLE_FRACTION = 0.6
# The heights of a flat part, from the lower to the upper quartile, differ by less than this, voxels: noise spreads them
# by less than a voxel, and mixed readings lie anywhere between two surfaces.
FLAT_VOXELS = 0.5


def rim_drop_m(drops: Sequence[Float64Array]) -> float:
    """Return how much lower the rim of a top is than its middle, metres; 0 if the top is too small to tell.

    A rounded top is lower at all four sides, and the highest rim is taken: mixed readings lower a rim where a far
    surface lies behind it.

    Parameters
    ----------
    drops : sequence of (M,) float64
        From `side_drops`.
    """
    return max(0.0, min((float(np.median(side)) for side in drops if len(side)), default=0.0))


def steps_m(drops: Sequence[Float64Array], voxel_m: float) -> Float64Array:
    """Return how much lower a part of an object ends at the sides across its length and its width, (2,) metres.

    The larger one of two opposite sides counts; 0 without a lower part. Its top has one height, which tells it from
    mixed readings. Parameters as for `rim_drop_m`, and the size of a voxel, metres.
    """
    found = np.zeros(4)
    for k, side in enumerate(drops):
        if len(side):
            low, middle, high = np.quantile(side, (0.25, 0.5, 0.75))
            found[k] = middle if middle > voxel_m and high - low < FLAT_VOXELS * voxel_m else 0.0
    return np.asarray(found.reshape(2, 2).max(1))


def is_hollow(drops: Sequence[Float64Array], voxel_m: float) -> bool:
    """Return whether most of the rim of a top stands clearly above its middle, as that of a cup does."""
    rim = np.concatenate([*drops, np.zeros(0)])
    return len(rim) > 0 and float(np.median(rim)) < -HOLLOW_VOXELS * voxel_m


def side_drops(box: Box, points: Float32Array | Float64Array, voxel_m: float) -> list[Float64Array]:
    """Return how much lower than its middle a top is in the columns at each of its four sides; none if too small.

    The highest point of each column of voxels counts, so that seen sides do not matter.

    Parameters
    ----------
    box : Box
    points : (N, 3)
        Its points, in the frame of the box.
    voxel_m : float
    """
    local, half = (points - box.center) @ box.rotation, box.size / 2.0
    if not len(local):
        return []
    cells = np.floor(local[:, :2] / voxel_m).astype(np.int64)
    cells -= cells.min(0)
    # One number for a column: rows of two take ten times as long to sort.
    keys = cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]
    _, column, count = np.unique(keys, return_inverse=True, return_counts=True)
    highest = np.full(len(count), -np.inf)
    np.maximum.at(highest, column, local[:, 2])
    plan = np.column_stack([np.bincount(column, local[:, k]) / count for k in (0, 1)])
    middle = (np.abs(plan) < MIDDLE_FRACTION * half[:2]).all(1)
    if not middle.any():
        return []
    lower, found = float(np.median(highest[middle])) - highest, []
    for axis in (0, 1):
        within = half[1 - axis] - np.abs(plan[:, 1 - axis]) > voxel_m
        found += [lower[within & (half[axis] - sign * plan[:, axis] < voxel_m)] for sign in (1.0, -1.0)]
    return found
