"""`camera.json` and `camera-intrinsics.txt`: the camera that took a recording."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from cuboid.formats.table_door import Row
from cuboid.formats.values import Entry, FocalLength, ImageSide, Pixel

# How many coefficients there may be: none, or k1, k2, p1, p2, then k3, then k4, k5, k6.
COEFFICIENTS = (0, 4, 5, 8)
# Units of depth images that make a metre; of 16 bits, the coarsest that a depth camera can have is the metre itself.
LEAST_UNITS, MOST_UNITS = 0.1, 1e7
DepthUnits = Annotated[float, Meta(ge=LEAST_UNITS, le=MOST_UNITS)]
Coefficient = Annotated[float, Meta(ge=-1e6, le=1e6)]


class CameraDocument(Entry, frozen=True, forbid_unknown_fields=True):
    """The camera of a recording: `camera.json`."""

    fx: FocalLength
    fy: FocalLength
    cx: Annotated[Pixel, Meta(description="the centre of the top-left pixel is 0, 0")]
    cy: Pixel
    width: ImageSide
    height: ImageSide
    depth_units_per_metre: Annotated[DepthUnits | None, Meta(description="1000 for millimetres")] = None
    distortion: Annotated[
        tuple[Coefficient, ...], Meta(max_length=8, description="of the lens: k1, k2, p1, p2[, k3[, k4, k5, k6]]")
    ] = ()

    def __post_init__(self) -> None:
        if len(self.distortion) not in COEFFICIENTS:
            counts = ", ".join(map(str, COEFFICIENTS[1:]))
            raise ValueError(
                f"distortion must have {counts} numbers k1, k2, p1, p2, k3, ..., got {len(self.distortion)}"
            )


class MatrixRow(Row, frozen=True):
    """A row of a 3x3 camera matrix: `camera-intrinsics.txt`."""

    first: Pixel
    second: Pixel
    third: Pixel
