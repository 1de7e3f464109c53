"""Warping of one view into another by a pinhole and a motion: residuals and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.frame import Pinhole
from cuboid.ground.core.tolerances import DEPTH_NOISE_PER_M, MIN_SIGMA_M
from cuboid.inputs.calibration.views import View

# The fitted parameters, in this order: logarithm of the focal length, optical centre in pixels of the small images, and
# logarithm of the depth scale.
FOCAL, CENTER_X, CENTER_Y, DEPTH = range(4)
PARAMETERS = 4
MOTION = 6

# Error of a reading: noise plus MIN_SIGMA_M; PLACE_PX is the error of its position in the image, pixels.
PLACE_PX = 0.7
# Maximum difference of depths at which brightness is compared, metres: beyond it the surfaces are different.
MAX_DEPTH_DIFFERENCE_M = 0.10
# Minimum depth that these cameras see, metres.
NEAREST_SEEN_M = 0.1


@dataclass(frozen=True, slots=True)
class Warped:
    """Pixels of a view that fall on a single surface in another view.

    Attributes
    ----------
    p, q : (N, 3) float64
        The points in the view's camera and in the other's, metres.
    depth, contrast : (3, N) float64
        The other view's values there, as read: value, derivative along the row, derivative along the column.
    noise_m : (N,) float64
        Expected standard deviation of the difference of both depths.
    gap_m : (N,) float64
        The other view's depth minus the point's depth.
    change : (N,) float64
        The other view's contrast minus the pixel's contrast.
    same : (N,) bool
        Whether both see the same surface.
    """

    p: Float64Array
    q: Float64Array
    depth: Float64Array
    contrast: Float64Array
    noise_m: Float64Array
    gap_m: Float64Array
    change: Float64Array
    same: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Disagreement:
    """Residuals of N pixels, and their derivatives.

    Attributes
    ----------
    residual : (N,) float64
    by_parameter : (N, 4) float64
    by_motion : (N, 6) float64
        Derivative by a small motion after T_other_view: translation (metres), rotation (radians).
    """

    residual: Float64Array
    by_parameter: Float64Array
    by_motion: Float64Array


def warp(view: View, other: View, T_other_view: Float64Array, pinhole: Pinhole) -> Warped:
    """Warp the pixels of a view into another view of the same size, by a motion (4, 4).

    Depths are used as read: if the depth scale is not 1, the translation of `T_other_view` is divided by it. Scaling
    the depths instead would favour small scales, because a shrunken world has small differences.
    """
    p = pinhole.points(*view.xyz.T)
    q = p @ T_other_view[:3, :3].T + T_other_view[:3, 3]
    ahead = np.maximum(q[:, 2], NEAREST_SEEN_M)
    column, row = pinhole.fx * q[:, 0] / ahead + pinhole.cx, pinhole.fy * q[:, 1] / ahead + pinhole.cy
    height, width = other.depth_m.shape
    keep = (q[:, 2] > NEAREST_SEEN_M) & (column >= 1) & (column < width - 2) & (row >= 1) & (row < height - 2)
    i, j = np.where(keep, row, 0.0).astype(np.intp), np.where(keep, column, 0.0).astype(np.intp)
    keep &= other.smooth[i, j]
    i, j, row, column, p, q = i[keep], j[keep], row[keep], column[keep], p[keep], q[keep]
    depth = _bilinear(other.depth_m, i, j, row - i, column - j)
    contrast = _bilinear(other.contrast, i, j, row - i, column - j)
    reading_m = np.sqrt(2.0) * (DEPTH_NOISE_PER_M * p[:, 2] ** 2 + MIN_SIGMA_M)
    noise_m = np.hypot(reading_m, PLACE_PX * np.hypot(depth[1], depth[2]))
    gap_m = depth[0] - q[:, 2]
    change = contrast[0] - view.value[keep]
    return Warped(p, q, depth, contrast, noise_m, gap_m, change, np.abs(gap_m) < MAX_DEPTH_DIFFERENCE_M)


def disagreements(
    warped: Warped, T_other_view: Float64Array, pinhole: Pinhole, shift_m: Float64Array
) -> tuple[Disagreement, Disagreement]:
    """Return the residuals of depth (over its noise), and of contrast where both see the same surface.

    `shift_m` (3,) is the part of the translation that is divided by the depth scale.
    """
    p, q, fx, fy = warped.p, warped.q, pinhole.fx, pinhole.fy
    x, y = q[:, 0] / q[:, 2], q[:, 1] / q[:, 2]

    def along(by_column: Float64Array, by_row: Float64Array, by_depth: Float64Array) -> tuple[Float64Array, ...]:
        u, v = by_column * fx / q[:, 2], by_row * fy / q[:, 2]
        by_q = np.stack([u, v, by_depth - u * x - v * y], axis=1)
        by_p = by_q @ T_other_view[:3, :3]
        # the parameters affect both the point p and the projection of q into the other image
        by = np.stack(
            [
                by_column * fx * x + by_row * fy * y - by_p[:, 0] * p[:, 0] - by_p[:, 1] * p[:, 1],
                by_column - by_p[:, 0] * p[:, 2] / fx,
                by_row - by_p[:, 1] * p[:, 2] / fy,
                -(by_q @ shift_m),
            ],
            axis=1,
        )
        return by, np.column_stack([by_q, _cross(q, by_q)])

    weight = 1.0 / warped.noise_m
    by, by_motion = along(warped.depth[1] * weight, warped.depth[2] * weight, -weight)
    depth = Disagreement(warped.gap_m * weight, by, by_motion)
    by, by_motion = along(warped.contrast[1], warped.contrast[2], np.zeros(len(p)))
    same = warped.same
    return depth, Disagreement(warped.change[same], by[same], by_motion[same])


def _cross(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the cross products of vectors (N, 3), three times as fast as numpy.cross."""
    a_x, a_y, a_z = a.T
    b_x, b_y, b_z = b.T
    return np.stack([a_y * b_z - a_z * b_y, a_z * b_x - a_x * b_z, a_x * b_y - a_y * b_x], axis=1)


def _bilinear(
    image: Float32Array,
    row: npt.NDArray[np.intp],
    column: npt.NDArray[np.intp],
    down: Float64Array,
    right: Float64Array,
) -> Float64Array:
    """Return bilinear value, derivative along the row and derivative along the column, (3, N)."""
    a, b = image[row, column].astype(np.float64), image[row, column + 1].astype(np.float64)
    c, d = image[row + 1, column].astype(np.float64), image[row + 1, column + 1].astype(np.float64)
    top, bottom = a + (b - a) * right, c + (d - c) * right
    return np.stack([top + (bottom - top) * down, (b - a) + (d - c - b + a) * down, bottom - top])
