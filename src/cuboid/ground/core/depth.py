"""The depth image of a frame, prepared once: reduced, without mixed pixels, with local planes and its noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.kernels.blocks import halve_depth
from cuboid.ground.core.kernels.cells import AREA, CELL_COLUMNS, RMS, fit_cells
from cuboid.ground.core.kernels.pixels import drop_mixed
from cuboid.ground.core.tolerances import MIN_READINGS

# Edge of the image cells to which planes are fitted, radians: 3 cm at 1 m.
CELL_RAD = 0.03
# Depths of neighbours on one surface differ by less than this times z squared (plus 1 cm): ten standard deviations of
# the first Kinect's noise. A reading that differs by more on both sides lies on neither surface: it mixes two.
MIXED_PER_M = 0.014
# Two readings whose depths differ by less than this fraction of the depth lie on one surface: at 1 m that is
# 1 cm, several times a structured-light sensor's noise and less than an object's step above its table.
SAME_SURFACE = 0.01


@dataclass(frozen=True, slots=True)
class DepthImage:
    """A depth image, and the cells that several stages use.

    Attributes
    ----------
    depth_m : (H, W) float32
        Metres, 0: no reading; never changed afterwards.
    camera : Intrinsics
        Intrinsics of this image.
    """

    depth_m: Float32Array
    camera: Intrinsics
    _cells: dict[tuple[float, int], Float64Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    def cells(self, max_depth_m: float, edge: int = 1) -> Float64Array:
        """Return the planes (R, C, CELL_COLUMNS) fitted to cells of `edge` times `cell_pixels` a side.

        The planes are computed once and kept. See `kernels.cells.fit_cells`.
        """
        cells = self._cells.get((max_depth_m, edge))
        if cells is None:
            size = edge * cell_pixels(self.camera)
            cells = np.empty((self.depth_m.shape[0] // size, self.depth_m.shape[1] // size, CELL_COLUMNS))
            flat = cells.reshape(-1, CELL_COLUMNS)
            fit_cells(np.ascontiguousarray(self.depth_m), self.camera.pinhole, size, max_depth_m, flat)
            self._cells[max_depth_m, edge] = cells
        return cells


def cell_pixels(camera: Intrinsics) -> int:
    """Return the edge of a cell, pixels: an even number near `CELL_RAD`, large enough to measure a slope."""
    return 2 * (max(MIN_READINGS, int(CELL_RAD * camera.fx)) // 2)


def without_mixed(depth_m: Float32Array) -> Float32Array:
    """Return a depth image (H, W), metres, without the readings that mix two surfaces."""
    clean = np.empty(depth_m.shape, np.float32)
    drop_mixed(depth_m, MIXED_PER_M, clean)
    return clean


def halved(depth_m: Float32Array) -> Float32Array:
    """Return the depth (H // 2, W // 2) of 2 x 2 blocks of (H, W), metres.

    A block that shows two surfaces gets the depth of one, never a mean of both.
    """
    made = np.empty((depth_m.shape[0] // 2, depth_m.shape[1] // 2), np.float32)
    halve_depth(depth_m, SAME_SURFACE, made)
    return made


def shrunk(frame: Frame, intrinsics: Intrinsics, widest: int) -> tuple[DepthImage, int]:
    """Return the depth of a frame, halved until no side exceeds `widest` pixels, without mixed pixels; and its step."""
    depth_m, step = frame.depth_m, 1
    while max(depth_m.shape) > widest:
        depth_m, step = halved(np.ascontiguousarray(depth_m)), step * 2
    return DepthImage(without_mixed(depth_m), intrinsics.downscaled(step)), step


# Upper limit of the noise estimate, as a multiple of the nominal noise: a larger excess comes from clutter.
MAX_EXCESS = 1.4
# At least this fraction of the cells of an image show a single flat surface.
FLAT_FRACTION = 0.2


def excess_noise(image: DepthImage, nominal_per_m: float, max_depth_m: float) -> float:
    """Return the measured noise of a depth image as a multiple of the nominal noise, 1..`MAX_EXCESS`.

    Depth errors of real sensors are correlated over areas and exceed the nominal noise; first Kinects and RealSense
    cameras show 1.4 times the published noise of the first Kinect over cells of 0.06 radians.

    Parameters
    ----------
    image : DepthImage
    nominal_per_m : float
        1/metre.
    max_depth_m : float
    """
    # Two cells wide: about the size of the areas over which the noise is correlated.
    cells = image.cells(max_depth_m, 2)
    rms = cells[cells[..., AREA] > 0, RMS]
    if len(rms) < MIN_READINGS:
        return 1.0
    # The residuals at the quantile FLAT_FRACTION show all but that fraction of the noise.
    return float(np.clip(np.quantile(rms, FLAT_FRACTION) / ((1.0 - FLAT_FRACTION) * nominal_per_m), 1.0, MAX_EXCESS))


def resolves_m(edge_m: float, noise_per_m: float, focal_px: float) -> float:
    """Return the depth up to which voxels of this edge length resolve a surface, metres.

    At that depth the standard deviation of a reading, or the width of a pixel, equals the edge: beyond it, a mean of
    several readings is more accurate.
    """
    return float(min(np.sqrt(edge_m / noise_per_m), edge_m * focal_px))
