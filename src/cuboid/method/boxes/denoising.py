"""Denoising of distant objects, whose surfaces are as thick as depth noise: points move to their local mean."""

from __future__ import annotations

import math

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.tolerances import SIGMAS
from cuboid.method.boxes.fit import plane_axes
from cuboid.method.boxes.kernels.shifts import shift_means
from cuboid.method.boxes.quantiles import quantile

# Smallest noise of a thick surface, voxels: two standard deviations are a voxel.
THICK_VOXELS = 0.5


def is_thick(noise_m: float, voxel_m: float) -> bool:
    """Return whether noise of this standard deviation makes surfaces thicker than a voxel, as for distant objects."""
    return noise_m >= THICK_VOXELS * voxel_m


def denoised(
    points: Float64Array, trust: Float64Array, eye: Float64Array, noise_m: float, voxel_m: float
) -> tuple[Float64Array, float]:
    """Return points moved to the surface that they show, and the remaining noise.

    Depth errors lie along the ray. A ray meets one surface of an opaque object, but noise spreads that surface over
    several layers of voxels in the map. Each point is moved along its ray to the mean of its neighbours on the same ray
    within three standard deviations, until no point moves by more than the smallest depth error (mean shift: Fukunaga
    and Hostetler, 1975). Surfaces no thicker than a voxel are not changed.

    Parameters
    ----------
    points : (N, 3) float64
        World, metres; at least one.
    trust : (N,) float64
        Weight of each point.
    eye : (3,) float64
        Position of the camera, world, metres.
    noise_m : float
        Standard deviation of the points of a surface, metres.
    voxel_m : float
        Edge of a voxel, metres; points in the same voxel column along a ray count as on that ray.

    Returns
    -------
    points : (N, 3) float64
    noise_m : float
        Standard deviation of a mean over the usual number of points on a ray, metres.
    """
    if not is_thick(noise_m, voxel_m):
        return points, noise_m
    ray = points.mean(0) - eye
    far_m = math.sqrt(ray @ ray)
    if far_m == 0.0:
        return points, noise_m
    ray /= far_m
    depth = points @ ray
    cells = np.floor(points @ np.column_stack(plane_axes(ray)) / voxel_m)
    cells -= cells.min(0)
    # Rays are laid one after the other on one axis, with gaps, so that neighbours on this axis are on the same ray.
    reach_m = SIGMAS * noise_m
    on = cells[:, 0] * (cells[:, 1].max() + 1.0) + cells[:, 1]
    places = depth - depth.min() + on * (np.ptp(depth) + 2.0 * reach_m)
    order = np.argsort(places, kind="stable")
    places = places[order]
    mean, near = np.empty(len(points)), np.empty(len(points))
    weight = np.maximum(trust, max(1e-6 * trust.max(), 1e-12))
    shift_means(places, weight[order], reach_m, mean, near)
    result = points.copy()
    result[order] += np.outer(mean - places, ray)
    return result, noise_m / math.sqrt(quantile(near, 0.5))
