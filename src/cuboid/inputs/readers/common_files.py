"""Camera files of other programs, recognised by their usual names and fields."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.core.errors import InputError
from cuboid.inputs.readers.documents import read_object
from cuboid.inputs.readers.reader import Calibration

# Usual names; those of Cuboid's own files come first elsewhere.
NAMES = (
    *("camera_params.json", "camera_parameters.json", "cam_params.json", "camera_info.json", "camera_config.json"),
    *("camera_intrinsics.json", "camera_intrinsic.json", "intrinsics.json", "intrinsic.json"),
    *("calibration.json", "calib.json"),
)
# Depth of nested objects that is searched.
NESTED_LEVELS = 3
FOCAL, CENTER = (("fx", "fy"),), (("cx", "cy"), ("ppx", "ppy"))
MATRICES = ("k", "camera_matrix", "intrinsic_matrix", "intrinsics", "intrinsic", "cam_k")
SIZES = (("width", "height"), ("w", "h"), ("image_width", "image_height"))
# Units per metre; a value below 1 is the length of a unit in metres.
SCALES = ("depth_units_per_metre", "depth_units_per_meter", "depth_scale", "png_depth_scale", "depth_factor", "scale")
COLOR = ("color", "colour", "rgb")


def find_common(folder: Path) -> tuple[Calibration, float | None] | None:
    """Return the color camera and the depth units per metre (or None) of the first file in a usual form; else None."""
    for name in NAMES:
        if not (folder / name).is_file():
            continue
        try:
            document = read_object(folder / name)
        except InputError:
            continue
        cameras = list(_cameras(document, ""))
        named = [found for where, found in cameras if any(word in where for word in COLOR)]
        chosen = named or [found for _, found in cameras]
        if len(chosen) == 1:
            K, size = chosen[0]
            return Calibration(*K, size, name), _scale(document)
    return None


_Camera = tuple[tuple[float, float, float, float], tuple[int, int] | None]


def _cameras(document: Mapping[str, Any], where: str, level: int = 0) -> Iterator[tuple[str, _Camera]]:
    """Yield the pinholes in an object and its nested objects, each with the path of its fields in lower case."""
    fields = {str(name).lower(): value for name, value in document.items()}
    K = _pinhole(fields)
    if K is not None:
        size = _pair(fields, SIZES)
        yield where, (K, None if size is None else (int(size[0]), int(size[1])))
        return
    if level < NESTED_LEVELS:
        for name, value in fields.items():
            if isinstance(value, dict):
                yield from _cameras(value, f"{where}/{name}", level + 1)


def _pinhole(fields: Mapping[str, Any]) -> tuple[float, float, float, float] | None:
    focal, center = _pair(fields, FOCAL), _pair(fields, CENTER)
    if focal is not None and center is not None:
        return (*focal, *center)
    for name in MATRICES:
        value = fields.get(name)
        value = value.get("data") if isinstance(value, dict) else value
        try:
            K = np.array(value, np.float64).reshape(3, 3)
        except (TypeError, ValueError):
            continue
        if K[0, 2] == 0.0 and K[2, 0] > 0.0:  # column by column, as Open3D writes it
            K = K.T
        if np.isfinite(K).all() and min(K[0, 0], K[1, 1], K[0, 2], K[1, 2]) > 0.0 and K[2, 2] == 1.0:
            return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])
    return None


def _pair(fields: Mapping[str, Any], names: tuple[tuple[str, str], ...]) -> tuple[float, float] | None:
    for first, second in names:
        a, b = _number(fields.get(first)), _number(fields.get(second))
        if a is not None and b is not None:
            return a, b
    return None


def _number(value: object) -> float | None:
    """Return a positive finite number; None for any other value."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e9:
        return None
    return float(value)


def _scale(document: Mapping[str, Any], level: int = 0) -> float | None:
    """Return the depth units per metre of an object or of the first nested object that has them."""
    fields = {str(name).lower(): value for name, value in document.items()}
    for name in SCALES:
        value = _number(fields.get(name))
        if value is not None:
            return value if value >= 1.0 else 1.0 / value
    nested = (value for value in fields.values() if isinstance(value, dict) and level < NESTED_LEVELS)
    return next((found for one in nested if (found := _scale(one, level + 1)) is not None), None)
