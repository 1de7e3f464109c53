"""Objects that rise from the flat areas of one frame: evidence for which of these areas support something.

The evidence uses only depth: no direction in the image or in the world is preferred.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.depth import MIXED_PER_M, DepthImage
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.kernels import cells as cell_kernel
from cuboid.ground.core.kernels import patches
from cuboid.ground.core.tolerances import BIAS_M, DRIFT_M, JUMP_M, JUMP_SIGMAS, OUTLIER_FRACTION
from cuboid.ground.geometry.se3 import level_rotation
from cuboid.method.proposals.depth import PLANE_BOW_M, PLANES
from cuboid.method.surfaces.cells import MIN_CELLS
from cuboid.method.surfaces.frame_segments import GAP_M, MIN_PIXELS
from cuboid.method.surfaces.kernels import standing as kernel
from cuboid.method.surfaces.plane_rules import largest_level

# Depth ripples by at most this times z squared, beyond JUMP_M: ten standard deviations of the depth noise.
RIPPLE_PER_M = MIXED_PER_M
# Smallest fraction, of the readings off all areas or of an image, that counts as evidence.
ENOUGH_FRACTION = 0.02
# An area of at most this fraction of another one may be the face of an object that stands on it.
MAX_FACE_FRACTION = 0.2
# A piece stands on an area if more than TOUCH_FRACTION of its outline meets the area and more than FREE_END_FRACTION
# ends in depth jumps; its clearness grows from 0 when both together cover HALF of the outline.
TOUCH_FRACTION, FREE_END_FRACTION, HALF = 0.2, 0.1, 0.5
# A region stands on an area that surrounds it in the image, i.e. begins at this fraction of its outline.
AROUND_FRACTION = 0.9
# Normals within 12 degrees of each other have the same direction (cosine).
SAME_COS = float(np.cos(np.radians(12.0)))


@dataclass(frozen=True, slots=True)
class FlatAreas:
    """The P flat areas of one frame, with any orientation.

    Attributes
    ----------
    normal : (P, 3) float64
        Unit, towards the camera, in the camera frame.
    area_m2 : (P,) float64
        Visible area of each.
    evidence : (P,) float64
        Fraction of all readings off the flat areas that show objects standing on each area, 0..1.
    """

    normal: Float64Array
    area_m2: Float64Array
    evidence: Float64Array


def find_flat_areas(image: DepthImage, config: TrackerConfig) -> FlatAreas:
    """Find the flat areas of a depth image, and the evidence that objects stand on each.

    An object on an area is a piece of surface between depth jumps. It has the size of an object, rises from the area by
    more than depth ripples, does not reach below it, meets it along a good part of its outline, and ends in depth jumps
    along another part. Bumps of a wall caused by the sensor do not.

    A camera above an area sees no object meet it. If there is no other evidence, the regions that an area surrounds
    stand on it; see `_surrounded_readings`.

    Parameters
    ----------
    image : DepthImage
    config : TrackerConfig
        Noise of the sensor, and sizes of objects.
    """
    noise, depth_m, camera = config.depth_noise_per_m, image.depth_m, image.camera
    planes, normal, area_m2 = _grow(image, config)
    evidence = np.zeros(len(planes))
    if not len(planes):
        return FlatAreas(normal, area_m2, evidence)
    on = np.empty(depth_m.shape, np.int8)
    kernel.lie_on(depth_m, camera.pinhole, planes, noise, config.min_height_m, BIAS_M, config.max_depth_m, on)
    # A far smaller area may be the face of an object on the larger one.
    faces = area_m2 <= MAX_FACE_FRACTION * area_m2[:, None]
    off = max(ENOUGH_FRACTION * depth_m.size, float(np.count_nonzero(on == kernel.SURFACE)))
    for readings_of in (_standing_readings, _surrounded_readings):
        for small in np.unique(faces, axis=0):
            supports = np.flatnonzero((faces == small).all(1))
            evidence[supports] = readings_of(depth_m, camera, planes, on, small, config)[supports]
        if evidence.max() >= ENOUGH_FRACTION * off:
            break
    return FlatAreas(normal, area_m2, np.minimum(1.0, evidence / off))


def _pieces(
    depth_m: Float32Array,
    camera: Intrinsics,
    planes: int,
    on: npt.NDArray[np.int8],
    jump_m: float,
    config: TrackerConfig,
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the regions off all areas (H, W), what borders on each, and the groups of regions in contact (N,).

    Areas (N, planes) and other things (N, KINDS) may border on a region; see `kernels.standing.bounds`. Depth
    differences above `jump_m`, metres, and the noise separate regions.
    """
    noise, labels = config.depth_noise_per_m, np.empty(depth_m.shape, np.int32)
    count = kernel.label_pieces(depth_m, on, noise, jump_m, labels, np.empty((depth_m.size, 2), np.int32))
    touches, others = np.empty((count, planes), np.int64), np.empty((count, kernel.KINDS), np.int64)
    groups = np.empty(count, np.int64)
    kernel.bounds(depth_m, on, labels, noise, jump_m, GAP_M * camera.fx, touches, others, groups)
    return labels, touches, others, groups


def _standing_readings(
    depth_m: Float32Array,
    camera: Intrinsics,
    planes: Float64Array,
    on: npt.NDArray[np.int8],
    small: npt.NDArray[np.bool_],
    config: TrackerConfig,
) -> Float64Array:
    """Return the number of readings (P,) of objects that stand on each flat area, weighted by their clearness.

    Parameters
    ----------
    depth_m, camera, config
        See `find_flat_areas`.
    planes : (P, 4) float64
    on : (H, W) int8
        See `kernels.standing.lie_on`.
    small : (P,) bool
        Areas that are treated as faces of objects.
    """
    labels, touches, others, _ = _pieces(depth_m, camera, len(planes), _faces_as_surface(on, small), JUMP_M, config)
    return _weighted_readings(depth_m, camera, planes, labels, *_clearness(touches, others), config)


def _surrounded_readings(
    depth_m: Float32Array,
    camera: Intrinsics,
    planes: Float64Array,
    on: npt.NDArray[np.int8],
    small: npt.NDArray[np.bool_],
    config: TrackerConfig,
) -> Float64Array:
    """Return the number of readings (P,) of regions off all areas that each area surrounds in the image.

    An object stands on the area behind it if no other surface borders on it, unless the area is visible beneath its
    middle: then it hangs. From above, an object hides its foot, and depth jumps separate its parts, such as the cap and
    the shoulder of a bottle: a region continues across them, and regions in contact, such as boxes side by side, are
    surrounded together. In front of a wall, the floor or another object is beneath it. See `_standing_readings`.
    """
    on = _faces_as_surface(on, small)
    labels, touches, others, groups = _pieces(depth_m, camera, len(planes), on, math.inf, config)
    others[:, kernel.CONTACT] = 0
    together, beside = np.zeros_like(touches), np.zeros_like(others)
    np.add.at(together, groups, touches)
    np.add.at(beside, groups, others)
    around = (together / np.maximum(1, together.sum(1) + beside.sum(1))[:, None])[groups]
    beneath = around.argmax(1)
    clear = np.where(around.max(1) >= AROUND_FRACTION, around.max(1), 0.0)
    for k, (v, u) in _large_pieces(labels, clear):
        middle, plane = camera.points(u, v, depth_m[v, u]).mean(0), planes[beneath[k]]
        x, y, z = middle - (plane[:3] @ middle + plane[3]) * plane[:3]
        column, row = round(camera.fx * x / z + camera.cx), round(camera.fy * y / z + camera.cy)
        if 0 <= row < on.shape[0] and 0 <= column < on.shape[1] and on[row, column] == beneath[k]:
            clear[k] = 0.0
    return _weighted_readings(depth_m, camera, planes, labels, beneath, clear, config)


def _faces_as_surface(on: npt.NDArray[np.int8], small: npt.NDArray[np.bool_]) -> npt.NDArray[np.int8]:
    """Return `on` (H, W) with the readings on areas that are treated as faces of objects as readings off all areas."""
    code = np.append(np.where(small, kernel.SURFACE, np.arange(len(small))), [kernel.NOTHING, kernel.SURFACE])
    return code.astype(np.int8)[on]


def _weighted_readings(
    depth_m: Float32Array,
    camera: Intrinsics,
    planes: Float64Array,
    labels: npt.NDArray[np.int32],
    beneath: npt.NDArray[np.int64],
    clear: Float64Array,
    config: TrackerConfig,
) -> Float64Array:
    """Return the number of readings (P,) of the pieces that stand on each area, weighted by their clearness.

    `labels` (H, W) is the piece of each pixel; `beneath` (N,) and `clear` (N,) are as in `_clearness`.
    """
    found = np.zeros(len(planes))
    for k, (v, u) in _large_pieces(labels, clear):
        if _stands(camera.points(u, v, depth_m[v, u]), planes[beneath[k]], config):
            found[beneath[k]] += clear[k] * len(u)
    return found


def _large_pieces(labels: npt.NDArray[np.int32], clear: Float64Array) -> Iterator[tuple[int, npt.NDArray[np.int32]]]:
    """Yield the pieces that may be objects: index, and rows and columns (2, N) of the pixels; see `_clearness`."""
    starts, pixels = np.empty(len(clear) + 1, np.int64), np.empty((labels.size, 2), np.int32)
    kernel.gather_pieces(labels, starts, pixels)
    for k in np.flatnonzero((clear > 0.0) & (np.diff(starts) >= MIN_PIXELS)).tolist():
        yield k, pixels[starts[k] : starts[k + 1]].T


def _grow(image: DepthImage, config: TrackerConfig) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return the flat areas of a depth image: normal and offset (P, 4), mean normal of the cells (P, 3), area (P,)."""
    camera, limit = image.camera, JUMP_SIGMAS * config.depth_noise_per_m
    cells = image.cells(config.max_depth_m)
    shape, cells = cells.shape[:2], cells.reshape(-1, cell_kernel.CELL_COLUMNS)
    inverse, member = np.empty((PLANES, 3)), np.empty(shape, np.int16)
    bounds = config.depth_noise_per_m, PLANE_BOW_M, limit, config.min_plane_area_m2 / 2.0
    count = patches.grow_planes(cells, shape, camera.pinhole, *bounds, inverse, member)
    # 1 = z (a u + b v + c) on an area, with u = fx x / z + cx and v = fy y / z + cy.
    a, b, c = inverse[:count].T
    planes = np.column_stack([a * camera.fx, b * camera.fy, a * camera.cx + b * camera.cy + c, -np.ones(count)])
    planes /= -np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    member_of = member.ravel()
    planes = np.vstack([planes, _areas_in_parts(cells, member_of, limit, config)])
    count = len(planes)
    area_m2 = np.bincount(member_of[member_of >= 0], cells[member_of >= 0, cell_kernel.AREA], count).astype(np.float64)
    # Normals of cells with twice the edge are four times as accurate; cells at a border may include another surface.
    wide = image.cells(config.max_depth_m, 2).reshape(-1, cell_kernel.CELL_COLUMNS)
    flat = (wide[:, cell_kernel.AREA] > 0) & (wide[:, cell_kernel.RMS] < limit)
    facing = wide[:, cell_kernel.NX : cell_kernel.NZ + 1]
    member_of_wide = member[: shape[0] // 2 * 2 : 2, : shape[1] // 2 * 2 : 2].ravel()
    normal = planes[:, :3].copy()
    for p in range(count):
        cells_of_area = flat & (member_of_wide == p) & (facing @ planes[p, :3] > SAME_COS)
        mean = wide[cells_of_area, cell_kernel.AREA] @ facing[cells_of_area]
        if cells_of_area.any():
            normal[p] = mean / np.linalg.norm(mean)
    return planes, normal, area_m2


def _areas_in_parts(
    cells: Float64Array, member: npt.NDArray[np.int16], limit: float, config: TrackerConfig
) -> Float64Array:
    """Return the planes (P, 4) of areas that are visible only in parts, and write their indices to their cells.

    Objects and wrong readings divide the board of a shelf into patches that are too small to be areas by themselves.
    Patches with one orientation at one height form one area; gaps between them are no longer than an object.

    Parameters
    ----------
    cells : (N, CELL_COLUMNS) float64
    member : (N,) int16
        Area of each cell, -1: none; changed in place.
    limit : float
        Flat cells have a smaller residual.
    config : TrackerConfig
    """
    found: list[Float64Array] = []
    count, least_m2 = int(member.max(initial=-1)) + 1, config.min_plane_area_m2 / 2.0
    area_m2 = cells[:, cell_kernel.AREA]
    free = np.flatnonzero((area_m2 > 0) & (cells[:, cell_kernel.RMS] < limit) & (member < 0))
    normals, centers = cells[:, cell_kernel.NX : cell_kernel.NZ + 1], cells[:, cell_kernel.CX : cell_kernel.CZ + 1]
    while len(free) >= MIN_CELLS and area_m2[free].sum() >= least_m2:
        similar = normals[free] @ normals[free].T > SAME_COS
        most_common = int(np.argmax(similar @ area_m2[free]))
        same = free[similar[most_common]]
        if area_m2[same].sum() < least_m2:
            break
        free = free[~similar[most_common]]
        normal = area_m2[same] @ normals[same]
        R = level_rotation(normal / np.linalg.norm(normal))
        area_cells = same[largest_level(centers[same] @ R.T, area_m2[same], np.arange(len(same)), config.max_size_m)]
        if len(area_cells) >= MIN_CELLS and area_m2[area_cells].sum() >= least_m2:
            member[area_cells] = count + len(found)
            found.append(np.append(R[2], -float(np.average(centers[area_cells] @ R[2], weights=area_m2[area_cells]))))
    return np.array(found).reshape(-1, 4)


def _clearness(
    touches: npt.NDArray[np.int64], others: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], Float64Array]:
    """Return the area (N,) that each piece touches most, and the clearness (N,), 0..1, that it stands there.

    Parameters
    ----------
    touches, others
        See `kernels.standing.bounds`.
    """
    beneath = touches.argmax(1) if len(touches) else np.zeros(0, np.int64)
    touch = np.take_along_axis(touches, beneath[:, None], 1)[:, 0]
    judged = np.maximum(1, touches.sum(1) + others.sum(1))
    free = others[:, kernel.FREE]
    both = (touch > TOUCH_FRACTION * judged) & (free > FREE_END_FRACTION * judged)
    return beneath, np.where(both, np.maximum(0.0, ((touch + free) / judged - HALF) / (1.0 - HALF)), 0.0)


def _stands(points: Float64Array, plane: Float64Array, config: TrackerConfig) -> bool:
    """Return whether a piece (N, 3) rises from a plane (4,) like an object, and does not continue below it."""
    if np.ptp(points, axis=0).max() > config.max_size_m:
        return False
    low, middle, high = np.quantile(
        points @ plane[:3] + plane[3], [2.0 * OUTLIER_FRACTION, 0.5, 1.0 - 2.0 * OUTLIER_FRACTION]
    )
    ripple_m = JUMP_M + RIPPLE_PER_M * float(np.median(points[:, 2])) ** 2
    return bool(low >= -DRIFT_M and middle > config.min_height_m and high > max(ripple_m, 2.0 * config.min_height_m))
