"""What is far has surfaces as thick as the noise of depth: its points are brought back to where they lie on average."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.boxes.fit import plane_axes
from cuboid.frame import Float64Array
from cuboid.tolerances import LEAST_SIGMA_M, SIGMAS


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
    ray = points.mean(0) - eye
    far_m = float(np.linalg.norm(ray))
    if 2.0 * noise_m < voxel_m or far_m == 0.0:
        return points, noise_m
    ray /= far_m
    depth = points @ ray
    on = _rays(points, ray, voxel_m)
    order = np.lexsort((depth, on))
    # Rays lie one after the other, so far apart that what is near in these places is on the same ray.
    reach_m = SIGMAS * noise_m
    places = depth[order] - depth.min() + on[order] * (np.ptp(depth) + 2.0 * reach_m)
    weight = np.maximum(trust[order], max(1e-6 * trust.max(), 1e-12))
    weights = np.concatenate([[0.0], np.cumsum(weight)])
    moments = np.concatenate([[0.0], np.cumsum(weight * places)])
    mean, moved = places, np.inf
    while moved > LEAST_SIGMA_M:
        low, high = np.searchsorted(places, mean - reach_m), np.searchsorted(places, mean + reach_m, side="right")
        high = np.maximum(high, low + 1)  # of two points, one at each end, rounding may leave out both
        before, mean = mean, (moments[high] - moments[low]) / (weights[high] - weights[low])
        moved = float(np.abs(mean - before).max())
    result = points.copy()
    result[order] += np.outer(mean - places, ray)
    return result, noise_m / float(np.sqrt(np.median(high - low)))


def _rays(points: Float64Array, ray: Float64Array, voxel_m: float) -> npt.NDArray[np.int64]:
    """Return the number of the ray that each point (N,) lies on, from 0: cells across the direction of sight."""
    cells = np.floor(points @ np.column_stack(plane_axes(ray)) / voxel_m).astype(np.int64)
    return np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)
