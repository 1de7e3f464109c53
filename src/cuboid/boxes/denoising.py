"""Denoising of far objects, whose surfaces are as thick as the noise of depth: points move to their local mean."""

from __future__ import annotations

import math

import numpy as np

from cuboid.boxes.fit import plane_axes
from cuboid.boxes.kernels.shifts import shift_means
from cuboid.boxes.quantiles import quantile
from cuboid.core.frame import Float64Array
from cuboid.core.tolerances import SIGMAS


def is_thick(noise_m: float, voxel_m: float) -> bool:
    """Tell whether noise of a standard deviation makes surfaces thicker than a voxel: what is seen from far alone."""
    return 2.0 * noise_m >= voxel_m


def denoised(
    points: Float64Array, trust: Float64Array, eye: Float64Array, noise_m: float, voxel_m: float
) -> tuple[Float64Array, float]:
    """Return points where the surface is that they show, and the noise that is left in them.

    Depth errs along the ray and hardly across it. Of an opaque thing a ray meets one surface, which the map holds as
    layers of voxels, as many as noise has made: each point goes along its ray to where those about it, on the same ray
    and within three deviations, lie in the mean, until none moves by more than a reading can tell (mean shift:
    Fukunaga and Hostetler, 1975). Surfaces no thicker than a voxel stay as they are.

    Parameters
    ----------
    points : (N, 3) float64
        World, metres; at least one.
    trust : (N,) float64
        How far each of them is to be believed.
    eye : (3,) float64
        Where the camera is that sees them, world, metres.
    noise_m : float
        Standard deviation of the points of a surface, metres.
    voxel_m : float
        Edge of a voxel, metres; what is as near to a ray lies on it.

    Returns
    -------
    points : (N, 3) float64
    noise_m : float
        Of a mean of as many points as usually lie on a ray.
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
    # Rays lie one after the other, so far apart that what is near in these places is on the same ray.
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
