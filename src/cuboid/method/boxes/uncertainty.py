"""How sure the measures of a box are: standard deviations of its sides and of its centre, and the sides that were seen.

Each of the six sides has an error of its own. A side that was seen as a face has the noise of its points and the
systematic error of depth. A side of which only the edge of the top was seen has the error of an edge: voxels, pixels,
and readings that mix two surfaces. The foot has the error of the plane beneath. A side with neither is a guess.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.tolerances import MIN_READINGS, MIN_SIGMA_M
from cuboid.ground.core.values import SideName
from cuboid.ground.geometry.box import Box

# The sides of a box in the order of all arrays here, and their outward normals in the axes of the box.
SIDES: tuple[SideName, ...] = ("+x", "-x", "+y", "-y", "+z", "-z")
NORMALS = np.array([[sign * (k == axis) for k in range(3)] for axis in range(3) for sign in (1.0, -1.0)])

# Smallest cosine between a side's outward normal and the direction to a camera that saw the side: at 75 degrees and
# more, readings are too few and too noisy to show a face.
MIN_FACING = 0.26
# A face was seen if its points cover at least this fraction of it: its lower part is often hidden.
MIN_COVERED_FRACTION = 0.25
# Points within this distance of a side, voxels, belong to it.
NEAR_VOXELS = 1.2
# Angular error of an edge, radians: one and a half pixels of a common camera (640 columns, 600 pixels of focal length).
# Stereo widens near surfaces by as much, and time of flight loses as many pixels there.
EDGE_RAD = 0.0025
# Error of an edge from the voxels along it, voxels.
EDGE_VOXELS = 0.1
# Standard deviation of a side that was not seen, as a fraction of the box along its axis: evenly up to half more.
UNSEEN_FRACTION = 0.29
# Fraction of the noise of points that remains in a face: the noise of neighbouring readings is alike.
FACE_NOISE_FRACTION = 0.5
# Systematic error of depth as a fraction of the depth: calibration and temperature.
SCALE_FRACTION = 0.001


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """How sure a box is.

    Attributes
    ----------
    size_sigma_m : (3,) float64
        Standard deviations of length, width and height, metres.
    center_sigma_m : (3,) float64
        Standard deviations of the centre along the axes of the world, metres.
    sides_seen : tuple of str
        Those of `SIDES` that a camera saw as faces.
    """

    size_sigma_m: Float64Array
    center_sigma_m: Float64Array
    sides_seen: tuple[SideName, ...]


def uncertainty_of(
    box: Box,
    points: Float32Array | Float64Array,
    directions: Float32Array | Float64Array,
    noise_m: float,
    distance_m: float,
    voxel_m: float,
    *,
    rests: bool,
) -> Uncertainty:
    """Return how sure a box is.

    Parameters
    ----------
    box : Box
    points : (N, 3)
        The points to which it was fitted, in the frame of the box, metres.
    directions : (D, 3)
        Unit vectors from cameras to the object, one for each different view.
    noise_m : float
        Standard deviation of its points, metres.
    distance_m : float
        Usual distance of the camera, metres.
    voxel_m : float
        Edge of a voxel, metres.
    rests : bool
        Whether a supporting plane is known beneath it.
    """
    local, half = (points - box.center) @ box.rotation, box.size / 2.0
    facing = -(directions @ box.rotation) @ NORMALS.T if len(directions) else np.zeros((1, 6))
    views = np.maximum(1, np.count_nonzero(facing > MIN_FACING, axis=0))
    face_m = np.hypot(FACE_NOISE_FRACTION * noise_m / np.sqrt(views), MIN_SIGMA_M / np.sqrt(views))
    edge_m = float(np.hypot(EDGE_VOXELS * voxel_m, EDGE_RAD * distance_m))
    sigma, seen = np.empty(6), []
    for k, name in enumerate(SIDES):
        axis = k // 2
        near = half[axis] - NORMALS[k, axis] * local[:, axis] < NEAR_VOXELS * voxel_m
        if facing[:, k].max() > MIN_FACING and _covered(local[near], half, axis, voxel_m):
            seen.append(name)
            sigma[k] = face_m[k]
        elif name == "-z" and rests:
            sigma[k] = MIN_SIGMA_M
        elif np.count_nonzero(near) >= MIN_READINGS:
            sigma[k] = edge_m
        else:
            sigma[k] = UNSEEN_FRACTION * box.size[axis]
    pairs = sigma.reshape(3, 2)
    size_m = np.sqrt((pairs**2).sum(1) + (SCALE_FRACTION * box.size) ** 2)
    along_m = np.sqrt((pairs**2).sum(1) / 4.0 + (SCALE_FRACTION * distance_m) ** 2)
    return Uncertainty(size_m, np.sqrt(box.rotation**2 @ along_m**2), tuple(seen))


def _covered(points: Float64Array, half: Float64Array, axis: int, voxel_m: float) -> bool:
    """Return whether points (N, 3) near a side, in the axes of the box, cover enough of it."""
    others = [k for k in range(3) if k != axis]
    cells: npt.NDArray[np.int64] = np.floor(points[:, others] / voxel_m).astype(np.int64)
    area = max(1.0, float(np.prod(2.0 * half[others])) / voxel_m**2)
    return len(np.unique(cells, axis=0)) >= MIN_COVERED_FRACTION * area
