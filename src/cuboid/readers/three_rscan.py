"""3RScan (Wald et al., "RIO: 3D object instance re-localization in changing indoor environments", ICCV 2019).

Expected tree, with sequence.zip unpacked or not::

    0958220d-e2c2-2de1-9710-c37018da1883/
      sequence/                        <- the recording
        _info.txt                      lines "m_colorWidth = 960", ...: sizes, both cameras, units of depth a metre
        frame-000000.color.jpg         8-bit
        frame-000000.depth.pgm         16-bit; .png as well
        frame-000000.pose.txt          4x4 matrix, camera to world

Color is finer than depth, and both are of one place: depth is registered to color.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.core.errors import FrameError, InputError, shown
from cuboid.core.frame import Float64Array
from cuboid.formats.reading import names_in, text_lines
from cuboid.readers.depth_camera import DepthCamera
from cuboid.readers.images import decode_depth
from cuboid.readers.netpbm import read_netpbm
from cuboid.readers.posetext import parse_numbers, pose_from_matrix
from cuboid.readers.reader import READERS, Calibration, FrameEntry, ImageSource, Listing, Reader, has_file
from cuboid.readers.seven_scenes import INFO_3RSCAN, MAX_LINES

FRAME_FILE = re.compile(r"frame-(\d+)\.(color|depth|pose)\.(jpg|png|pgm|txt)")
FIELDS = ("m_colorWidth", "m_colorHeight", "m_depthWidth", "m_depthHeight", "m_depthShift")
CAMERAS = ("m_calibrationColorIntrinsic", "m_calibrationDepthIntrinsic")


def recognises(path: Path) -> bool:
    """Tell whether the folder holds _info.txt and files named frame-NNNNNN.color, .depth or .pose."""
    return (path / INFO_3RSCAN).is_file() and has_file(path, FRAME_FILE)


def read(path: Path) -> Listing:
    """List the frames; InputError where _info.txt has another form."""
    files: dict[str, dict[str, Path]] = {}
    for name in sorted(names_in(path)):
        if match := FRAME_FILE.fullmatch(name):
            files.setdefault(match[1], {})[match[2]] = path / name
    calibration, units = _cameras(path / INFO_3RSCAN)
    frames = [
        FrameEntry(
            color=files[number].get("color"),
            depth=_depth_source(files[number].get("depth")),
            pose=partial(_pose, path / f"frame-{number}.pose.txt"),
        )
        for number in sorted(files, key=int)
    ]
    return Listing(frames, units, calibration, camera_folders=(path,))


def _depth_source(file: Path | None) -> ImageSource | None:
    return partial(_depth, file) if file is not None and file.suffix == ".pgm" else file


def _depth(file: Path) -> npt.NDArray[np.uint16]:
    return np.asarray(decode_depth(lambda: read_netpbm(file, f"depth image {file.name}"), file.name), np.uint16)


def _cameras(path: Path) -> tuple[Calibration, float]:
    """Return the two cameras, and the units of depth a metre."""
    values: dict[str, str] = {}
    for line in text_lines(path):
        name, equals, value = line.partition("=")
        if equals:
            values[name.strip()] = value.strip()
    width, height, depth_width, depth_height, units = (_number(values, name, path) for name in FIELDS)
    color, depth = (_pinhole(values, name, path) for name in CAMERAS)
    camera = DepthCamera(*depth, (int(depth_width), int(depth_height)), np.eye(4))
    return Calibration(*color, (int(width), int(height)), path.name, depth_camera=camera), units


def _number(values: dict[str, str], name: str, path: Path) -> float:
    try:
        (value,) = parse_numbers(values.get(name, ""), 1, "a number above 0")
        if not 0 < value < 1e9:
            raise ValueError(f"expected a number above 0, got {shown(values[name])}")
    except ValueError as error:
        raise InputError(f"{path}: {name}: {error}") from None
    return value


def _pinhole(values: dict[str, str], name: str, path: Path) -> tuple[float, float, float, float]:
    try:
        matrix = parse_numbers(values.get(name, ""), 16, "the 16 numbers of a camera matrix")
    except ValueError as error:
        raise InputError(f"{path}: {name}: {error}") from None
    fx, fy, cx, cy = matrix[0], matrix[5], matrix[2], matrix[6]
    if not np.isfinite([fx, fy, cx, cy]).all() or min(fx, fy) <= 0:
        raise InputError(f"{path}: {name}: expected fx 0 cx 0 0 fy cy 0 ... with fx, fy > 0")
    return fx, fy, cx, cy


def _pose(path: Path) -> Float64Array:
    try:
        words = " ".join(line for _, line in zip(range(MAX_LINES), text_lines(path), strict=False))
        values = parse_numbers(words, 16, "the 16 numbers of a 4x4 matrix")
    except (InputError, ValueError) as error:
        raise FrameError(f"no camera pose: {error}") from None
    return pose_from_matrix(np.reshape(values, (4, 4)), path.name)


READERS.register("3rscan")(Reader("_info.txt, frame-NNNNNN.color.jpg, .depth.pgm, .pose.txt", recognises, read))
