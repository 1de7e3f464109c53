"""Views for calibration: small images of a frame, and its most informative pixels."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.downscaling import downscale
from cuboid.ground.core.frame import Frame, Intrinsics, Pinhole

# Brightness is normalised by local mean and contrast, with a Gaussian of this standard deviation, pixels: cameras
# change exposure, and shiny surfaces change with the angle.
LOCAL_PX = 8.0
# Contrast below this many grey levels is sensor noise, and is not amplified.
NOISE_LEVELS = 4.0
# Maximum relative difference of depth within a block of 2 x 2 readings on one surface: more than a plane seen at 80
# degrees has, less than the step at an object's edge.
SMOOTH_BLOCK_FRACTION = 0.04
# Minimum width of coarse images; width from which images are not refined further: fine images have pixels half as
# large.
COARSE_PX, FINE_PX = 150, 300
# Side of a cell, pixels; the pixel with the strongest brightness gradient of each cell is used.
GRADIENT_CELL_PX = 8


@dataclass(frozen=True, slots=True)
class View:
    """A downsampled frame, prepared for comparison with others.

    Attributes
    ----------
    index : int
        Index of the frame in its recording.
    T_world_camera : (4, 4) float64
    contrast : (H, W) float32
        Brightness without local mean and contrast.
    depth_m : (H, W) float32
    smooth : (H, W) bool
        Whether the readings at, right of, below and diagonally below this pixel lie on one surface.
    xyz : (N, 3) float64
        Column, row and depth (metres) of the pixels that are warped into other views.
    value : (N,) float64
        Contrast of these pixels.
    """

    index: int
    T_world_camera: Float64Array
    contrast: Float32Array
    depth_m: Float32Array
    smooth: npt.NDArray[np.bool_]
    xyz: Float64Array
    value: Float64Array


@dataclass(frozen=True, slots=True)
class ScaledPinhole(Pinhole):
    """A pinhole, and the true metres per metre of depth.

    Attributes
    ----------
    depth_scale : float
    """

    depth_scale: float = 1.0

    @classmethod
    def of(cls, intrinsics: Intrinsics) -> ScaledPinhole:
        """Return the pinhole of intrinsics."""
        return cls(intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)

    def resized(self, factor: float) -> ScaledPinhole:
        """Return the pinhole of images whose pixels are blocks of `factor` x `factor` (1/2, 1/4: parts) of these."""
        shift = (factor - 1) / 2
        return ScaledPinhole(
            self.fx / factor, self.fy / factor, (self.cx - shift) / factor, (self.cy - shift) / factor, self.depth_scale
        )


def factors(width_px: int) -> tuple[int, int]:
    """Return the downsampling factors, coarse and fine, for images of this width."""
    coarse = max(factor for factor in (1, 2, 4) if factor == 1 or width_px // factor >= COARSE_PX)
    return coarse, coarse if width_px // coarse >= FINE_PX else max(1, coarse // 2)


def build_view(frame: Frame, factor: int) -> View:
    """Return the view of a frame with a pose, downsampled by 1, 2 or 4."""
    assert frame.T_world_camera is not None
    small = downscale(frame, factor)
    contrast = _contrast(small.color)
    smooth = _smooth(small.depth_m)
    rows, columns = _telling(contrast, smooth)
    xyz = np.stack([columns, rows, small.depth_m[rows, columns]], axis=1).astype(np.float64)
    value = contrast[rows, columns].astype(np.float64)
    return View(frame.index, frame.T_world_camera, contrast, small.depth_m, smooth, xyz, value)


def _contrast(color: npt.NDArray[np.uint8]) -> Float32Array:
    grey = cv2.GaussianBlur(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 0.8)
    rest = grey - cv2.GaussianBlur(grey, (0, 0), LOCAL_PX)
    deviation = np.sqrt(cv2.GaussianBlur(rest * rest, (0, 0), LOCAL_PX))
    return (rest / (deviation + np.float32(NOISE_LEVELS))).astype(np.float32)


def _smooth(depth_m: Float32Array) -> npt.NDArray[np.bool_]:
    block = np.stack([depth_m[:-1, :-1], depth_m[:-1, 1:], depth_m[1:, :-1], depth_m[1:, 1:]])
    low, high = block.min(0), block.max(0)
    smooth = np.zeros(depth_m.shape, np.bool_)
    smooth[:-1, :-1] = (low > 0) & (high - low < SMOOTH_BLOCK_FRACTION * low)
    return smooth


def _telling(
    contrast: Float32Array, smooth: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return rows and columns of the pixel with the strongest gradient, on one surface, of each cell."""
    height, width = (side // GRADIENT_CELL_PX for side in contrast.shape)
    change = np.hypot(cv2.Sobel(contrast, cv2.CV_32F, 1, 0), cv2.Sobel(contrast, cv2.CV_32F, 0, 1))
    change = np.where(smooth, change, np.float32(-1.0))[: height * GRADIENT_CELL_PX, : width * GRADIENT_CELL_PX]
    cells = (
        change.reshape(height, GRADIENT_CELL_PX, width, GRADIENT_CELL_PX)
        .transpose(0, 2, 1, 3)
        .reshape(-1, GRADIENT_CELL_PX**2)
    )
    best = cells.argmax(1)
    found = cells[np.arange(len(cells)), best] >= 0
    row, column = np.divmod(np.arange(len(cells)), width)
    rows = row * GRADIENT_CELL_PX + best // GRADIENT_CELL_PX
    columns = column * GRADIENT_CELL_PX + best % GRADIENT_CELL_PX
    return rows[found], columns[found]
