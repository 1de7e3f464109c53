"""The depth of a frame, prepared once: with fewer pixels, without mixed ones, and the small planes in it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cuboid.core.downscaling import SAME_SURFACE
from cuboid.core.frame import Float32Array, Float64Array, Frame, Intrinsics
from cuboid.core.kernels.blocks import halve_depth
from cuboid.core.kernels.cells import CELL_COLUMNS, fit_cells
from cuboid.core.kernels.pixels import drop_mixed
from cuboid.core.tolerances import MIN_READINGS

# Edge of the cells of a picture to which planes are fitted, radians: 3 cm at 1 m.
CELL_RAD = 0.03
# Depths of neighbours on one surface differ by less than this times z squared (plus 1 cm): ten deviations of the first
# Kinect's noise. A reading that does not lies on nothing: it mixes two surfaces.
MIXED_PER_M = 0.014


@dataclass(frozen=True, slots=True)
class DepthImage:
    """A depth image, and the cells that several stages read.

    Attributes
    ----------
    depth_m : (H, W) float32
        Metres, 0 none; nothing changes it any more.
    camera : Intrinsics
        Of this image.
    """

    depth_m: Float32Array
    camera: Intrinsics
    _cells: dict[tuple[float, int], Float64Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    def cells(self, max_depth_m: float, edge: int = 1) -> Float64Array:
        """Return the planes (R, C, CELL_COLUMNS) fitted to cells of `edge` times `cell_pixels` a side.

        They are computed once. See `kernels.cells.fit_cells`.
        """
        known = self._cells.get((max_depth_m, edge))
        if known is None:
            size = edge * cell_pixels(self.camera)
            known = np.empty((self.depth_m.shape[0] // size, self.depth_m.shape[1] // size, CELL_COLUMNS))
            flat = known.reshape(-1, CELL_COLUMNS)
            fit_cells(np.ascontiguousarray(self.depth_m), self.camera.pinhole, size, max_depth_m, flat)
            self._cells[max_depth_m, edge] = known
        return known


def cell_pixels(camera: Intrinsics) -> int:
    """Return the edge of a cell in a camera's image, pixels: an even number, of no fewer readings than tell a slope."""
    return 2 * (max(MIN_READINGS, int(CELL_RAD * camera.fx)) // 2)


def without_mixed(depth_m: Float32Array) -> Float32Array:
    """Return a depth image without the readings that mix two surfaces."""
    clean = np.empty(depth_m.shape, np.float32)
    drop_mixed(depth_m, MIXED_PER_M, clean)
    return clean


def halved(depth_m: Float32Array) -> Float32Array:
    """Return the depth of blocks of 2 x 2 pixels: where one shows two surfaces it is one of them, nothing between."""
    made = np.empty((depth_m.shape[0] // 2, depth_m.shape[1] // 2), np.float32)
    halve_depth(depth_m, SAME_SURFACE, made)
    return made


def shrunk(frame: Frame, intrinsics: Intrinsics, widest: int) -> tuple[DepthImage, int]:
    """Return the depth of a frame, halved until it is no wider than this, without mixed pixels; and its step."""
    depth_m, step = frame.depth_m, 1
    while max(depth_m.shape) > widest:
        depth_m, step = halved(np.ascontiguousarray(depth_m)), step * 2
    return DepthImage(without_mixed(depth_m), intrinsics.downscaled(step)), step
