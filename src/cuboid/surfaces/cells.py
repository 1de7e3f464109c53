"""The small planes of a frame: what supporting planes are found and tracked from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float32Array, Float64Array, Intrinsics
from cuboid.kernels import cells as kernel

# Edge of a cell in pixels of the 320-pixel wide working image: about 3 cm at 1 m.
CELL_PIXELS = 8
# Residual of 1/z over a cell that is still flat, in units of the sensor's nominal noise of 1/z. Dark and shiny
# table tops show 1.5 to 3 of it, a cell over an object's foot more than 5.
FLAT_RESIDUAL = 4.0


@dataclass(frozen=True, slots=True)
class Cells:
    """The flat cells of a frame, in the world.

    Attributes
    ----------
    place : (N,) int64
        Number of the cell in its image, row by row.
    normal : (N, 3) float64
        Unit, towards the camera.
    center : (N, 3) float64
        Metres.
    area_m2 : (N,) float64
    sigma_m : (N,) float64
        Standard deviation of a reading there.
    image_shape : (int, int)
        Rows and columns of cells.
    """

    place: npt.NDArray[np.int64]
    normal: Float64Array
    center: Float64Array
    area_m2: Float64Array
    sigma_m: Float64Array
    image_shape: tuple[int, int]


def find_cells(
    depth_m: Float32Array,
    camera: Intrinsics,
    T_world_camera: Float64Array,
    noise_per_m: float,
    max_depth_m: float,
) -> Cells:
    """Find the flat cells of a depth image.

    Parameters
    ----------
    depth_m : (H, W) float32
        Metres, 0 none.
    camera : Intrinsics
        Those of this image.
    T_world_camera : (4, 4) float64
    noise_per_m : float
        Standard deviation of depth is this times z squared.
    max_depth_m : float
    """
    rows, columns = depth_m.shape[0] // CELL_PIXELS, depth_m.shape[1] // CELL_PIXELS
    raw = np.empty((rows * columns, kernel.CELL_COLUMNS))
    pinhole = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    kernel.fit_cells(depth_m, pinhole, CELL_PIXELS, max_depth_m, raw)
    flat = np.flatnonzero((raw[:, kernel.AREA] > 0) & (raw[:, kernel.RMS] < FLAT_RESIDUAL * noise_per_m))
    found = raw[flat]
    R, t = T_world_camera[:3, :3], T_world_camera[:3, 3]
    return Cells(
        place=flat,
        normal=found[:, kernel.NX : kernel.NZ + 1] @ R.T,
        center=found[:, kernel.CX : kernel.CZ + 1] @ R.T + t,
        area_m2=found[:, kernel.AREA],
        sigma_m=np.maximum(0.001, noise_per_m * found[:, kernel.CZ] ** 2),
        image_shape=(rows, columns),
    )
