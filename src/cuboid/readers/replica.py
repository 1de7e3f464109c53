"""Replica as NICE-SLAM renders it, and what is laid out like it.

Expected tree::

    Replica/
      cam_params.json              {"camera": {"w":, "h":, "fx":, "fy":, "cx":, "cy":, "scale":}}, here or in office0
      office0/                     <- the recording
        results/frame000000.jpg    8-bit color
        results/depth000000.png    16-bit; scale units are a metre
        traj.txt                   a line a frame: 16 numbers, camera to world, row by row; may be absent
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

from cuboid.core.errors import FrameError, InputError
from cuboid.core.frame import Float64Array
from cuboid.formats.reading import names_in
from cuboid.formats.table_validation import data_lines
from cuboid.readers.depth_camera import check_number
from cuboid.readers.documents import read_object
from cuboid.readers.posetext import parse_numbers, pose_from_matrix
from cuboid.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader, has_file

RESULTS, TRAJECTORY, PARAMETERS = "results", "traj.txt", "cam_params.json"
FRAME_FILE = re.compile(r"(frame|depth)(\d+)\.(jpg|png)")
_FIELDS = ("fx", "fy", "cx", "cy", "w", "h", "scale")


def recognises(path: Path) -> bool:
    """Tell whether the folder holds results/ with files named frameNNNNNN or depthNNNNNN."""
    return (path / RESULTS).is_dir() and has_file(path / RESULTS, FRAME_FILE)


def read(path: Path) -> Listing:
    """List the frames; InputError where the parameters or the trajectory have another form."""
    files: dict[str, dict[str, Path]] = {}
    for name in sorted(names_in(path / RESULTS)):
        if match := FRAME_FILE.fullmatch(name):
            files.setdefault(match[2], {})[match[1]] = path / RESULTS / name
    poses = _poses(path / TRAJECTORY) if (path / TRAJECTORY).is_file() else None
    frames = [
        FrameEntry(
            color=files[number].get("frame"),
            depth=files[number].get("depth"),
            pose=None if poses is None else partial(_pose, poses, int(number)),
        )
        for number in sorted(files, key=int)
    ]
    calibration, units = _parameters(path)
    return Listing(frames, units, calibration, camera_folders=(path, path.parent))


def _parameters(path: Path) -> tuple[Calibration | None, float | None]:
    """Return the camera and the units of depth a metre; None where no file tells."""
    file = next((one / PARAMETERS for one in (path, path.parent) if (one / PARAMETERS).is_file()), None)
    if file is None:
        return None, None
    camera = read_object(file).get("camera")
    if not isinstance(camera, dict):
        raise InputError(f"{file}: expected 'camera' with {', '.join(_FIELDS)}")
    for name in _FIELDS:
        check_number(name, camera.get(name), str(file), "camera.")
    fx, fy, cx, cy, width, height, scale = (float(camera[name]) for name in _FIELDS)
    return Calibration(fx, fy, cx, cy, (int(width), int(height)), file.name), scale


def _poses(path: Path) -> list[tuple[int, list[float]]]:
    """Read the lines of a trajectory: number of the line, and its 16 numbers."""
    poses = []
    for number, line in data_lines(path):
        try:
            poses.append((number, parse_numbers(line, 16, "the 16 numbers of a 4x4 matrix")))
        except ValueError as error:
            raise InputError(f"{path} line {number}: {error}") from None
    return poses


def _pose(poses: list[tuple[int, list[float]]], number: int) -> Float64Array:
    if number >= len(poses):
        raise FrameError(f"{TRAJECTORY} has {len(poses)} lines, none for frame {number}")
    line, values = poses[number]
    return pose_from_matrix([values[row : row + 4] for row in range(0, 16, 4)], f"{TRAJECTORY} line {line}")


READERS.register("replica")(Reader("results/frameNNNNNN.jpg, results/depthNNNNNN.png", recognises, read))
