"""Scans of ScanNet as its own tool extracts them (Dai et al., CVPR 2017).

Expected tree::

    scene0000_00/                     <- the recording
      color/0.jpg                     8-bit, 1296x968
      depth/0.png                     16-bit, 640x480, millimetres
      pose/0.txt                      4x4 matrix, camera to world; inf: the frame is lost
      intrinsic/intrinsic_color.txt   4x4 matrices
      intrinsic/intrinsic_depth.txt

Color and depth are of one place and of two cameras' images: depth is registered to color.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np

from cuboid.core.errors import FrameError, InputError
from cuboid.core.frame import Float64Array
from cuboid.formats.table_validation import data_lines
from cuboid.readers.calibration import CAMERA_FILE
from cuboid.readers.depth_camera import DepthCamera
from cuboid.readers.image_folder import images_in
from cuboid.readers.images import image_dimensions
from cuboid.readers.posetext import parse_numbers, pose_from_matrix
from cuboid.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader

DEPTH_UNITS_PER_METRE = 1000.0
COLOR_K, DEPTH_K = "intrinsic/intrinsic_color.txt", "intrinsic/intrinsic_depth.txt"
NUMBER = re.compile(r"\d+")


def recognises(path: Path) -> bool:
    """Tell whether the folder holds color, depth, pose and the two intrinsics."""
    folders = all((path / name).is_dir() for name in ("color", "depth", "pose"))
    return folders and (path / COLOR_K).is_file() and not (path / CAMERA_FILE).is_file()


def read(path: Path) -> Listing:
    """List the frames; InputError where the intrinsics have another form."""
    colors, depths = _by_number(path / "color"), _by_number(path / "depth")
    frames = [
        FrameEntry(colors.get(number), depths.get(number), pose=partial(_pose, path / "pose" / f"{number}.txt"))
        for number in sorted(colors.keys() | depths.keys())
    ]
    if not frames:
        raise InputError(f"{path}: color/ and depth/ hold no images")
    return Listing(frames, DEPTH_UNITS_PER_METRE, _calibration(path, colors, depths), camera_folders=(path,))


def _by_number(folder: Path) -> dict[int, Path]:
    return {int(file.stem): file for file in images_in(folder) if NUMBER.fullmatch(file.stem)}


def _calibration(path: Path, colors: dict[int, Path], depths: dict[int, Path]) -> Calibration:
    sizes = [next((image_dimensions(one[n]) for n in sorted(one)), None) for one in (colors, depths)]
    K = _matrix(path / COLOR_K)
    fx, fy, cx, cy = (float(value) for value in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    if not (path / DEPTH_K).is_file() or sizes[1] is None or sizes[0] is None:
        return Calibration(fx, fy, cx, cy, sizes[0], COLOR_K)
    D = _matrix(path / DEPTH_K)
    camera = DepthCamera(float(D[0, 0]), float(D[1, 1]), float(D[0, 2]), float(D[1, 2]), sizes[1], np.eye(4))
    return Calibration(fx, fy, cx, cy, sizes[0], COLOR_K, depth_camera=camera)


def _matrix(path: Path) -> Float64Array:
    """Read the rows of a camera matrix, 4x4 or 3x3."""
    rows = []
    for number, line in data_lines(path):
        try:
            rows.append(parse_numbers(line, len(line.split()), "numbers"))
        except ValueError as error:
            raise InputError(f"{path} line {number}: {error}") from None
    if len(rows) not in (3, 4) or any(len(row) != len(rows) for row in rows):
        raise InputError(f"{path}: expected a 4x4 matrix, got {len(rows)} rows")
    K = np.array(rows)
    if not (np.isfinite(K).all() and K[0, 0] > 0 and K[1, 1] > 0):
        raise InputError(f"{path}: expected the matrix fx 0 cx 0, 0 fy cy 0, ... with fx, fy > 0")
    return K


def _pose(path: Path) -> Float64Array:
    try:
        rows = [parse_numbers(line, 4, "four numbers a row") for _, line in data_lines(path)]
    except (InputError, ValueError) as error:
        raise FrameError(f"no camera pose: {error}") from None
    if len(rows) != 4:
        raise FrameError(f"no camera pose: {path.name} has {len(rows)} rows, expected the 4 of a 4x4 matrix")
    return pose_from_matrix(rows, path.name)


READERS.register("scannet")(
    Reader("color/, depth/, pose/, intrinsic/intrinsic_color.txt", recognises, read),
)
