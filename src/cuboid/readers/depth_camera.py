"""The depth camera of a recording whose depth is not aligned to its color."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cuboid.errors import FrameError, InputError
from cuboid.frame import Float64Array
from cuboid.readers.posetext import pose_from_matrix
from cuboid.readers.undistortion import COEFFICIENTS

DEPTH_CAMERA, TRANSFORM = "depth_camera", "T_color_depth"
DISTORTION = "distortion"
_NUMBERS = ("fx", "fy", "cx", "cy", "width", "height")
# The two cameras of a device are less than this apart, metres: more is a matrix in millimetres, or another matrix.
FARTHEST_APART_M = 1.0


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
        Carries coordinates of the depth camera (x right, y down, z forward, metres) to those of the color camera.
    distortion : tuple of float
        Of its lens, in OpenCV's order; empty where the images are a pinhole's.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int]
    T_color_depth: Float64Array
    distortion: tuple[float, ...] = ()

    def document(self) -> dict[str, Any]:
        """Return what `camera.json` says of it."""
        values = (self.fx, self.fy, self.cx, self.cy)
        camera: dict[str, Any] = {name: round(value, 4) for name, value in zip(_NUMBERS, values, strict=False)}
        camera |= {"width": self.size[0], "height": self.size[1]}
        if any(self.distortion):
            camera[DISTORTION] = [float(f"{value:.8g}") for value in self.distortion]
        return {DEPTH_CAMERA: camera, TRANSFORM: [[round(v, 9) for v in row] for row in self.T_color_depth.tolist()]}


def take_depth_camera(document: dict[str, Any], where: str) -> DepthCamera | None:
    """Take the depth camera out of a `camera.json`; None where it has none.

    Parameters
    ----------
    document : dict
        Loses the two fields.
    where : str
        Its file, for messages.

    Raises
    ------
    InputError
        One of the two is missing or makes no sense.
    """
    camera, matrix = document.pop(DEPTH_CAMERA, None), document.pop(TRANSFORM, None)
    if camera is None and matrix is None:
        return None
    if camera is None or matrix is None:
        there, lacking = (TRANSFORM, DEPTH_CAMERA) if camera is None else (DEPTH_CAMERA, TRANSFORM)
        raise InputError(f"{where}: '{there}' without '{lacking}': they belong together")
    if not isinstance(camera, Mapping):
        raise InputError(f"{where}: '{DEPTH_CAMERA}' must be an object with {', '.join(_NUMBERS)}, got {camera!r}")
    fields = dict(camera)
    distortion = read_distortion(fields.pop(DISTORTION, []), where)
    fx, fy, cx, cy, width, height = read_numbers(fields, where, f"{DEPTH_CAMERA}.")
    return DepthCamera(fx, fy, cx, cy, (int(width), int(height)), _transform(matrix, where), distortion)


def read_numbers(
    fields: Mapping[str, Any], where: str, prefix: str = "", others: tuple[str, ...] = ()
) -> tuple[float, ...]:
    """Return fx, fy, cx, cy, width, height of an object that holds these and nothing else; raises InputError.

    `others` names what it may hold besides, and was taken out.
    """
    for name in fields:
        if name not in _NUMBERS:
            expected = ", ".join((*_NUMBERS, DISTORTION, *others))
            raise InputError(f"{where}: unknown field '{prefix}{name}', expected {expected}")
    for name in _NUMBERS:
        if name not in fields:
            raise InputError(f"{where}: '{prefix}{name}' is missing, expected {', '.join(_NUMBERS)}")
        check_number(name, fields[name], where, prefix)
    for name in _NUMBERS[4:]:
        if fields[name] != int(fields[name]):
            raise InputError(f"{where}: '{prefix}{name}' must be a whole number of pixels, got {fields[name]!r}")
    return tuple(float(fields[name]) for name in _NUMBERS)


def check_number(name: str, value: Any, where: str, prefix: str = "") -> None:
    """Raise InputError unless a value is a number, and one above 0 where it is no centre."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if not number or (value <= 0 and name not in ("cx", "cy")):
        above = " above 0" * (name not in ("cx", "cy"))
        raise InputError(f"{where}: '{prefix}{name}' must be a number{above}, got {value!r}")


def read_distortion(values: Any, where: str) -> tuple[float, ...]:
    """Return the coefficients of a lens; raises InputError unless it is a list of 4, 5 or 8 numbers, or empty."""
    whole = isinstance(values, list) and all(
        isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) for value in values
    )
    if not whole or len(values) not in (0, *COEFFICIENTS):
        counts = ", ".join(map(str, COEFFICIENTS))
        raise InputError(
            f"{where}: '{DISTORTION}' must be a list of {counts} numbers k1, k2, p1, p2, k3, ..., got {values!r}"
        )
    return tuple(float(value) for value in values)


def _transform(matrix: Any, where: str) -> Float64Array:
    expected = f"{where}: '{TRANSFORM}' must be a 4x4 matrix (four lists of four numbers), depth camera to color camera"
    try:
        values = np.array(matrix, np.float64)
    except (TypeError, ValueError):
        raise InputError(expected) from None
    if values.shape != (4, 4):
        raise InputError(expected)
    try:
        T = pose_from_matrix(values, f"'{TRANSFORM}'")
    except FrameError as error:
        raise InputError(f"{where}: {error}") from None
    if np.linalg.norm(T[:3, 3]) > FARTHEST_APART_M:
        raise InputError(
            f"{where}: '{TRANSFORM}' sets the cameras {np.linalg.norm(T[:3, 3]):.4g} m apart; is it in millimetres?"
        )
    return T
