"""The depth camera of a recording whose depth is not aligned to its color."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.formats.camera_file import CameraDocument
from cuboid.ground.formats.run_file import ConfigEntry
from cuboid.ground.geometry.se3 import rigid

DEPTH_CAMERA, TRANSFORM = "depth_camera", "T_color_depth"
DISTORTION = "distortion"
# Names of the sides of color and depth images.
_SIDES = ("width", "height", "w", "h", "dw", "dh")
_NUMBERS = ("fx", "fy", "cx", "cy", "width", "height")


@dataclass(frozen=True, slots=True, eq=False)
class DepthCamera:
    """A depth camera beside the color camera.

    Attributes
    ----------
    fx, fy, cx, cy : float
        Pixels.
    size : (int, int)
        Width and height of the depth images.
    T_color_depth : (4, 4) float64
        Transform from the depth camera (x right, y down, z forward, metres) to the color camera.
    distortion : tuple of float
        Distortion of the lens, in OpenCV's order; empty for undistorted images.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int]
    T_color_depth: Float64Array
    distortion: tuple[float, ...] = ()

    def __repr__(self) -> str:
        return f"DepthCamera({self.size[0]} x {self.size[1]} pixels, fx {self.fx:.1f}, fy {self.fy:.1f})"

    def document(self) -> dict[str, Any]:
        """Return the depth camera's entry in `camera.json`."""
        values = (self.fx, self.fy, self.cx, self.cy)
        camera: dict[str, Any] = {name: round(value, 4) for name, value in zip(_NUMBERS, values, strict=False)}
        camera |= {"width": self.size[0], "height": self.size[1]}
        if any(self.distortion):
            camera[DISTORTION] = [float(f"{value:.8g}") for value in self.distortion]
        return {DEPTH_CAMERA: camera, TRANSFORM: [[round(v, 9) for v in row] for row in self.T_color_depth.tolist()]}


def depth_camera_of(document: CameraDocument | ConfigEntry) -> DepthCamera | None:
    """Return the depth camera in a `camera.json` or in the settings of a run, or None."""
    camera, matrix = document.depth_camera, document.T_color_depth
    if camera is None or matrix is None:
        return None
    size, distortion = (camera.width, camera.height), tuple(camera.distortion)
    return DepthCamera(camera.fx, camera.fy, camera.cx, camera.cy, size, rigid(matrix), distortion)


def check_number(name: str, value: Any, where: str, prefix: str = "") -> None:
    """Raise InputError unless a value is a valid number: positive (except for centres), at least 1 for sides."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if not number or (value <= 0 and name not in ("cx", "cy")):
        above = " above 0" * (name not in ("cx", "cy"))
        raise InputError(f"{where}: '{prefix}{name}' must be a number{above}, got {shown(value)}")
    if name in _SIDES and value < 1:
        raise InputError(f"{where}: '{prefix}{name}' must be a pixel or more, got {shown(value)}")
