"""Effects of depth cameras: ragged edges, shadows, holes, noise that is alike in neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array
from cuboid.ground.compiling.compiled import kernel

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Seen:
    """The true surfaces in front of a sensor.

    Attributes
    ----------
    depth_m : (H, W) float32
        True depth, 0 where there is nothing.
    cosine : (H, W) float32
        Cosine of the angle between ray and surface normal.
    albedo : (H, W) float32
        Fraction of the light that the surface reflects, 0..1.
    shine : (H, W) float32
        Strength of its highlight, 0..1.
    """

    depth_m: Float32Array
    cosine: Float32Array
    albedo: Float32Array
    shine: Float32Array


# Disparity is computed in windows: noise is correlated over this many pixels.
WINDOW_PX = 0.8
# Nguyen, Izadi, Lovell, "Modeling Kinect Sensor Noise", 3DIMPVT (2012): lateral deviation 0.8 + 0.035 t / (pi/2 - t)
# pixels at the angle t of incidence.
LATERAL_PX, LATERAL_SLANT_PX = 0.8, 0.035

# Neighbours that differ by more than this fraction of their depth, plus 1 cm, lie on two surfaces.
EDGE_FRACTION = 0.02
# Fraction of pixels without a reading: at edges, and elsewhere.
EDGE_HOLES, STRAY_HOLES = 0.35, 0.0008
# Angles of incidence (degrees) from which readings begin to be lost, and at which all are.
GRAZING_DEG = (74.0, 85.0)
LARGEST_ANGLE = np.float32(np.radians(88.0))

CROSS = np.ones((3, 3), np.uint8)
_NOWHERE_M = np.float32(60.0)


def incidence(cosine: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return the angle t between ray and normal, radians, and t / (pi/2 - t), both (H, W)."""
    angle: Float32Array = np.minimum(np.arccos(np.clip(cosine, 0, 1)), LARGEST_ANGLE)
    slant: Float32Array = angle / (np.float32(np.pi / 2) - angle)
    return angle, slant


def filled(depth_m: Float32Array) -> Float32Array:
    """Return depth (H, W), metres, with a far value where nothing is hit."""
    return np.where(depth_m > 0, depth_m, _NOWHERE_M)


def edges(depth_m: Float32Array) -> Mask:
    """Tell which pixels (H, W) have a neighbour on another surface."""
    depth = filled(depth_m)
    jump = cv2.dilate(depth, CROSS) - cv2.erode(depth, CROSS)
    # A slanted surface has equal steps to both sides, so its second difference is small: it is no edge.
    bend = np.abs(cv2.Laplacian(depth, cv2.CV_32F, ksize=1))
    edge: Mask = (jump > EDGE_FRACTION * depth + 0.01) & (bend > 0.3 * jump)
    return edge


def ragged(depth_m: Float32Array, edge: Mask, slant: Float32Array, rng: np.random.Generator) -> Float32Array:
    """Shift the readings (H, W) of pixels near an edge to those of neighbours, by the lateral deviation."""
    rows, columns = np.nonzero(cv2.dilate(edge.astype(np.uint8), CROSS))
    deviation = np.minimum(LATERAL_PX + LATERAL_SLANT_PX * slant[rows, columns], 2.0)
    off = np.rint(rng.standard_normal((2, len(rows)), np.float32) * deviation).astype(np.int64)
    other_row = np.clip(rows + off[0], 0, depth_m.shape[0] - 1)
    other_column = np.clip(columns + off[1], 0, depth_m.shape[1] - 1)
    ragged = depth_m.copy()
    ragged[rows, columns] = depth_m[other_row, other_column]
    return ragged


def window_noise(shape: tuple[int, ...], rng: np.random.Generator) -> Float32Array:
    """Return noise (H, W) of deviation 1 that is correlated between neighbours."""
    kernel = cv2.getGaussianKernel(5, WINDOW_PX).astype(np.float32)
    noise = rng.standard_normal(shape, np.float32)
    blurred = cv2.sepFilter2D(noise, cv2.CV_32F, kernel, kernel)
    return np.asarray(blurred / np.float32((kernel**2).sum()), np.float32)


def grazing(angle: Float32Array, draw: Float32Array) -> Mask:
    """Return the pixels (H, W) that read nothing because of their angle; `draw` is a random number 0..1 for each."""
    begin, end = np.radians(GRAZING_DEG)
    lost: Mask = draw < (angle - begin) / (end - begin)
    return lost


def within(
    measured: npt.NDArray[np.floating[Any]], true: Float32Array, lost: Mask, range_m: tuple[float, float]
) -> Float32Array:
    """Return measured depth (H, W), metres, 0 where it is lost or out of range, or where there is nothing."""
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
