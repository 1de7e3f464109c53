"""Recordings of InfiniTAM (Kaehler et al., ISMAR 2015).

Expected tree::

    teddy/                       <- the recording
      calib.txt                  see below
      Frames/0000.ppm            8-bit color; .png or .jpg as well
      Frames/0000.pgm            16-bit: disparity of a Kinect, or depth

`calib.txt` contains, separated by blanks: width, height, fx, fy, cx, cy of the color camera; the same of the depth
camera; three rows of a 3x4 matrix, color camera to depth camera, in metres; then the conversion of an image value d to
depth::

    [kinect] a b                 8 b fx / (a - d) metres, fx that of the depth camera
    affine a b                   a d + b metres
    0 0                          d millimetres

Color and depth are paired by the first number in their names. Depth is registered to color.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.errors import FrameError, InputError, shown
from cuboid.ground.formats.reading import names_in
from cuboid.ground.formats.table_validation import data_lines
from cuboid.ground.geometry import se3
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.netpbm import read_netpbm
from cuboid.inputs.readers.posetext import pose_from_matrix
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, ImageSource, Listing, Reader, has_file

CALIBRATION, FRAMES = "calib.txt", "Frames"
FILE = re.compile(r"\D*(\d+)\.(ppm|png|jpg|pgm)")
DEPTH_FILE = re.compile(r"\D*\d+\.pgm")
# Maximum image value for a reading with an affine conversion.
MAX_AFFINE = 32000


@dataclass(frozen=True, slots=True)
class _Rule:
    """The conversion of image values to metres."""

    affine: bool
    a: float
    b: float
    fx: float

    def metres(self, d: Float32Array) -> Float32Array:
        """Return depth in metres, 0 where there is no reading."""
        if self.affine:
            # In double precision: float32 cannot represent 0.001 exactly.
            return np.where((d > 0) & (d <= MAX_AFFINE), self.a * d.astype(np.float64) + self.b, 0).astype(np.float32)
        away = np.where((d > 0) & (d < self.a), self.a - d, np.inf)
        return (8 * self.b * self.fx / away).astype(np.float32)


def recognises(path: Path) -> bool:
    """Tell whether the folder holds calib.txt, and Frames with files NNNN.pgm."""
    return (path / CALIBRATION).is_file() and has_file(path / FRAMES, DEPTH_FILE)


def read(path: Path) -> Listing:
    """List the frames; raise InputError if calib.txt has another format."""
    calibration, rule = _calibration(path / CALIBRATION)
    files: dict[int, dict[str, Path]] = {}
    for name in sorted(names_in(path / FRAMES)):
        if match := FILE.fullmatch(name):
            kind = "depth" if match[2] == "pgm" else "color"
            files.setdefault(int(match[1]), {})[kind] = path / FRAMES / name
    frames = [
        FrameEntry(color=_color_source(files[k].get("color")), depth=_depth_source(files[k].get("depth"), rule))
        for k in sorted(files)
    ]
    return Listing(frames, 1.0, calibration, camera_folders=(path,))


def _color_source(file: Path | None) -> ImageSource | None:
    return file if file is None or file.suffix != ".ppm" else partial(read_netpbm, file, f"color image {file.name}")


def _depth_source(file: Path | None, rule: _Rule) -> Callable[[], Any] | None:
    return None if file is None else partial(_depth, file, rule)


def _depth(file: Path, rule: _Rule) -> Float32Array:
    image = read_netpbm(file, f"depth image {file.name}")
    if image.ndim != 2 or image.dtype != np.uint16:
        raise FrameError(f"depth image {file.name} must have one channel of 16 bits, it is {image.dtype}")
    return rule.metres(image.astype(np.float32))


def _calibration(path: Path) -> tuple[Calibration, _Rule]:
    """Return both cameras, and the conversion of depth."""
    words = " ".join(line for _, line in data_lines(path)).split()
    affine = "affine" in words
    numbers = _numbers([word for word in words if word not in ("affine", "kinect")], path)
    (width, height, *color), (depth_width, depth_height, *depth) = numbers[:6], numbers[6:12]
    if min(width, height, depth_width, depth_height, *color[:2], *depth[:2]) <= 0:
        raise InputError(f"{path}: expected width height fx fy cx cy of color, then of depth, all above 0")
    fx, fy, cx, cy = depth
    depth_size = (int(depth_width), int(depth_height))
    camera = DepthCamera(fx, fy, cx, cy, depth_size, _T_color_depth(numbers[12:24], path))
    a, b = numbers[24:]
    rule = _Rule(True, 0.001, 0.0, fx) if a == b == 0 else _Rule(affine, a, b, fx)
    fx, fy, cx, cy = color
    return Calibration(fx, fy, cx, cy, (int(width), int(height)), path.name, depth_camera=camera), rule


def _numbers(words: list[str], path: Path) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != 26 or not (np.abs(numbers) < 1e9).all():
        expected = "26 numbers: two cameras of 6, a 3x4 matrix, and two for depth"
        raise InputError(f"{path}: expected {expected}; got {len(words)}: {shown(' '.join(words))}")
    return numbers


def _T_color_depth(matrix: list[float], path: Path) -> Float64Array:
    try:
        T_depth_color = pose_from_matrix(np.reshape([*matrix, 0, 0, 0, 1], (4, 4)), "the matrix of color to depth")
    except FrameError as error:
        raise InputError(f"{path}: {error}") from None
    return se3.inverse(T_depth_color)


READERS.register("infinitam")(Reader("calib.txt, Frames/NNNN.ppm, Frames/NNNN.pgm", recognises, read))
