"""Local planes of a frame: the input from which supporting planes are found and tracked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.depth import DepthImage, cell_pixels
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.kernels import cells as kernel
from cuboid.ground.core.tolerances import JUMP_SIGMAS, MIN_SIGMA_M

# Level patches are searched only beyond this distance, metres (an arm's length); nearer, cells show the same.
PATCHES_BEYOND_M = 1.2
# Smallest number of cells of a surface.
MIN_CELLS = 6
# A cell is flat if its residual of 1/z is within JUMP_SIGMAS of the sensor's noise: dark and shiny table tops show 1.5
# to 3 standard deviations, a cell over the foot of an object more than 5.


@dataclass(frozen=True, slots=True)
class Cells:
    """The flat cells of a frame, in the world.

    Attributes
    ----------
    places : (N, 4) int64
        Indices, row by row, of the four patches that a cell covers, see `patch_pixels`; a patch repeats its own index.
    normal : (N, 3) float64
        Unit, towards the camera.
    center : (N, 3) float64
        Metres.
    area_m2 : (N,) float64
    sigma_m : (N,) float64
        Standard deviation of a depth reading at the cell.
    image_shape : (int, int)
        Rows and columns of patches.
    """

    places: npt.NDArray[np.int64]
    normal: Float64Array
    center: Float64Array
    area_m2: Float64Array
    sigma_m: Float64Array
    image_shape: tuple[int, int]


def patch_pixels(camera: Intrinsics) -> int:
    """Return the edge of a patch in a camera's image, pixels: half a cell.

    Beyond `PATCHES_BEYOND_M`, level patches are searched in addition to cells: of a distant shelf seen at a grazing
    angle, no cell shows the board alone.
    """
    return cell_pixels(camera) // 2


def find_cells(image: DepthImage, T_world_camera: Float64Array, noise_per_m: float, max_depth_m: float) -> Cells:
    """Find the flat cells of a depth image.

    Parameters
    ----------
    image : DepthImage
    T_world_camera : (4, 4) float64
    noise_per_m : float
        The standard deviation of depth is this value times z squared.
    max_depth_m : float
    """
    patch, cells = patch_pixels(image.camera), image.cells(max_depth_m)
    columns, raw = cells.shape[1], cells.reshape(-1, kernel.CELL_COLUMNS)
    flat = np.flatnonzero((raw[:, kernel.AREA] > 0) & (raw[:, kernel.RMS] < JUMP_SIGMAS * noise_per_m))
    found = raw[flat]
    R, t = T_world_camera[:3, :3], T_world_camera[:3, 3]
    shape = image.depth_m.shape[0] // patch, image.depth_m.shape[1] // patch
    r, c = np.divmod(flat, columns)
    return Cells(
        places=(2 * r * shape[1] + 2 * c)[:, None] + np.array([0, 1, shape[1], shape[1] + 1]),
        normal=found[:, kernel.NX : kernel.NZ + 1] @ R.T,
        center=found[:, kernel.CX : kernel.CZ + 1] @ R.T + t,
        area_m2=found[:, kernel.AREA],
        sigma_m=np.maximum(MIN_SIGMA_M, noise_per_m * found[:, kernel.CZ] ** 2),
        image_shape=shape,
    )


def with_level_patches(
    cells: Cells,
    up: Float64Array,
    image: DepthImage,
    T_world_camera: Float64Array,
    noise_per_m: float,
    max_depth_m: float,
) -> Cells:
    """Add level patches where no cell is flat; see `find_cells`.

    Parameters
    ----------
    cells : Cells
    up : (3,) float64
        Unit vector in the world.
    image, T_world_camera, noise_per_m, max_depth_m
        As for `find_cells`.
    """
    rows, columns = cells.image_shape
    skip = np.zeros((rows, columns), np.uint8)
    skip.ravel()[cells.places] = 1
    patches = np.empty((rows * columns, 5))
    R, t = T_world_camera[:3, :3], T_world_camera[:3, 3]
    seen_by, patch = (image.depth_m, image.camera.pinhole, up @ R), patch_pixels(image.camera)
    number = kernel.level_patches(*seen_by, patch, noise_per_m, PATCHES_BEYOND_M, max_depth_m, skip, patches)
    level = patches[:number]
    return Cells(
        places=np.concatenate([cells.places, np.repeat(level[:, 4:].astype(np.int64), 4, axis=1)]),
        normal=np.concatenate([cells.normal, np.tile(up, (number, 1))]),
        center=np.concatenate([cells.center, level[:, :3] @ R.T + t]),
        area_m2=np.concatenate([cells.area_m2, level[:, 3]]),
        sigma_m=np.concatenate([cells.sigma_m, np.maximum(MIN_SIGMA_M, noise_per_m * level[:, 2] ** 2)]),
        image_shape=cells.image_shape,
    )
