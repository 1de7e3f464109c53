"""How sure the measures of a box are: standard deviations of its sides and of its centre, and the sides that were seen.

Each of the six sides has an error of its own. A side that was seen as a face has the noise of its points and the
systematic error of depth. A side of which only the edge of the top was seen has the error of an edge: a pixel. The foot
has the error of the plane beneath. A side with neither is a guess. Seen obliquely, sides are known to a voxel's part.

The coefficients were chosen on made objects with known sides such that intervals of 1.96 standard deviations hold 95 %
of the true lengths; see BENCHMARK.md, "Measures".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.tolerances import MIN_READINGS, MIN_SIGMA_M
from cuboid.ground.core.values import SideName
from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.edges import FROM_ABOVE
from cuboid.method.boxes.kernels.bodies import MIN_ARC, ROUND_TOLERANCE, SECTORS
from cuboid.method.boxes.rims import LOWER_RIM, WALL_M, is_hollow, rim_drop_m, side_drops

# The sides of a box in the order of all arrays here, and their outward normals in the axes of the box.
SIDES: tuple[SideName, ...] = ("+x", "-x", "+y", "-y", "+z", "-z")
NORMALS = np.array([[sign * (k == axis) for k in range(3)] for axis in range(3) for sign in (1.0, -1.0)])

# Smallest cosine between a side's outward normal and the direction to a camera that saw the side: at 75 degrees and
# more, readings are too few and too noisy to show a face.
MIN_SIDE_FACING = 0.26
# A face was seen if its points cover at least this fraction of it: its lower part is often hidden.
MIN_COVERED_FRACTION = 0.25
# Points within this distance of a side, voxels, belong to it.
BESIDE_VOXELS = 1.2
# Error of an edge, pixels of the working image: stereo widens near surfaces by about as much, and time of flight loses
# as much there. All edges of an object move outwards, or all inwards.
EDGE_PX = 1.25
# Error of a side, as a face or an edge, of an object that was not seen from above, voxels: the outermost points lie
# anywhere in their voxels, and the standard deviation of a uniform distribution is this fraction of its width.
OBLIQUE_VOXELS = 0.29
# Standard deviation of a side that was not seen, as a fraction of the box along its axis: evenly up to half more.
UNSEEN_FRACTION = 0.29
# Error of a face, in standard deviations of its points: the outermost points of a noisy face stand out by as much, and
# the noise of neighbouring readings is alike.
FACE_SIGMAS = 2.5
# Error of a length between outlines of a rounded object that only depth shows, voxels, if it was seen from all around,
# from above, and only from one side, where its far end is hidden; the same of the diameter of a body of revolution.
# They were chosen on made balls, bottles, jars, cups and soft boxes; see BENCHMARK.md, "Measures".
ROUNDED_AROUND_VOXELS, ROUNDED_TOP_VOXELS, ROUNDED_SIDE_VOXELS = 0.25, 0.45, 0.8
ROUND_BODY_VOXELS = 0.3
# The same of a top that was not seen from above: more voxels show it than a side.
SEEN_TOP_VOXELS = 0.15
# Further views of a top do not make it more exact: their errors are alike.
MAX_TOP_VIEWS = 3
# The sides of the box around a body of revolution differ by at most this, voxels.
SAME_SIDES_VOXELS = 0.1
# Layers of a body at least this wide, as a fraction of the widest one, show whether it is round.
WIDE_LAYER_FRACTION = 0.7
# Systematic error of depth as a fraction of the depth, and so of lengths: calibration and temperature.
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
    pixel_m: float,
    voxel_m: float,
    *,
    level_sigma_m: Float64Array,
    rests: bool,
    R_world_map: Float64Array,
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
    pixel_m : float
        Width of a pixel of the working image at this distance, metres.
    voxel_m : float
        Edge of a voxel, metres.
    level_sigma_m : (2,) float64
        Standard deviations of length and width from the edges of its top, metres; NaN if they are not known from these.
    rests : bool
        Whether a supporting plane is known beneath it.
    R_world_map : (3, 3) float64
        Rotation from the frame of the box, the map, to the world.
    """
    local, half = (points - box.center) @ box.rotation, box.size / 2.0
    facing = -(directions @ box.rotation) @ NORMALS.T if len(directions) else np.zeros((1, 6))
    views = np.maximum(1, np.count_nonzero(facing > MIN_SIDE_FACING, axis=0))
    above = len(directions) > 0 and float((-(directions @ box.up)).max()) >= FROM_ABOVE
    coarse_m = 0.0 if above else OBLIQUE_VOXELS * voxel_m
    face_m = np.sqrt(((FACE_SIGMAS * noise_m) ** 2 + MIN_SIGMA_M**2) / views + coarse_m**2)
    top_m = 0.0 if above else SEEN_TOP_VOXELS * voxel_m / math.sqrt(min(int(views[4]), MAX_TOP_VIEWS))
    face_m[4] = math.sqrt(face_m[4] ** 2 - coarse_m**2 + top_m**2)
    edge_m = float(np.hypot(coarse_m, EDGE_PX * pixel_m))
    sigma, edges, seen = np.empty(6), np.zeros(6, bool), []
    for k, name in enumerate(SIDES):
        axis = k // 2
        near = half[axis] - NORMALS[k, axis] * local[:, axis] < BESIDE_VOXELS * voxel_m
        if facing[:, k].max() > MIN_SIDE_FACING and _covered(local[near], half, axis, voxel_m):
            seen.append(name)
            sigma[k] = face_m[k]
        elif name == "-z" and rests:
            sigma[k] = MIN_SIGMA_M
        elif np.count_nonzero(near) >= MIN_READINGS:
            sigma[k], edges[k] = edge_m, True
        else:
            sigma[k] = UNSEEN_FRACTION * box.size[axis]
    pairs, moving = sigma.reshape(3, 2), (sigma * edges).reshape(3, 2)
    # Errors of two edges have the same sign, so that they add up in the length; all others are independent.
    together_m2 = 2.0 * moving.prod(1)
    size_m2 = (pairs**2).sum(1) + together_m2
    # The outline of a rounded object is wider than what depth shows of it, by a part of a voxel.
    drops = side_drops(box, points, voxel_m)
    from_around = bool((facing[:, :4].max(0) > MIN_SIDE_FACING).all())
    rounded = ROUNDED_AROUND_VOXELS if from_around else ROUNDED_TOP_VOXELS if above else ROUNDED_SIDE_VOXELS
    rounded_m = rounded * voxel_m
    size_m2[:2] += min(LOWER_RIM * rim_drop_m(drops), rounded_m) ** 2
    if is_round(box, local, voxel_m):  # the seen part of the circle determines the hidden part
        wall_m = WALL_M if is_hollow(drops, voxel_m) else 0.0
        size_m2[:2] = (
            2.0 * (FACE_SIGMAS * noise_m) ** 2 / views[:4].max() + (ROUND_BODY_VOXELS * voxel_m) ** 2 + wall_m**2
        )
    size_m2[:2] = np.where(np.isnan(level_sigma_m), size_m2[:2], level_sigma_m**2)
    size_m = np.sqrt(size_m2 + (SCALE_FRACTION * box.size) ** 2)
    pairs[:2] = np.minimum(pairs[:2], size_m[:2, None])
    along_m = np.sqrt((pairs**2).sum(1) / 4.0 + (SCALE_FRACTION * distance_m) ** 2)
    return Uncertainty(size_m, np.sqrt((R_world_map @ box.rotation) ** 2 @ along_m**2), tuple(seen))


def is_round(box: Box, local: Float64Array, voxel_m: float) -> bool:
    """Return whether points (N, 3), in the axes of a box, show that it stands around a body of revolution.

    A box around one is as long as wide, and its points lie near one circle in each layer, in enough sectors of a turn.
    """
    if abs(box.size[0] - box.size[1]) > SAME_SIDES_VOXELS * voxel_m or len(local) < MIN_READINGS:
        return False
    radius, layer = np.hypot(local[:, 0], local[:, 1]), np.floor(local[:, 2] / voxel_m).astype(np.int64)
    layer -= layer.min()
    layers = np.bincount(layer) > 0
    outer = np.zeros(len(layers))
    np.maximum.at(outer, layer, radius)
    rim = radius > outer[layer] - BESIDE_VOXELS * voxel_m
    count = np.bincount(layer[rim], minlength=len(layers))
    mean = np.bincount(layer[rim], radius[rim], len(layers)) / np.maximum(count, 1)
    wide = rim & (mean[layer] > WIDE_LAYER_FRACTION * mean.max())
    off = radius[wide] - mean[layer[wide]]
    sector = np.floor((np.arctan2(local[wide, 1], local[wide, 0]) / (2.0 * np.pi) + 0.5) * SECTORS).astype(np.int64)
    of_sector = np.bincount(sector % SECTORS, minlength=SECTORS)
    means = np.bincount(sector % SECTORS, off, SECTORS)[of_sector > 0] / of_sector[of_sector > 0]
    seen = np.count_nonzero(of_sector)
    return bool(seen >= MIN_ARC * SECTORS and np.ptp(means) < ROUND_TOLERANCE * mean.max() + MIN_SIGMA_M)


def _covered(points: Float64Array, half: Float64Array, axis: int, voxel_m: float) -> bool:
    """Return whether points (N, 3) near a side, in the axes of the box, cover enough of it."""
    others = [k for k in range(3) if k != axis]
    cells: npt.NDArray[np.int64] = np.floor(points[:, others] / voxel_m).astype(np.int64)
    area = max(1.0, float(np.prod(2.0 * half[others])) / voxel_m**2)
    return len(np.unique(cells, axis=0)) >= MIN_COVERED_FRACTION * area
