"""`camera.json` and `camera-intrinsics.txt`: the camera that took a recording."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta

from cuboid.ground.core.values import Direction, Entry, FocalLength, ImageSide, PinholeEntry, Pixel, refuse_no_unit
from cuboid.ground.formats.table_validation import Row
from cuboid.ground.geometry.se3 import rigid

# How many coefficients there may be: none, or k1, k2, p1, p2, then k3, then k4, k5, k6.
COEFFICIENTS = (0, 4, 5, 8)
# The two cameras of a device are less than this apart, metres: more is a matrix in millimetres, or another matrix.
FARTHEST_APART_M = 1.0
# Units of depth images that make a metre; of 16 bits, the coarsest that a depth camera can have is the metre itself.
MIN_UNITS, MAX_UNITS = 0.1, 1e7
DepthUnits = Annotated[float, Meta(ge=MIN_UNITS, le=MAX_UNITS)]
Coefficient = Annotated[float, Meta(ge=-1e6, le=1e6)]


Coefficients = Annotated[
    tuple[Coefficient, ...],
    Meta(max_length=8, description="coefficients of the lens: k1, k2, p1, p2[, k3[, k4, k5, k6]]"),
]
MatrixLine = tuple[Pixel, Pixel, Pixel, Pixel]
Matrix = Annotated[
    tuple[MatrixLine, MatrixLine, MatrixLine, MatrixLine],
    Meta(description="4x4, depth camera to color camera, metres; required with depth_camera"),
]


class DepthCameraEntry(PinholeEntry, frozen=True, forbid_unknown_fields=True):
    """The camera of the depth images, if depth is not aligned to color."""

    distortion: Coefficients = ()

    def __post_init__(self) -> None:
        refuse_no_lens(self.distortion)


class CameraDocument(Entry, frozen=True, forbid_unknown_fields=True):
    """The camera of a recording: `camera.json`."""

    fx: FocalLength
    fy: FocalLength
    cx: Annotated[Pixel, Meta(description="pixels; the centre of the top-left pixel is 0, 0")]
    cy: Pixel
    width: ImageSide
    height: ImageSide
    depth_units_per_metre: Annotated[
        DepthUnits | None, Meta(description="units of the depth images per metre; 1000 for millimetres")
    ] = None
    distortion: Coefficients = ()
    depth_camera: Annotated[
        DepthCameraEntry | None, Meta(description="separate depth camera, if depth is not aligned to color")
    ] = None
    T_color_depth: Matrix | None = None
    up_world: Annotated[
        Direction | None, Meta(description="up (opposite to gravity), a unit vector in the world of the poses")
    ] = None

    def __post_init__(self) -> None:
        refuse_no_lens(self.distortion)
        refuse_half_a_camera(self.depth_camera, self.T_color_depth)
        if self.up_world is not None:
            refuse_no_unit("'up_world'", self.up_world)


def refuse_no_lens(distortion: tuple[float, ...]) -> None:
    """Raise ValueError unless the number of coefficients fits a lens model."""
    if len(distortion) not in COEFFICIENTS:
        counts = ", ".join(map(str, COEFFICIENTS[1:]))
        raise ValueError(f"distortion must have {counts} numbers k1, k2, p1, p2, k3, ..., got {len(distortion)}")


def refuse_half_a_camera(camera: DepthCameraEntry | None, matrix: tuple[MatrixLine, ...] | None) -> None:
    """Raise ValueError unless a depth camera comes with its pose, which is near the color camera."""
    if (camera is None) != (matrix is None):
        there, lacking = ("T_color_depth", "depth_camera") if camera is None else ("depth_camera", "T_color_depth")
        raise ValueError(f"'{there}' without '{lacking}': they belong together")
    if matrix is None:
        return
    try:
        apart_m = float(np.linalg.norm(rigid(matrix)[:3, 3]))
    except ValueError as error:
        raise ValueError(f"'T_color_depth': {error}") from None
    if apart_m > FARTHEST_APART_M:
        raise ValueError(f"'T_color_depth' sets the cameras {apart_m:.4g} m apart; is it in millimetres?")


class MatrixRow(Row, frozen=True):
    """A row of a 3x3 camera matrix: `camera-intrinsics.txt`."""

    first: Pixel
    second: Pixel
    third: Pixel
