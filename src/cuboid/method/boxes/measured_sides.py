"""The sides of a box as several views measured them, by the edges of its top.

A view is a row (4,): length, width and their standard deviations, metres; NaN where the edges are not clear. A row has
at least one side.
"""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.faces import lengthwise

# An object is measured again when its number of sightings has grown by the first factor; once it has a view, by the
# second one if the frame is from the same viewpoint: its errors are those of the last view, but for noise.
GROWTH, GROWTH_SAME = 1.5, 2.0
# Largest number of views that are kept: with these, the median hardly changes.
MAX_SIDE_VIEWS = 12
# A side moves by at most this, voxels: a larger change is that of an object of which more is seen now.
MAX_CHANGE_VOXELS = 2.0
# Depth widens a side by up to two pixels at each end, see `top_edges`, and one pixel is the standard deviation of a
# length between clear edges. A side that is shorter than that of the depth by more is of an upper part, such as a lid.
MAX_SHORTER_SIGMAS = 4.0
# Two boxes have the same axes within this angle, radians: the fit of a direction is exact to one degree.
SAME_AXES_RAD = np.radians(5.0)


def view_is_due(views_m: Float64Array, sightings: float, last: float, *, new_viewpoint: bool) -> bool:
    """Return whether an object with this number of sightings should be measured again.

    Parameters
    ----------
    views_m : (V, 4) float64
    sightings : float
        Their weight.
    last : float
        Weight of the sightings when it was last measured, clear or not; 0: never.
    new_viewpoint : bool
        Whether the frame is from a new viewpoint.
    """
    growth = GROWTH if new_viewpoint or not len(views_m) else GROWTH_SAME
    return sightings > last and sightings >= growth * last


def with_view(views_m: Float64Array, view_m: Float64Array) -> Float64Array:
    """Return views (V, 4) with a further one (4,), without the least exact of them if there are too many."""
    if np.isnan(view_m[:2]).all():
        return views_m
    views_m = np.vstack([views_m, view_m])
    if len(views_m) <= MAX_SIDE_VIEWS:
        return views_m
    information = np.nansum(views_m[:, 2:] ** -2.0, axis=1)
    return np.delete(views_m, int(information.argmin()), axis=0)


def measured(box: Box, views_m: Float64Array, voxel_m: float) -> tuple[Float64Array, Float64Array]:
    """Return the sides (2,) of a box over views (V, 4), and their standard deviations; NaN where not known.

    They are medians, weighted by the inverse variances: many views from afar do not outvote few near ones.
    """
    sides_m, sigma_m = np.full(2, np.nan), np.full(2, np.nan)
    for axis in range(2):
        good = views_m[~np.isnan(views_m[:, axis])]
        weights = good[:, 2 + axis] ** -2.0
        # Errors of views of the same edges are alike.
        side_m, side_sigma_m = _weighted_median(good[:, axis], weights), _weighted_median(good[:, 2 + axis], weights)
        longer_m, limit_m = side_m - box.size[axis], MAX_CHANGE_VOXELS * voxel_m
        if -min(limit_m, MAX_SHORTER_SIGMAS * side_sigma_m) <= longer_m <= limit_m:
            sides_m[axis], sigma_m[axis] = side_m, side_sigma_m
    return sides_m, sigma_m


def _weighted_median(values: Float64Array, weights: Float64Array) -> float:
    """Return the median of values (N,), between the two middle ones if need be; NaN without values."""
    if not len(values):
        return np.nan
    order = np.argsort(values, kind="stable")
    middles = np.cumsum(weights[order]) - weights[order] / 2.0
    return float(np.interp(weights.sum() / 2.0, middles, values[order]))


def with_sides(box: Box, views_m: Float64Array, voxel_m: float) -> Box:
    """Return a box with its measured sides; its centre stays. Its longer level side is first."""
    sides_m, _ = measured(box, views_m, voxel_m)
    if np.isnan(sides_m).all():
        return box
    level = np.where(np.isnan(sides_m), box.size[:2], sides_m)
    return lengthwise(Box(box.center, np.array([*level, box.size[2]]), box.rotation))


def still_valid(views_m: Float64Array, box: Box, fitted: Box, voxel_m: float) -> Float64Array:
    """Return views (V, 4) of a box as views of the same box, fitted anew; none if they contradict it."""
    views_m = along_axes(views_m, box, fitted)
    sides_m, _ = measured(fitted, views_m, voxel_m)
    contradicted = ~np.isnan(views_m[:, :2]).all(0) & np.isnan(sides_m)
    return np.zeros((0, 4)) if contradicted.any() else views_m


def along_axes(views_m: Float64Array, box: Box, other: Box) -> Float64Array:
    """Return views (V, 4) along the axes of a box as views along those of another one; none if the axes differ.

    The sides of a round object are equal, whatever the axes.
    """
    if not len(views_m) or np.array_equal(views_m[:, 0], views_m[:, 1], equal_nan=True):
        return views_m
    across = np.abs(box.rotation[:, 0] @ other.rotation[:, :2])
    if across.max() < np.cos(SAME_AXES_RAD):
        return np.zeros((0, 4))
    return views_m if across[0] > across[1] else views_m[:, [1, 0, 3, 2]]
