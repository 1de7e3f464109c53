"""The still view of a fixed camera: the median of some of its frames, without pixels whose depth changes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.depth import without_mixed
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.tolerances import DEPTH_NOISE_PER_M

# A pixel is still if this fraction of its readings lies within STILL_SIGMAS standard deviations and STILL_DEPTH_M,
# metres, of their median.
STILL_READINGS_FRACTION, STILL_SIGMAS, STILL_DEPTH_M = 0.8, 4.0, 0.01
# Readings farther than this are left out, metres: their noise is larger than what they contribute.
FARTHEST_USED_M = 2.5
# A normal is computed from points this number of pixels away on both sides: the first number at which they lie on one
# flat surface, on which depth changes by less than this fraction, and the point is near their middle: within BENT_M,
# metres, and noise. Far points give accurate normals, near ones reach to the edges of small sides.
NORMAL_PX, SMOOTH_FRACTION, BENT_M = (6, 3, 2, 1), 0.04, 0.002
# Cloud of a view: one point per cube of this edge, metres.
CLOUD_M = 0.006
# Step between the pixels of points up to the edges, pixels.
SOLID_STEP = 2
# A view with fewer points shows too little.
MIN_STILL_POINTS = 300


@dataclass(frozen=True, slots=True)
class StillView:
    """The still view of a fixed camera: depth without the noise of single frames, and without moving things.

    Attributes
    ----------
    depth_m : (H, W) float32
        0 where there is no reading, or none that is still.
    camera : Intrinsics
    points, normals : (N, 3) float64
        The thinned cloud of flat surfaces in the camera frame; normals face the camera.
    solid : (M, 3) float64
        Points up to the edges of all surfaces.
    """

    depth_m: Float32Array
    camera: Intrinsics
    points: Float64Array
    normals: Float64Array
    solid: Float64Array


def still_view(depths_m: Iterable[Float32Array], camera: Intrinsics) -> StillView:
    """Return the still view of a fixed camera from the depth images (H, W) of some of its frames, metres.

    Raises
    ------
    InputError
        There is no frame, or nothing in them stands still.
    """
    taken = list(depths_m)
    if not taken:
        raise InputError("no frame can be used")
    depths = np.stack(taken)
    depths[depths == 0] = np.nan
    known = np.count_nonzero(np.isfinite(depths), axis=0)
    median = np.zeros(depths.shape[1:], np.float32)
    enough = known > len(taken) // 2
    median[enough] = np.nanmedian(depths[:, enough], axis=0)
    limit_m = STILL_DEPTH_M + STILL_SIGMAS * DEPTH_NOISE_PER_M * median**2
    still = np.abs(depths - median) <= limit_m
    near = np.count_nonzero(still, axis=0)
    # Sensors round depth to steps: the mean of noisy readings lies between two steps.
    mean = np.where(still, depths, 0).sum(0) / np.maximum(near, 1)
    kept = (median > 0) & (near >= STILL_READINGS_FRACTION * known) & (median <= FARTHEST_USED_M)
    median = np.where(kept, mean, 0).astype(np.float32)
    points, normals = _cloud(median, camera)
    if len(points) < MIN_STILL_POINTS:
        raise InputError("too little in view stands still")
    solid_m = without_mixed(median)[::SOLID_STEP, ::SOLID_STEP]
    rows, columns = np.nonzero(solid_m)
    solid = camera.points(columns * SOLID_STEP, rows * SOLID_STEP, solid_m[rows, columns])
    return StillView(median, camera, points, normals, solid)


def _cloud(depth_m: Float32Array, camera: Intrinsics) -> tuple[Float64Array, Float64Array]:
    """Return thinned points (N, 3) of the flat surfaces in a depth image with their normals."""
    rows, columns = np.indices(depth_m.shape)
    points = camera.points(columns, rows, depth_m)
    normals = np.zeros_like(points)
    for apart in NORMAL_PX:
        inner = slice(apart, -apart)
        found = _normals(points, apart)
        missing = ~normals[inner, inner].any(-1)
        normals[inner, inner][missing] = found[missing]
    flat = normals.any(-1)
    inside, facing = points[flat], normals[flat]
    _, chosen = np.unique(np.floor(inside / CLOUD_M).astype(np.int64), axis=0, return_index=True)
    return inside[chosen], facing[chosen]


def _normals(points: Float64Array, apart: int) -> Float64Array:
    """Return the normals (H - 2n, W - 2n, 3) of the inner points, from points n pixels away; 0 where it is not flat."""
    k, z = apart, points[..., 2]
    middle_m = z[k:-k, k:-k]
    right, left = points[k:-k, 2 * k :], points[k:-k, : -2 * k]
    down, up = points[2 * k :, k:-k], points[: -2 * k, k:-k]
    flat = middle_m > 0
    for first, second in ((right[..., 2], left[..., 2]), (down[..., 2], up[..., 2])):
        flat &= (first > 0) & (second > 0) & (np.abs(first - second) < 2 * SMOOTH_FRACTION * middle_m)
        bent_m = np.abs(first + second - 2 * middle_m) / 2
        flat &= bent_m < BENT_M + STILL_SIGMAS / 2 * DEPTH_NOISE_PER_M * middle_m**2
    normals = np.cross(down - up, right - left)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1), 1e-12)[..., None]
    away = (normals * points[k:-k, k:-k]).sum(-1) > 0
    normals[away] *= -1
    normals[~flat] = 0
    return normals
