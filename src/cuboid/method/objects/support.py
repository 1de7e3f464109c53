"""Support relations: an object rests on its plane or on another object; otherwise it is attached to one it touches."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.tolerances import DRIFT_M, JUMP_M, MIN_READINGS, OUTLIER_FRACTION
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.fit import plane_axes
from cuboid.method.boxes.quantiles import quantile
from cuboid.method.boxes.revolved import share_wall
from cuboid.method.heatmap.voxel_map import VoxelMap
from cuboid.method.objects.distances import points_near
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.kernels.rims import highest_rim

# An object lies within another one if this fraction of its points is in the other one's box.
WITHIN_FRACTION = 0.9
# It is covered if the other one's points lie over this fraction of its footprint.
COVERED_FRACTION = 0.6
# The space beneath an object's foot is known if it is known beneath this fraction of its lowest points.
KNOWN_BENEATH_FRACTION = 0.8


def find_attachment(
    entry: MapObject, normal: Float64Array, offset: float, others: Iterable[MapObject], voxels: VoxelMap
) -> int:
    """Return the number of the object to which an unsupported object is attached; 0 if there is none.

    A solid is supported by its plane, or stands on top of another solid. An object whose foot is above the plane and
    below the top of its neighbour does neither: the neighbour holds it, as a teapot holds its spout, or a pot its
    plant. The space beneath the object must be known: the plane is seen below it, or it is the volume of the neighbour.
    Otherwise the foot may be hidden.

    Parameters
    ----------
    entry : MapObject
        The object, with its points.
    normal : (3,) float64
        Normal of the plane beneath, unit, up.
    offset : float
        The plane is normal.p + offset = 0.
    others : iterable of MapObject
        Nearby objects.
    voxels : VoxelMap
    """
    points = entry.points.astype(np.float64)
    height = points @ normal + offset
    foot = quantile(height, 2.0 * OUTLIER_FRACTION)
    if foot <= DRIFT_M:
        return 0
    # A support would lie beneath its lowest points.
    low = np.flatnonzero(height <= foot + DRIFT_M)
    low = low[:: 1 + len(low) // SAMPLE_POINTS]
    points, height, plane_visible = points[low], height[low], None
    most_touching, holder = 0, 0
    for other in others:
        if len(other.points) < MIN_READINGS:
            continue
        # Points of adjacent voxels are at most two voxels apart.
        touches = points_near(entry.points, other.points, 2.0 * voxels.voxel_m)
        if touches <= most_touching:
            continue
        other_height = other.points @ normal + offset
        if (
            quantile(other_height, 2.0 * OUTLIER_FRACTION) >= foot
            or quantile(other_height, 1.0 - 2.0 * OUTLIER_FRACTION) <= foot + JUMP_M
        ):
            continue
        if plane_visible is None:
            plane_visible = _plane_visible(points - np.outer(height, normal), normal, voxels)
        inside = (np.abs((points - other.box.center) @ other.box.rotation) <= other.box.size / 2.0)[:, :2].all(1)
        # The larger object holds the smaller one at its side; around a foot the holder may be the smaller one.
        beneath = inside if len(other.points) < len(entry.points) else inside | plane_visible
        if np.count_nonzero(beneath) / len(low) >= KNOWN_BENEATH_FRACTION:
            most_touching, holder = touches, other.number
    return holder


def seen_part(entry: MapObject, normal: Float64Array) -> Box:
    """Return the box of an object without an unseen foot: from its lowest points up along a normal (3,).

    An assumed foot is no evidence for the place of another object.
    """
    box, points = entry.box, entry.points[:: 1 + len(entry.points) // SAMPLE_POINTS]
    if not len(points):
        return box
    hidden_m = quantile(points @ normal, 2.0 * OUTLIER_FRACTION) - float(normal @ box.center) + float(box.size[2]) / 2.0
    if not 0.0 < hidden_m < box.size[2]:
        return box
    return Box(box.center + 0.5 * hidden_m * normal, box.size - np.array([0.0, 0.0, hidden_m]), box.rotation)


def find_coaxial(entry: MapObject, normal: Float64Array, others: Iterable[MapObject], resolution_m: float) -> int:
    """Return the number of an object that shares the vertical axis of `entry`, with hidden space between; 0: none.

    From above, the leaves of a plant hide its stem, and the cap of a bottle its neck: the upper part seems to float
    above the lower one. Parts of one body share its axis, while an object seldom stands exactly in the middle of
    another one.

    Parameters
    ----------
    entry : MapObject
        The upper or the lower one, with its points.
    normal : (3,) float64
        Up, unit.
    others : iterable of MapObject
        Nearby objects.
    resolution_m : float
        Smallest distance that the map resolves, metres: axes closer than that are the same.
    """
    part = seen_part(entry, normal)
    for other in others:
        between = other.box.center - entry.box.center
        if not len(other.points) or float(np.linalg.norm(between - (between @ normal) * normal)) > resolution_m:
            continue
        other_part = seen_part(other, normal)
        upper, above, lower = (entry, part, other_part) if between @ normal < 0.0 else (other, other_part, part)
        top = float(normal @ lower.center + lower.size[2] / 2.0)
        foot = float(normal @ upper.box.center - upper.box.size[2] / 2.0)
        if above.foot_m(normal, -top) > resolution_m and foot <= top + DRIFT_M:
            return other.number
    return 0


def find_other_wall(
    entry: MapObject, normal: Float64Array, offset: float, others: Iterable[MapObject], voxel_m: float
) -> int:
    """Return the number of a larger object that is another part of the wall of one body of revolution; 0: none.

    From above, a camera sees the outside of the near wall of a mug and the inside of its far wall, with a jump of depth
    between them.

    Parameters
    ----------
    entry : MapObject
        The smaller part, with its points.
    normal, offset
        Of the supporting plane, as for `find_attachment`.
    others : iterable of MapObject
        Nearby objects.
    voxel_m : float
        Edge of a voxel, metres.
    """
    points = entry.points[:: 1 + len(entry.points) // SAMPLE_POINTS].astype(np.float64)
    for other in others:
        # Points of adjacent voxels are at most two voxels apart.
        if len(other.points) < len(entry.points) or not points_near(entry.points, other.points, 2.0 * voxel_m):
            continue
        larger = other.points[:: 1 + len(other.points) // SAMPLE_POINTS].astype(np.float64)
        if share_wall(larger, points, (normal, offset), entry.noise_m, voxel_m):
            return other.number
    return 0


def encloses(entry: MapObject, others: Iterable[MapObject], voxel_m: float) -> bool:
    """Return whether an object surrounds and covers one of others, as a shelf does; a box that holds things is open.

    Parameters
    ----------
    entry : MapObject
        The object, with its points.
    others : iterable of MapObject
        Labelled objects near it.
    voxel_m : float
        Edge of a voxel, metres: points are that far apart.
    """
    box = entry.box
    for other in others:
        if other.box.volume >= box.volume or not len(other.points):
            continue
        inside = box.contains(other.points[:: 1 + len(other.points) // SAMPLE_POINTS].astype(np.float64), DRIFT_M)
        if np.count_nonzero(inside) >= WITHIN_FRACTION * len(inside) and _covers(entry.points, other.box, voxel_m):
            return True
    return False


def _covers(points: Float32Array, box: Box, voxel_m: float) -> bool:
    """Return whether points (N, 3) lie over most of an upright box's footprint."""
    local = (points - box.center) @ box.rotation
    over = local[(local[:, 2] > box.size[2] / 2.0 + DRIFT_M) & (np.abs(local[:, :2]) <= box.size[:2] / 2.0).all(1)]
    # Points of adjacent voxels are at most two voxels apart.
    cell_m = 2.0 * voxel_m
    area_m2 = len(np.unique(np.floor(over[:, :2] / cell_m), axis=0)) * cell_m**2
    return bool(area_m2 >= COVERED_FRACTION * box.size[0] * box.size[1])


def above_support_rim(
    points: Float32Array, normal: Float64Array, offset: float, voxel_m: float
) -> npt.NDArray[np.bool_]:
    """Return which points (N,) of an object that floats above its plane are its own, not the rim of its support.

    A support lies beneath its object. A distant shelf seen edge-on shows only its rim, which is lower than the object,
    in front of it, and wider.

    Parameters
    ----------
    points : (N, 3) float32
        World, metres.
    normal : (3,) float64
        Normal of the plane beneath, unit, up.
    offset : float
        The plane is normal.p + offset = 0.
    voxel_m : float
        Edge of a voxel, metres.
    """
    height = points @ normal + offset
    if quantile(height, 2.0 * OUTLIER_FRACTION) <= DRIFT_M:
        return np.ones(len(points), bool)
    order = np.argsort(height, kind="stable")
    level = height[order]
    # Overlapping slabs, each a voxel higher than the previous one, up to half of the points: any may be the rim.
    low = np.arange(level[0], level[len(level) // 2] - DRIFT_M, voxel_m)
    begins, ends = np.searchsorted(level, low), np.searchsorted(level, low + DRIFT_M)
    # Points of adjacent voxels are at most two voxels apart.
    rim = highest_rim(points, order, begins, ends, np.column_stack(plane_axes(normal)), 2.0 * voxel_m)
    return np.asarray(height >= (level[0] if rim < 0 else low[rim] + DRIFT_M))


def _plane_visible(ground: Float64Array, normal: Float64Array, voxels: VoxelMap) -> npt.NDArray[np.bool_]:
    """Return at which places (N, 3) on a plane the plane itself was seen: voxels that belong to no object."""
    step = voxels.voxel_m * normal
    owner = voxels.owner_at(np.concatenate([ground - step, ground, ground + step]))
    return np.asarray((owner.reshape(3, -1) == 0).any(0))
