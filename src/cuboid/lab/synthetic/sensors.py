"""Error models of depth cameras: noise, steps, holes, shadows, wrong pixels at edges.

==================  ==============================================================================
`structured-light`  Kinect v1. Deviation and step of depth: Khoshelham and Oude Elberink, "Accuracy
                    and Resolution of Kinect Depth Data", Sensors 12 (2012). Ragged edges and slanted
                    surfaces: Nguyen, Izadi, Lovell, "Modeling Kinect Sensor Noise for Improved 3D
                    Reconstruction and Tracking", 3DIMPVT (2012).
`time-of-flight`    Kinect v2. Deviation by distance and angle: Fankhauser et al., "Kinect v2 for Mobile
                    Robot Navigation: Evaluation and Modeling", ICAR (2015).
`clean`             The depth of the geometry.
==================  ==============================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array
from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.frame import Intrinsics

Sensor = Callable[[Float32Array, Float32Array, Intrinsics, np.random.Generator], Float32Array]
Mask = npt.NDArray[np.bool_]

# Khoshelham: one step of disparity is 2.85e-5 / cm of inverse depth, and depth deviates by half a step,
# 1.425e-3 z^2 m. Rounding to steps contributes 1/sqrt(12) of a step; noise before rounding contributes the rest.
STEP_PER_M = 2.85e-3
NOISE_STEPS = float(np.sqrt(0.5**2 - 1 / 12))
# Disparity is computed in windows: noise is correlated over this many pixels.
WINDOW_PX = 0.8
# Nguyen: lateral deviation 0.8 + 0.035 t / (pi/2 - t) pixels at the angle t of incidence, and beyond 60
# degrees depth deviates by 0.0001 / sqrt(z) t^2 / (pi/2 - t)^2 metres more.
LATERAL_PX, LATERAL_SLANT_PX = 0.8, 0.035
SLANT_M = 1e-4
# Distance between projector and camera, and depth range (Kinect v1), metres.
BASELINE_M = 0.075
STRUCTURED_LIGHT_RANGE_M = (0.45, 5.0)
# Depth range of Kinect v2, metres.
TIME_OF_FLIGHT_RANGE_M = (0.5, 4.5)
CLEAN_RANGE_M = (0.05, 12.0)

# Neighbours that differ by more than this fraction of their depth, plus 1 cm, lie on two surfaces.
EDGE_FRACTION = 0.02
# Fraction of pixels without a reading: at edges, and elsewhere.
EDGE_HOLES, STRAY_HOLES = 0.35, 0.0008
# Angles of incidence (degrees) from which readings begin to be lost, and at which all are.
GRAZING_DEG = (74.0, 85.0)
LARGEST_ANGLE = np.float32(np.radians(88.0))


def structured_light(
    depth_m: Float32Array, cosine: Float32Array, intrinsics: Intrinsics, rng: np.random.Generator
) -> Float32Array:
    """Return depth as Kinect v1 would measure it, (H, W) float32, 0 for no reading.

    Parameters
    ----------
    depth_m : (H, W) float32
        True depth, 0 where there is nothing.
    cosine : (H, W) float32
        Cosine of the angle between ray and surface normal.
    intrinsics : Intrinsics
    rng : numpy.random.Generator
    """
    angle, slant = _incidence(cosine)
    edge = _edges(depth_m)
    depth = _ragged(depth_m, edge, slant, rng)
    seen = np.maximum(depth, np.float32(1e-3))
    steps = _window_noise(depth.shape, rng) * np.float32(NOISE_STEPS)
    steep = np.where(angle > np.radians(60), np.float32(SLANT_M) / np.sqrt(seen) * slant * slant, np.float32(0))
    extra = rng.standard_normal(depth.shape, np.float32) * np.minimum(steep, np.float32(0.05))
    inverse = 1 / (seen + extra).clip(0.05) + np.float32(STEP_PER_M) * steps
    measured = 1 / (np.maximum(np.rint(inverse / np.float32(STEP_PER_M)), 1) * np.float32(STEP_PER_M))
    shadow = np.zeros(depth.shape, np.bool_)
    projector_shadow(depth_m, intrinsics.fx * BASELINE_M, shadow)
    draw = rng.random(depth.shape, np.float32)
    lost = shadow | (edge & (draw < EDGE_HOLES)) | (draw < STRAY_HOLES) | _grazing(angle, draw)
    return _within(measured, depth, lost, STRUCTURED_LIGHT_RANGE_M)


def time_of_flight(
    depth_m: Float32Array, cosine: Float32Array, intrinsics: Intrinsics, rng: np.random.Generator
) -> Float32Array:
    """Return depth as Kinect v2 would measure it; arguments as for `structured_light`.

    At edges some pixels get light from both surfaces and read a depth between the two (flying pixels).
    """
    angle, slant = _incidence(cosine)
    z = depth_m
    deviation_mm = 1.5 - 0.5 * z + 0.3 * z * z + 0.1 * z * np.sqrt(z) * slant * slant
    noise = rng.standard_normal(z.shape, np.float32) * np.minimum(deviation_mm, 50).astype(np.float32) / 1000
    edge = _edges(depth_m)
    near, far = cv2.erode(_filled(depth_m), _CROSS), cv2.dilate(_filled(depth_m), _CROSS)
    draw = rng.random(z.shape, np.float32)
    fraction = rng.random(z.shape, np.float32)
    mixed = np.where(edge & (draw > 0.5), fraction * near + (1 - fraction) * np.minimum(far, z + 1), z)
    lost = (draw < STRAY_HOLES) | _grazing(angle, draw)
    return _within(mixed + noise, z, lost, TIME_OF_FLIGHT_RANGE_M)


def clean(
    depth_m: Float32Array, cosine: Float32Array, intrinsics: Intrinsics, rng: np.random.Generator
) -> Float32Array:
    """Return the true depth, up to 12 m."""
    return _within(depth_m, depth_m, np.zeros(depth_m.shape, np.bool_), CLEAN_RANGE_M)


SENSORS: Mapping[str, Sensor] = MappingProxyType(
    {"structured-light": structured_light, "time-of-flight": time_of_flight, "clean": clean}
)

_CROSS = np.ones((3, 3), np.uint8)
_NOWHERE_M = np.float32(60.0)


def _incidence(cosine: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return the angle t between ray and normal, radians, and t / (pi/2 - t), both (H, W)."""
    angle: Float32Array = np.minimum(np.arccos(np.clip(cosine, 0, 1)), LARGEST_ANGLE)
    slant: Float32Array = angle / (np.float32(np.pi / 2) - angle)
    return angle, slant


def _filled(depth_m: Float32Array) -> Float32Array:
    """Return depth with a far value where nothing is hit."""
    return np.where(depth_m > 0, depth_m, _NOWHERE_M)


def _edges(depth_m: Float32Array) -> Mask:
    """Tell which pixels have a neighbour on another surface."""
    depth = _filled(depth_m)
    jump = cv2.dilate(depth, _CROSS) - cv2.erode(depth, _CROSS)
    # A slanted surface has equal steps to both sides, so its second difference is small: it is no edge.
    bend = np.abs(cv2.Laplacian(depth, cv2.CV_32F, ksize=1))
    edge: Mask = (jump > EDGE_FRACTION * depth + 0.01) & (bend > 0.3 * jump)
    return edge


def _ragged(depth_m: Float32Array, edge: Mask, slant: Float32Array, rng: np.random.Generator) -> Float32Array:
    """Shift the readings of pixels near an edge to those of neighbours, by the lateral deviation."""
    rows, columns = np.nonzero(cv2.dilate(edge.astype(np.uint8), _CROSS))
    deviation = np.minimum(LATERAL_PX + LATERAL_SLANT_PX * slant[rows, columns], 2.0)
    off = np.rint(rng.standard_normal((2, len(rows)), np.float32) * deviation).astype(np.int64)
    other_row = np.clip(rows + off[0], 0, depth_m.shape[0] - 1)
    other_column = np.clip(columns + off[1], 0, depth_m.shape[1] - 1)
    ragged = depth_m.copy()
    ragged[rows, columns] = depth_m[other_row, other_column]
    return ragged


def _window_noise(shape: tuple[int, ...], rng: np.random.Generator) -> Float32Array:
    """Return noise (H, W) of deviation 1 that is correlated between neighbours."""
    kernel = cv2.getGaussianKernel(5, WINDOW_PX).astype(np.float32)
    noise = rng.standard_normal(shape, np.float32)
    blurred = cv2.sepFilter2D(noise, cv2.CV_32F, kernel, kernel)
    return np.asarray(blurred / np.float32((kernel**2).sum()), np.float32)


def _grazing(angle: Float32Array, draw: Float32Array) -> Mask:
    begin, end = np.radians(GRAZING_DEG)
    lost: Mask = draw < (angle - begin) / (end - begin)
    return lost


def _within(
    measured: npt.NDArray[np.floating[Any]], true: Float32Array, lost: Mask, range_m: tuple[float, float]
) -> Float32Array:
    near, far = range_m
    kept = (true > 0) & ~lost & (measured >= near) & (measured <= far)
    return np.where(kept, measured, 0).astype(np.float32)


@kernel
def projector_shadow(depth_m: Float32Array, disparity_at_1_m: float, shadow: Mask) -> None:
    """Mark the pixels that a projector right of the camera does not reach.

    Parameters
    ----------
    depth_m : (H, W) float32
        True depth, 0 where there is nothing.
    disparity_at_1_m : float
        Focal length times baseline, pixels metre.
    shadow : (H, W) bool
        Filled here. Each surface between two neighbouring pixels is drawn into the row of the projector's image, with
        the nearest kept; a pixel is in the shadow if a nearer surface was drawn at its place.
    """
    height, width = depth_m.shape
    nearest = np.zeros(width, np.float32)
    for r in range(height):
        nearest[:] = 0
        for c in range(width - 1):
            if depth_m[r, c] <= 0 or depth_m[r, c + 1] <= 0:
                continue
            d0, d1 = disparity_at_1_m / depth_m[r, c], disparity_at_1_m / depth_m[r, c + 1]
            if abs(d1 - d0) > 1.0:  # two surfaces, or a surface that faces away from the projector
                continue
            low, high = int(np.ceil(c - d0)), int(np.floor(c + 1 - d1))
            for k in range(max(low, 0), min(high, width - 1) + 1):
                nearest[k] = max(nearest[k], max(d0, d1))
        for c in range(width):
            if depth_m[r, c] > 0:
                d = disparity_at_1_m / depth_m[r, c]
                k = int(np.rint(c - d))
                shadow[r, c] = 0 <= k < width and nearest[k] > d + 1.5
