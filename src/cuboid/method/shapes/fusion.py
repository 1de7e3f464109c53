"""Depth fused around an object: a truncated signed distance in voxels along its box.

B. Curless and M. Levoy, "A volumetric method for building complex models from range images" (1996), with the distance
to the tangent plane of each reading instead of the distance along the ray, which is wrong at slanted surfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.depth import MIXED_PER_M, without_mixed
from cuboid.ground.core.tolerances import JUMP_M, NEAREST_M
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from cuboid.method.shapes.views import MARGIN_M, ObjectView, pixels_of

# Edge of a voxel: the longest side of the box is divided into VOXELS_ALONG voxels, within limits in metres. Depth
# cameras resolve no detail below FINEST_M; above COARSEST_M small objects lose their shape.
VOXELS_ALONG = 60
FINEST_M, COARSEST_M = 0.003, 0.005
# Truncation distance of a reading, voxels: for noise of 3 mm at 1.2 m, and walls of mugs of 4 mm.
TRUNCATION_VOXELS = 3.0
# Minimum cosine between ray and surface normal for a reading to be used: 80 degrees.
MIN_COSINE = 0.17
# A normal is computed from the neighbours at this distance, pixels to both sides: 2 cm at 1 m with common cameras.
NORMAL_PIXELS = 4
# Layer coordinate of the support's plane: halfway between the second and the third layer from below. The lowest layer
# is air.
PLANE_LAYER = 1.5
# Minimum number of views that observe a seen voxel: a single view may be wrong at an edge.
MIN_VIEWS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Volume:
    """Voxels along a box, as arrays (X, Y, Z).

    Attributes
    ----------
    T_world_grid : (4, 4) float64
        The centre of voxel (i, j, k) lies at (i, j, k) times `voxel_m` in the grid frame, whose z axis is the box's up.
    voxel_m : float
        Edge of a voxel.
    distance : (X, Y, Z) float32
        Signed distance to the surface, positive outside, as a fraction of the truncation, -1..1.
    seen : (X, Y, Z) bool
        Whether enough views observe the voxel.
    """

    T_world_grid: Float64Array
    voxel_m: float
    distance: Float32Array
    seen: npt.NDArray[np.bool_]


def grid_of(box: Box, foot_m: float) -> tuple[Float64Array, float, tuple[int, int, int]]:
    """Return T_world_grid, the edge of a voxel and the shape of the volume of an object.

    Parameters
    ----------
    box : Box
    foot_m : float
        Height of the box's lower face above the plane of its support, metres; the plane lies at `PLANE_LAYER`.
    """
    voxel_m = float(np.clip(box.size.max() / VOXELS_ALONG, FINEST_M, COARSEST_M))
    low = -box.size / 2.0 - MARGIN_M
    low[2] = -box.size[2] / 2.0 - foot_m - PLANE_LAYER * voxel_m
    high = box.size / 2.0 + MARGIN_M
    T = np.eye(4)
    T[:3, :3] = box.rotation
    T[:3, 3] = box.center + box.rotation @ low
    x, y, z = (int(n) + 1 for n in np.ceil((high - low) / voxel_m))
    return T, voxel_m, (x, y, z)


def fuse(views: Sequence[ObjectView], box: Box, foot_m: float) -> Volume:
    """Return the fused depth of all views around a box; parameters as of `grid_of`."""
    T_world_grid, voxel_m, shape = grid_of(box, foot_m)
    truncation_m = TRUNCATION_VOXELS * voxel_m
    total, weights = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    count = np.zeros(shape, np.uint8)
    for view in views:
        _add(view, T_world_grid, voxel_m, truncation_m, total, weights, count)
    seen = count >= min(MIN_VIEWS, max(1, len(views)))
    distance = np.where(seen, total / np.maximum(weights, np.float32(1e-12)), np.float32(-1.0))
    return Volume(T_world_grid, voxel_m, distance.astype(np.float32), seen)


def _add(
    view: ObjectView,
    T_world_grid: Float64Array,
    voxel_m: float,
    truncation_m: float,
    total: Float32Array,
    weights: Float32Array,
    count: npt.NDArray[np.uint8],
) -> None:
    """Add the observations of one view to the sums of each voxel."""
    depth = without_mixed(np.ascontiguousarray(view.depth_m))
    cosine = facing(depth, view)
    index, z = _projected(view, T_world_grid, voxel_m, total.shape)
    behind_m = depth.ravel()[index] - z
    reading = depth.ravel()[index]
    slope = cosine.ravel()[index]
    # Along the normal of the reading's surface. Readings without a normal are used only for free space: along the ray.
    distance = np.where(slope > 0, behind_m * slope, behind_m) / np.float32(truncation_m)
    free = distance > 1.0
    used = (reading > 0) & (z > NEAREST_M) & (distance > -1.0) & (free | (slope >= MIN_COSINE))
    angle = np.where(free, np.float32(MIN_COSINE), slope)
    # The thickness behind the surface is unknown: the weight falls to zero.
    weight = np.where(used, angle / np.maximum(reading, np.float32(0.1)) ** 2 * np.minimum(1.0, 1.0 + distance), 0.0)
    total += (weight * np.minimum(distance, 1.0)).astype(np.float32)
    weights += weight.astype(np.float32)
    count += used & (count < 255)


def _projected(
    view: ObjectView, T_world_grid: Float64Array, voxel_m: float, shape: tuple[int, ...]
) -> tuple[npt.NDArray[np.int64], Float32Array]:
    """Return the pixel of each voxel in a view, as a flat index, and its depth, metres; both are 0 outside the view."""
    T = se3.inverse(view.T_world_camera) @ T_world_grid
    steps = [(np.arange(n) * voxel_m).astype(np.float32) for n in shape]
    x, y, z = (
        np.float32(T[row, 3])
        + (T[row, 0] * steps[0]).astype(np.float32)[:, None, None]
        + (T[row, 1] * steps[1]).astype(np.float32)[None, :, None]
        + (T[row, 2] * steps[2]).astype(np.float32)[None, None, :]
        for row in range(3)
    )
    u, v, inside = pixels_of(view.camera, x, y, z)
    return np.where(inside, v * view.camera.width + u, 0), np.where(inside, z, np.float32(0.0))


def facing(depth_m: Float32Array, view: ObjectView) -> Float32Array:
    """Return the factor (h, w) from a difference of depths to the distance along the normal; 0 if unknown.

    The factor is the cosine between ray and surface normal, times the length of the ray at unit depth.
    """
    camera, n = view.camera, NORMAL_PIXELS
    smooth = np.asarray(cv2.medianBlur(depth_m, 5), np.float32) if min(depth_m.shape) >= 5 else depth_m
    across, along = np.zeros_like(depth_m), np.zeros_like(depth_m)
    valid = np.zeros(depth_m.shape, np.bool_)
    if min(depth_m.shape) > 2 * n:
        left, right = smooth[n:-n, : -2 * n], smooth[n:-n, 2 * n :]
        above, below = smooth[: -2 * n, n:-n], smooth[2 * n :, n:-n]
        across[n:-n, n:-n], along[n:-n, n:-n] = (right - left) / (2 * n), (below - above) / (2 * n)
        middle = smooth[n:-n, n:-n]
        limit = JUMP_M + MIXED_PER_M * middle**2
        jump = np.maximum(np.abs(right + left - 2 * middle), np.abs(below + above - 2 * middle))
        all_measured = (left > 0) & (right > 0) & (above > 0) & (below > 0) & (middle > 0)
        valid[n:-n, n:-n] = all_measured & (jump < limit)
    # The normal of z(u, v) in pixels: (fx dz/du, fy dz/dv, -(z + (u - cx) dz/du + (v - cy) dz/dv)); its product with
    # the ray ((u - cx) / fx, (v - cy) / fy, 1) is -z.
    u = (np.arange(camera.width, dtype=np.float32) - np.float32(camera.cx))[None, :]
    v = (np.arange(camera.height, dtype=np.float32) - np.float32(camera.cy))[:, None]
    last = smooth + u * across + v * along
    length = np.sqrt((camera.fx * across) ** 2 + (camera.fy * along) ** 2 + last**2)
    cosine = np.where(valid, smooth / np.maximum(length, np.float32(1e-9)), np.float32(0.0))
    return np.asarray(cosine, np.float32)
