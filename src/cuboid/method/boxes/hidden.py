"""Parts of an object that no frame has seen: its far side, and its foot behind another object."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.tolerances import DRIFT_M, MIN_READINGS, OUTLIER_FRACTION
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import overlap_min_matrix, pack
from cuboid.method.boxes.fit import fit_box, plane_axes
from cuboid.method.boxes.quantiles import quantile
from cuboid.method.heatmap.voxel_map import VoxelMap

# A box rests on its plane if the gap is at most this, metres.
MIN_GAP_M = 1e-6
# A place on the ground counts as seen if at least this many of the nine columns of voxels around it hold a point.
MIN_OF_NINE = 2
# Boxes side by side overlap by at most this fraction of the smaller one.
BESIDE_FRACTION = 0.2
# Thickness of the top layer of an object, as a fraction of its height; its middle is above the middle of the foot.
TOP_LAYER_FRACTION = 0.1
# Fraction of the points that may stick out on one side only, as a handle does.
STICKING_OUT_FRACTION = 0.1
# A foot may be hidden if at most this fraction of the ground beneath the middle was seen.
GROUND_SEEN_FRACTION = 0.2
# The rest of a disc may be hidden if at most this fraction of the ground beneath it was seen: most of it is certain.
REST_SEEN_FRACTION = 0.5
# A foot carries the middle of its object. It may be narrower than the object, as a stem or a pot, but free space
# beneath this middle part of the footprint, as a fraction of each side, shows that there is no foot.
CARRIED_FRACTION = 0.5
# Sample places on the ground beneath a box, per side, as fractions of the box from its middle.
_STEPS = CARRIED_FRACTION * ((np.arange(MIN_READINGS) + 0.5) / MIN_READINGS - 0.5)
_ALONG, _ACROSS = (places.reshape(-1, 1) for places in np.meshgrid(_STEPS, _STEPS))
# Sample places in a disc of unit diameter, (N, 2), 1/16 apart.
_DISC = (np.mgrid[:16, :16].reshape(2, -1).T + 0.5) / 16.0 - 0.5
_DISC = _DISC[np.hypot(*_DISC.T) < 0.5]


def with_hidden(
    box: Box, points: Float64Array, normal: Float64Array, offset: float, near: Sequence[Box], voxels: VoxelMap
) -> Box:
    """Return an object's box extended by its far side, as far as no frame can have shown that it is absent.

    See `mirrored_points` for the parameters.
    """
    far_side = mirrored_points(points, normal, offset, box, near, voxels)
    if len(far_side):
        extended = fit_box(np.concatenate([box.corners(), far_side]), normal, offset, 0.0)
        # A far side that would overlap a neighbour is not added.
        if is_clear_of(extended, near):
            return extended
    return box


def as_deep_as_wide(box: Box, eye: Float64Array, near: Sequence[Box], resolution_m: float) -> Box:
    """Return the box of a distant object, made as deep as wide unless the camera could have seen that it is less deep.

    From the front an object shows its width and little of its depth; most objects are about as deep as wide. More depth
    would be visible beyond the rims, by its component across the ray. If that is less than the map resolves, the object
    may be deeper.

    Parameters
    ----------
    box : Box
    eye : (3,) float64
        Position of the camera, world, metres.
    near : sequence of Box
        Boxes of other objects nearby; a depth that would overlap one is refused.
    resolution_m : float
        Smallest distance that the map resolves, metres.
    """
    ray = box.rotation.T @ (box.center - eye)
    far_m = math.sqrt(ray @ ray)
    if far_m == 0.0:
        return box
    ray /= far_m
    deep = int(np.abs(ray[:2]).argmax())
    more_m = box.size[1 - deep] - box.size[deep]
    across = math.sqrt(max(0.0, 1.0 - ray[deep] ** 2))
    if more_m <= 0.0 or more_m * across > resolution_m:
        return box
    size = box.size.copy()
    size[deep] += more_m
    extended = Box(box.center + math.copysign(more_m / 2.0, ray[deep]) * box.rotation[:, deep], size, box.rotation)
    return extended if is_clear_of(extended, near) else box


def is_clear_of(box: Box, near: Sequence[Box]) -> bool:
    """Return whether a box overlaps its neighbours by no more than boxes side by side do."""
    return not near or bool(overlap_min_matrix(pack([box]), pack(near)).max() <= BESIDE_FRACTION)


def with_hidden_foot(
    box: Box, normal: Float64Array, offset: float, near: Sequence[Box], voxels: VoxelMap, max_height_m: float
) -> Box:
    """Return a box extended down to the surface below, unless evidence shows that it floats; see `hidden_foot_m`.

    No foot is assumed that would make it higher than `max_height_m`, metres: what is far above the surface stands on
    something that is not known.
    """
    foot_m = box.foot_m(normal, offset)
    if foot_m <= MIN_GAP_M:
        return box
    surface_m = hidden_foot_m(box, normal, offset, near, voxels)
    if surface_m is None or surface_m >= foot_m:
        return box
    gap_m = foot_m - surface_m
    if box.size[2] + gap_m > max_height_m:
        return box
    return Box(box.center - 0.5 * gap_m * normal, box.size + np.array([0.0, 0.0, gap_m]), box.rotation)


def is_unseen_beyond(round_box: Box, box: Box, normal: Float64Array, offset: float, voxels: VoxelMap) -> bool:
    """Return whether a body of revolution can be larger than its seen part.

    It cannot if frames saw the ground where the rest of it would stand. A banana, or a handle alone, has the side of a
    body of revolution too, but the ground beside it shows.

    Parameters
    ----------
    round_box : Box
        The box of the whole body.
    box : Box
        The box of its seen part.
    normal : (3,) float64
        Normal of its supporting plane, unit.
    offset : float
        The plane is normal.p + offset = 0.
    voxels : VoxelMap
    """
    across = _DISC * round_box.size[:2] @ round_box.rotation[:, :2].T
    # Points of adjacent voxels are at most two voxels apart: the ground next to the part may hold points of the part.
    added = (round_box.center + across)[_beyond(round_box.center + across, box) > 2.0 * voxels.voxel_m]
    if not len(added):
        return True
    seen = _seen(added - np.outer(added @ normal + offset, normal), normal, voxels)
    return bool(np.count_nonzero(seen) <= REST_SEEN_FRACTION * len(seen))


def mirrored_points(
    points: Float64Array, normal: Float64Array, offset: float, box: Box, others: Sequence[Box], voxels: VoxelMap
) -> Float64Array:
    """Return the points of an object's far side, as far as no frame can have shown that they are absent.

    Most objects are as deep behind their middle as in front of it, and the middle of a standing object is beneath its
    top. Each point is mirrored at the vertical axis through the top. It is kept if it lies outside the box, over ground
    that no frame has seen, and in no other object.

    Parameters
    ----------
    points : (N, 3) float64
        Points of the object, world, metres.
    normal : (3,) float64
        Normal of its supporting plane, unit, up.
    offset : float
        The plane is normal.p + offset = 0.
    box : Box
        The box of the points.
    others : sequence of Box
        Boxes of other objects nearby.
    voxels : VoxelMap

    Returns
    -------
    (M, 3) float64
    """
    height = points @ normal + offset
    top = quantile(height, 1.0 - 2.0 * OUTLIER_FRACTION)
    layer = points[height >= top - max(TOP_LAYER_FRACTION * top, voxels.voxel_m)]
    axis = (layer.min(0) + layer.max(0)) / 2.0
    # Rotate by 180 degrees about the normal.
    from_axis = points - axis
    mirrored = axis - from_axis + 2.0 * np.outer(from_axis @ normal, normal)
    beyond = _beyond(mirrored, box)
    out = np.flatnonzero(beyond > voxels.voxel_m)
    # A part that sticks out on one side, such as a handle or a spout, has no counterpart on the other side.
    allowed = round(STICKING_OUT_FRACTION * len(points))
    if len(out) <= allowed:
        return np.zeros((0, 3))
    out = out[np.argsort(beyond[out], kind="stable")][: len(out) - allowed]
    free = np.ones(len(out), bool)
    for other in others:
        free &= _beyond(mirrored[out], other) > 0.0
    out = out[free]
    ground = mirrored[out] - np.outer(mirrored[out] @ normal + offset, normal)
    return np.asarray(mirrored[out][~_seen(ground, normal, voxels)], dtype=np.float64)


def hidden_foot_m(
    box: Box, normal: Float64Array, offset: float, others: Sequence[Box], voxels: VoxelMap
) -> float | None:
    """Return the height at which a box whose foot was not seen stands, metres above its plane; None if it floats.

    Free space decides: rays that passed beneath the middle of the object reached the surface below, which shows that
    the object floats. Space that no ray reached is no evidence, and nothing hangs in the air: the object stands on the
    next surface below, that of its plane or of another object.

    Parameters
    ----------
    box : Box
        The seen part of the object, above its plane.
    normal : (3,) float64
        Normal of the plane, unit, up.
    offset : float
        The plane is normal.p + offset = 0.
    others : sequence of Box
        Seen parts of other objects nearby. One that reaches from below to above the lowest point of `box` is beside or
        around it: it may hold the object, which then has no foot of its own.
    voxels : VoxelMap
    """
    beneath = box.center + _ALONG * box.size[0] * box.rotation[:, 0] + _ACROSS * box.size[1] * box.rotation[:, 1]
    height = beneath @ normal + offset
    ground = beneath - np.outer(height, normal)
    foot_m, surface_m = box.foot_m(normal, offset), 0.0
    for other in others:
        low_m = other.foot_m(normal, offset)
        if low_m >= foot_m or not (_beyond(beneath, other) <= 0.0).any():
            continue
        top_m = low_m + other.size[2]
        if top_m > foot_m + DRIFT_M:
            return None
        surface_m = max(surface_m, top_m)
    seen = _seen(ground + surface_m * normal, normal, voxels)
    return surface_m if np.count_nonzero(seen) <= GROUND_SEEN_FRACTION * len(seen) else None


def _seen(ground: Float64Array, normal: Float64Array, voxels: VoxelMap) -> npt.NDArray[np.bool_]:
    """Return which places (N, 3) on a plane were seen: enough of nine columns of voxels around them hold a point."""
    return voxels.is_occupied_around(ground, np.array([*plane_axes(normal), normal]), MIN_OF_NINE)


def _beyond(points: Float64Array, box: Box) -> Float64Array:
    """Return the horizontal distance (N,) of points (N, 3) from a box, metres; 0 or less inside its footprint."""
    outside_m = np.abs((points - box.center) @ box.rotation) - box.size / 2.0
    return np.asarray(outside_m[:, :2].max(1), dtype=np.float64)
