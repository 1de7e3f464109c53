"""Correction of boxes at sides of which only the edge of the top was seen: points are means over voxels.

The point of a voxel is the mean of its readings: a voxel across which an edge runs has its point before the edge. But
a top has as many readings per area near its edge as in its core, so that counting readings measures areas.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.faces import lengthwise
from cuboid.method.boxes.quantiles import quantile

# Smallest cosine between up and the direction to a camera that sees an object from above, 30 degrees: sides are then
# seen so obliquely that the edges of the top are more exact.
FROM_ABOVE = 0.866
# Smallest cosine of this angle at which the top is seen well enough to give its height, 60 degrees.
TOP_SEEN = 0.5
# A side is a seen face, and not only an edge of the top, if this fraction of the readings near it lie below the top
# layer.
FACE_FRACTION = 0.3
# Points this far below the top, voxels, do not belong to the top layer.
TOP_VOXELS = 1.5
# Points at most this far below the outermost ones, voxels, may belong to the noise of a flat top.
TOP_THICK_VOXELS = 4.0
# The middle of a top is this fraction of its core, per side: half of the area.
MIDDLE_OF_CORE = 0.7
# The heights of the parts of a flat top differ by less than this beyond noise, metres: systematic errors of
# depth.
FLAT_M = 0.002
# This quantile of heights tells how high the readings of a part of the top reach, at the same noise.
HIGH = 0.9
# The core of a top begins this far inside its edges, voxels, and is at least as wide: its density needs full voxels.
INSIDE_VOXELS, CORE_VOXELS = 1.0, 1.0
# Mean distance of the outermost points from an edge, voxels: the point of a voxel that is filled to a fraction f,
# uniformly between 0 and 1, lies f / 2 before the edge.
INSET_VOXELS = 0.25
# A side moves by at most this, voxels: an edge lies within the outermost voxel, which may lean.
MAX_MOVE_VOXELS = 0.7
# A top is a rectangle, or a disc if it is as long as wide, if its area is within this of the full one, as a fraction: a
# disc has 0.79 of the area of its square.
AREA_TOLERANCE = 0.1
# A disc is as long as wide within this, voxels.
ROUND_VOXELS = 1.0


def to_top(box: Box, points: Float64Array, readings: Float64Array, voxel_m: float, noise_m: float) -> Box:
    """Return a box whose top lies in the middle of its flat top face, however thick the noise makes that face.

    Above the core of the footprint all readings show the top: their mean height is that of the face. A top whose parts
    differ in height by more than noise is not flat, and stays, as does a hollow one with a higher rim.

    Parameters are those of `to_edges`, and the standard deviation of the points, metres.
    """
    local, half = (points - box.center) @ box.rotation, box.size / 2.0
    core = half[:2] - INSIDE_VOXELS * voxel_m
    if (2.0 * core < CORE_VOXELS * voxel_m).any():
        return box
    out = (np.abs(local[:, :2]) / core).max(1)
    layer = local[:, 2] > half[2] - min(TOP_THICK_VOXELS * voxel_m, box.size[2])
    near, rim = layer & (out < 1.0), layer & (out >= 1.0)
    weight = readings * near
    # The middle, the border, and the halves towards each side.
    middle = near & (out < MIDDLE_OF_CORE)
    halves = [near & (sign * local[:, axis] > 0.0) for axis in (0, 1) for sign in (1.0, -1.0)]
    parts = [middle, near & ~middle, *halves]
    if not all(readings[part].sum() > 0.0 for part in parts):
        return box
    heights = [float(np.average(local[part, 2], weights=readings[part])) for part in parts]
    if np.ptp(heights) > FLAT_M + noise_m:
        return box
    highest = [quantile(local[part, 2], HIGH) for part in (near, rim) if part.any()]
    if highest[0] < highest[-1] - FLAT_M - noise_m:
        return box
    moved_m = min(0.0, float(weight @ local[:, 2]) / float(weight.sum()) - half[2])
    return Box(box.center + moved_m / 2.0 * box.up, box.size + np.array([0.0, 0.0, moved_m]), box.rotation)


def to_edges(box: Box, points: Float64Array, readings: Float64Array, voxel_m: float) -> Box:
    """Return a box whose sides lie at the edges of the seen top, where the sides themselves were not seen.

    The readings beyond a line inside an edge, over those per area of the core, are the area between this line and the
    edge. A round top gets the radius of its area. Tops of other shapes, and tops that are too small for a core, are
    not changed.

    Parameters
    ----------
    box : Box
    points : (N, 3) float64
        World, metres.
    readings : (N,) float64
        Number of readings of each voxel, in any unit.
    voxel_m : float
        Edge of a voxel, metres.
    """
    local, half = (points - box.center) @ box.rotation, box.size / 2.0
    core = half[:2] - INSIDE_VOXELS * voxel_m
    if (2.0 * core < CORE_VOXELS * voxel_m).any():
        return box
    top = local[:, 2] > half[2] - TOP_VOXELS * voxel_m
    plan, weight = local[top, :2], readings[top]
    # Fraction of each voxel that lies beyond the core at either side, and within it, along each axis.
    beyond = [_fraction(np.array([plan[:, k], -plan[:, k]]) - core[k], voxel_m) for k in (0, 1)]
    within = [np.maximum(0.0, 1.0 - one.sum(0)) for one in beyond]
    density = float(weight @ (within[0] * within[1])) / float(4.0 * core[0] * core[1])
    if density <= 0.0:
        return box
    area_m2 = float(weight.sum()) / density
    filled = area_m2 / float(4.0 * np.prod(half[:2] + INSET_VOXELS * voxel_m))
    if abs(filled - math.pi / 4.0) < AREA_TOLERANCE and abs(half[0] - half[1]) < ROUND_VOXELS * voxel_m / 2.0:
        return _round(box, local, top, readings, voxel_m)
    if abs(filled - 1.0) > AREA_TOLERANCE:
        return box
    low, high = -half, half.copy()
    for axis in range(2):
        across_m = 2.0 * core[1 - axis]
        for sign, limits, part in ((1.0, high, beyond[axis][0]), (-1.0, low, beyond[axis][1])):
            if not _is_face(sign * local[:, axis] > half[axis] - voxel_m, top, readings):
                edge_m = core[axis] + float(weight @ (part * within[1 - axis])) / (density * across_m)
                limits[axis] = sign * _limited(edge_m, half[axis], voxel_m)
    return lengthwise(Box(box.center + box.rotation @ ((high + low) / 2.0), high - low, box.rotation))


def _round(box: Box, local: Float64Array, top: npt.NDArray[np.bool_], readings: Float64Array, voxel_m: float) -> Box:
    """Return the box of a round body whose radius follows from the area of its top."""
    radius_m = float(box.size[:2].mean()) / 2.0
    core_m = radius_m - INSIDE_VOXELS * voxel_m
    distance = np.hypot(*local[:, :2].T)
    if _is_face(distance > radius_m - voxel_m, top, readings):
        return box
    inside = _fraction(core_m - distance[top], voxel_m)
    density = float(readings[top] @ inside) / (math.pi * core_m**2)
    if density <= 0.0:
        return box
    rim_m = _limited(math.sqrt(float(readings[top].sum()) / (math.pi * density)), radius_m, voxel_m)
    return Box(box.center, np.array([2.0 * rim_m, 2.0 * rim_m, box.size[2]]), box.rotation)


def _fraction(beyond_m: Float64Array, voxel_m: float) -> Float64Array:
    """Return the fraction of voxels beyond a line, given the distances of their middles from it."""
    return np.clip(beyond_m / voxel_m + 0.5, 0.0, 1.0)


def _is_face(near: npt.NDArray[np.bool_], top: npt.NDArray[np.bool_], readings: Float64Array) -> bool:
    """Return whether the points near a side show it as a face: many lie below the top layer."""
    return float(readings[near & ~top].sum()) > FACE_FRACTION * float(readings[near].sum())


def _limited(edge_m: float, side_m: float, voxel_m: float) -> float:
    return float(np.clip(edge_m, side_m - MAX_MOVE_VOXELS * voxel_m, side_m + MAX_MOVE_VOXELS * voxel_m))
