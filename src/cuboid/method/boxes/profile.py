"""Where the outline of a body is for a camera: rounded, tapered and stepped bodies do not end where their tops do.

Points of one side tell how far inside the box the body ends at each height; the other sides are alike. The outline is
where rays of the camera touch this profile.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.quantiles import quantile

# Layers are a voxel high, and begin at this distance below each other, voxels: coarser ones would cut off the bulges
# between them.
STEP_VOXELS = 0.5
# This quantile of the distances of a layer's points from the axis is that of its farthest point: some are stray. Of
# points within a voxel of it, the layer ends at the second quantile, at the mean height of those within NEAR_VOXELS of
# the end.
FARTHEST, END, NEAR_VOXELS = 0.95, 0.9, 0.3
# Smallest number of points that tell where one side of a layer ends, and of layers that tell how a wall leans.
MIN_SIDE_POINTS = 3
# A wall that was seen down to this height above the foot, voxels, and that leans by less than this, reaches the foot.
FOOT_VOXELS, MAX_FOOT_SLOPE = 2.5, 0.3
# Parts narrower than this fraction of the body do not tell how wide it is: the neck of a bottle.
WIDE_FRACTION = 0.65
# A top whose upper voxel ends this far inside of the body, voxels, is rounded or smaller than the body, unless its rim
# is no lower than its middle.
ROUNDED_VOXELS, MIN_DROP_VOXELS = 0.8, 0.03

# The wall of a round body is known more exactly than its single sides, because all points of a layer tell its radius: a
# top that ends this far inside of the wall, voxels, is a lid, even if its rim is as high as its middle.
LID_VOXELS = 0.5
# The box of a body of revolution has equal sides, but for rounding; see `revolved`.
EQUAL_SIDES_M = 1e-4

# Column of a round body, beside those of length and width.
AXIS = 2


@dataclass(frozen=True, slots=True)
class Profile:
    """The profile of an object.

    Attributes
    ----------
    height_m : (K, 3) float64
        Heights of the ends of K layers, from the top down, above the middle of the box, metres: along its length, along
        its width, and of a circle.
    inset_m : (K, 3) float64
        Distances of the ends of the layers from the widest ones, inwards; infinite where no side was seen.
    beyond_m : (4,) float64
        How far the points of a side end beyond the box: at the ends of its length and width, then at the opposite ones.
    """

    height_m: Float64Array
    inset_m: Float64Array
    beyond_m: Float64Array

    def is_narrow_above(self, voxel_m: float) -> bool:
        """Return whether a body ends farther inside at its top than below."""
        level_m = self.inset_m[0, :AXIS]
        return bool(level_m[np.isfinite(level_m)].max(initial=0.0) > ROUNDED_VOXELS * voxel_m)

    def has_lid(self, voxel_m: float) -> bool:
        """Return whether the top of a body of revolution is narrower than its wall."""
        return bool(LID_VOXELS * voxel_m < self.inset_m[0, AXIS] < np.inf)


def rounded_profile(
    box: Box, points: Float32Array | Float64Array, rim_m: float, voxel_m: float, *, hollow: bool
) -> Profile | None:
    """Return the profile of a body that is wider below its top, None for others; see `profile_of`.

    `rim_m` is the drop of its rim, and `hollow` tells whether its top is one around a hollow; see `rims`.
    """
    is_lower, may_have_lid = rim_m > MIN_DROP_VOXELS * voxel_m, is_of_revolution(box) and not hollow
    profile = profile_of(box, points, voxel_m) if is_lower or may_have_lid else None
    if profile is None:
        return None
    rounded = is_lower and profile.is_narrow_above(voxel_m)
    return profile if rounded or (may_have_lid and profile.has_lid(voxel_m)) else None


def is_of_revolution(box: Box) -> bool:
    """Return whether a box is that of a body of revolution, see `revolved`: its level sides are equal."""
    return float(box.size[0] - box.size[1]) < EQUAL_SIDES_M


def profile_of(box: Box, points: Float32Array | Float64Array, voxel_m: float) -> Profile | None:
    """Return the profile of an object from its points (N, 3), in the frame of the box; None for too few points.

    Returns None as well if neither of two opposite sides was seen.
    """
    local, half_m = (points - box.center) @ box.rotation, float(box.size[2]) / 2.0
    radius = np.hypot(local[:, 0], local[:, 1])
    sides = [local[:, 0], -local[:, 0], local[:, 1], -local[:, 1], radius]
    height_m: list[Float64Array] = []
    end_m: list[Float64Array] = []
    for top_m in np.arange(half_m + voxel_m, -half_m, -STEP_VOXELS * voxel_m):
        of_layer = (local[:, 2] <= top_m) & (local[:, 2] > top_m - voxel_m)
        if np.count_nonzero(of_layer) >= MIN_READINGS:
            ends = [
                _end_of(side[of_layer & (side > 0.0)], local[of_layer & (side > 0.0), 2], voxel_m) for side in sides
            ]
            end_m.append(np.array([end for end, _ in ends]))
            height_m.append(np.array([height for _, height in ends]))
    if not end_m:
        return None
    heights, ends_m = np.array(height_m), np.array(end_m)
    if np.isnan(ends_m[:, :4].reshape(-1, 2, 2)).all((0, 2)).any():
        return None
    is_rim = (heights[0] > half_m - voxel_m) & (ends_m[0] >= ends_m[min(2, len(ends_m) - 1)])
    heights[0, is_rim] = half_m
    foot = _foot(heights[:, -1], ends_m[:, -1], half_m, voxel_m)
    if foot is not None:
        heights, ends_m = np.vstack([heights, np.full(5, -half_m)]), np.vstack([ends_m, [np.nan] * 4 + [foot]])
    columns = [_of_two(heights[:, k : k + 2], ends_m[:, k : k + 2], voxel_m) for k in (0, 2)]
    columns.append((heights[:, 4], ends_m[:, 4].max() - ends_m[:, 4]))
    beyond_m = np.fmax.reduce(ends_m[:, [0, 2, 1, 3]]) - np.tile(box.size[:2], 2) / 2.0
    heights_m, insets_m = (np.column_stack([one[k] for one in columns]) for k in (0, 1))
    return Profile(heights_m, insets_m, beyond_m)


def outline(
    profile: Profile, axis: int, box: Box, places: Float64Array, outward: Float64Array, eye: Float64Array
) -> tuple[Float64Array, npt.NDArray[np.bool_]]:
    """Return places (S, 3) of the outline of a body as wide as its box, and which (S,) belong to its wide part.

    Parameters
    ----------
    profile : Profile
    axis : int
        0, 1: the ends of its length or width; `AXIS`: those of a round body.
    box : Box
    places, outward : (S, 3) float64
        Places on the sides at the height of the middle of the box, and the level directions out of it.
    eye : (3,) float64
        Position of the camera.
    """
    height_m, inset_m = profile.height_m[:, axis], profile.inset_m[:, axis]
    # Where rays through the ends cross the level of the places.
    eye_m, eye_height_m = ((eye - places) * outward).sum(1), float((eye - box.center) @ box.up)
    beyond_m = eye_m[:, None] - (eye_m[:, None] + inset_m) * eye_height_m / (eye_height_m - height_m)
    outermost = beyond_m.argmax(1)
    height_m, inset_m = height_m[outermost], inset_m[outermost]
    half_m = float(box.size[:2].mean() if axis == AXIS else box.size[axis]) / 2.0
    found = places - inset_m[:, None] * outward + height_m[:, None] * box.up
    return found, inset_m < (1.0 - WIDE_FRACTION) * half_m


def _of_two(height_m: Float64Array, end_m: Float64Array, voxel_m: float) -> tuple[Float64Array, Float64Array]:
    """Return heights and insets (K,) of the ends of layers, given those of two opposite sides (K, 2).

    The side that was seen farther down counts, or both if both were: the far side of a rounded body ends where rays of
    the camera touch it.
    """
    lowest_m = np.fmin.reduce(np.where(np.isnan(end_m), np.nan, height_m))
    lowest_m[np.isnan(lowest_m)] = np.inf
    counts = lowest_m <= lowest_m.min() + voxel_m
    inset_m = (np.fmax.reduce(end_m) - end_m)[:, counts]
    seen = ~np.isnan(inset_m)
    number = np.maximum(seen.sum(1), 1)
    mean_m = np.where(seen, inset_m, 0.0).sum(1) / number
    mean_height_m = np.where(seen, height_m[:, counts], 0.0).sum(1) / number
    return mean_height_m, np.where(seen.any(1), mean_m, np.inf)


def _end_of(across_m: Float64Array, height_m: Float64Array, voxel_m: float) -> tuple[float, float]:
    """Return where a layer ends, and the height there, from distances and heights (N,); NaN for too few points.

    The layer may be filled, or a wall.
    """
    if len(across_m) < MIN_SIDE_POINTS:
        return np.nan, np.nan
    outer_m = across_m[across_m >= quantile(across_m, FARTHEST) - voxel_m]
    end_m = quantile(outer_m, END)
    return end_m, float(height_m[across_m >= end_m - NEAR_VOXELS * voxel_m].mean())


def _foot(height_m: Float64Array, end_m: Float64Array, half_m: float, voxel_m: float) -> float | None:
    """Return where a round wall that was seen nearly down to its foot ends there, metres; None for other bodies."""
    above_m = height_m + half_m
    wall = above_m < above_m[-1] + 1.05 * voxel_m  # three layers
    if np.count_nonzero(wall) < MIN_SIDE_POINTS or above_m[-1] > FOOT_VOXELS * voxel_m:
        return None
    slope, _ = np.polyfit(above_m[wall], end_m[wall], 1)
    return None if abs(slope) > MAX_FOOT_SLOPE else float(end_m[-1] - max(0.0, slope) * above_m[-1])
