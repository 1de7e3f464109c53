"""Folders of Open3D's recorder and reconstruction system, and of the Redwood scans.

Expected tree::

    scan/                         <- the recording
      color/000000.jpg            8-bit color (.png as well); or image/, or rgb/
      depth/000000.png            16-bit, millimetres, aligned to color
      camera_intrinsic.json       or intrinsic.json: width, height, intrinsic_matrix (9 numbers, column by column)
      trajectory.log              camera to world, 5 lines a frame; or scene/trajectory.log; may be absent

Color and depth are paired by the first number in their names. Without a file of intrinsics, Open3D's default is used: a
PrimeSense camera's, for 640x480.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import Any

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.formats.reading import names_in
from cuboid.ground.formats.table_validation import data_lines
from cuboid.inputs.readers.calibration import CAMERA_FILE
from cuboid.inputs.readers.depth_camera import check_number
from cuboid.inputs.readers.documents import read_object
from cuboid.inputs.readers.image_folder import images_in
from cuboid.inputs.readers.posetext import parse_numbers, pose_from_matrix
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader

DEPTH_UNITS_PER_METRE = 1000.0
COLOR_FOLDERS = ("color", "image", "rgb")
INTRINSIC_FILES = ("camera_intrinsic.json", "intrinsic.json")
TRAJECTORY = "trajectory.log"
# Of Open3D's PinholeCameraIntrinsicParameters.PrimeSenseDefault.
PRIMESENSE = Calibration(525.0, 525.0, 319.5, 239.5, (640, 480), "Open3D's PrimeSense default")
FIRST_NUMBER = re.compile(r"\D*(\d+)")

# The pose of a frame in the file: its first line number, and 16 numbers.
LoggedPose = tuple[int, list[float]]


def recognises(path: Path) -> bool:
    """Tell whether the folder contains depth, color and Open3D's files beside them."""
    if not (path / "depth").is_dir() or _color(path) is None or (path / CAMERA_FILE).is_file():
        return False
    return any((path / name).is_file() for name in INTRINSIC_FILES) or _trajectory(path) is not None


def read(path: Path) -> Listing:
    """List the frames; raise InputError if a name, the intrinsics or the trajectory has another format."""
    folder = _color(path)
    assert folder is not None, "recognises"
    colors, depths = _by_number(folder), _by_number(path / "depth")
    numbers = sorted(colors.keys() | depths.keys())
    log = _trajectory(path)
    poses = None if log is None else _read_log(log)
    frames = [
        FrameEntry(
            color=colors.get(number),
            depth=depths.get(number),
            pose=None if poses is None or log is None else partial(_pose, poses, k, log.name),
        )
        for k, number in enumerate(numbers)
    ]
    if not frames:
        raise InputError(f"{path}: {folder.name}/ and depth/ hold no images")
    file = next((path / name for name in INTRINSIC_FILES if (path / name).is_file()), None)
    calibration = PRIMESENSE if file is None else _intrinsics(file)
    assumed = "" if file is not None else "the recording has no file of intrinsics"
    return Listing(frames, DEPTH_UNITS_PER_METRE, calibration, camera_folders=(path,), assumed=assumed)


def _color(path: Path) -> Path | None:
    return next((path / name for name in COLOR_FOLDERS if (path / name).is_dir()), None)


def _trajectory(path: Path) -> Path | None:
    """Return the trajectory here or one folder below, the first by name."""
    if (path / TRAJECTORY).is_file():
        return path / TRAJECTORY
    return next(
        (path / name / TRAJECTORY for name in sorted(names_in(path)) if (path / name / TRAJECTORY).is_file()), None
    )


def _by_number(folder: Path) -> dict[int, Path]:
    """Return the images of a folder by the first number in their names."""
    images: dict[int, Path] = {}
    for file in images_in(folder):
        match = FIRST_NUMBER.match(file.stem)
        if match is None:
            raise InputError(f"{file}: the name must hold the frame's number")
        if int(match[1]) in images:
            raise InputError(f"{folder}: {images[int(match[1])].name} and {file.name} have the same number")
        images[int(match[1])] = file
    return images


def _intrinsics(path: Path) -> Calibration:
    document = read_object(path)
    matrix: Any = document.get("intrinsic_matrix")
    if not isinstance(matrix, list) or len(matrix) != 9:
        raise InputError(f"{path}: expected 'intrinsic_matrix' with 9 numbers, column by column")
    K = {"fx": matrix[0], "fy": matrix[4], "cx": matrix[6], "cy": matrix[7]}
    K |= {name: document.get(name) for name in ("width", "height")}
    for name, value in K.items():
        check_number(name, value, str(path))
    fx, fy, cx, cy, width, height = (float(value) for value in K.values())
    return Calibration(fx, fy, cx, cy, (int(width), int(height)), path.name)


def _read_log(path: Path) -> dict[int, LoggedPose]:
    """Read groups of one line with three numbers, the first being the frame's index, and a matrix in four lines."""
    lines, poses = list(data_lines(path)), {}
    for start in range(0, len(lines) - 4, 5):
        try:
            place = parse_numbers(lines[start][1], 3, "three numbers, the first the frame's")[0]
            rows = [parse_numbers(line, 4, "four numbers a row") for _, line in lines[start + 1 : start + 5]]
        except ValueError as error:
            raise InputError(f"{path} line {lines[start][0]}: {error}") from None
        poses[int(place)] = (lines[start][0], [value for row in rows for value in row])
    if not poses:
        raise InputError(f"{path} holds no pose; without the file the recording counts as one without poses")
    return poses


def _pose(poses: dict[int, LoggedPose], place: int, name: str) -> Float64Array:
    if place not in poses:
        raise FrameError(f"{name} has no pose of frame {place} ({len(poses)} poses)")
    line, values = poses[place]
    return pose_from_matrix([values[row : row + 4] for row in range(0, 16, 4)], f"{name} line {line}")


READERS.register("open3d")(
    Reader("color/ or image/, depth/, camera_intrinsic.json or trajectory.log", recognises, read)
)
