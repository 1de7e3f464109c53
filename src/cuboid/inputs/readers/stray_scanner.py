"""Recordings of the app Stray Scanner for the iPhone.

Expected tree::

    8653a2142b/                 <- the recording
      rgb.mp4                   color, a picture a frame
      depth/000000.png          16-bit, 256x192, millimetres
      confidence/000000.png     0, 1 or 2: depth of 0 is no reading; may be absent
      odometry.csv              timestamp, frame, x, y, z, qx, qy, qz, qw: camera (y down, z forward) to world
      camera_matrix.csv         3x3 matrix for the pictures of rgb.mp4

Color is shrunk by a whole number, to a third of 1920x1440.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.formats.table_validation import data_lines
from cuboid.inputs.readers.image_folder import images_in
from cuboid.inputs.readers.images import image_dimensions
from cuboid.inputs.readers.phone import UP_WORLD, confident_depth, phone_cameras, shrink_factor, shrunk
from cuboid.inputs.readers.posetext import parse_numbers, pose_from_quaternion
from cuboid.inputs.readers.reader import READERS, FrameEntry, Listing, Reader
from cuboid.inputs.readers.video_file import VideoFile

DEPTH_UNITS_PER_METRE = 1000.0
VIDEO, ODOMETRY, MATRIX = "rgb.mp4", "odometry.csv", "camera_matrix.csv"
FIELDS = "timestamp, frame, x, y, z, qx, qy, qz, qw"
# Confidence below which a depth is no reading: ARKit's "low" is mostly the edge of something else.
MIN_CONFIDENCE = 1

# Timestamp and the seven numbers of a pose, and the line they stand in.
OdometryRow = tuple[int, list[float]]


def recognises(path: Path) -> bool:
    """Tell whether the folder holds depth, odometry.csv and camera_matrix.csv."""
    return (path / "depth").is_dir() and (path / ODOMETRY).is_file() and (path / MATRIX).is_file()


def read(path: Path) -> Listing:
    """List the frames; InputError where the video is missing or a file has another form."""
    if not (path / VIDEO).is_file():
        raise InputError(f"{path}: {VIDEO} is missing: without it a recording of Stray Scanner has no color")
    video = VideoFile(path / VIDEO)
    depths = {int(file.stem): file for file in images_in(path / "depth") if file.stem.isdigit()}
    depth_size = next((found for number in sorted(depths) if (found := image_dimensions(depths[number]))), None)
    if depth_size is None:
        raise InputError(f"{path}: no image of depth/ can be read")
    rows, factor = _odometry(path / ODOMETRY), shrink_factor(video.size)
    frames = [
        FrameEntry(
            color=partial(_color, video, number, factor),
            depth=partial(confident_depth, depths[number], path / "confidence" / depths[number].name, MIN_CONFIDENCE),
            timestamp_s=rows[number][1][0] if number in rows else None,
            pose=partial(_pose, rows, number),
        )
        for number in sorted(depths)
    ]
    calibration = phone_cameras(_matrix(path / MATRIX), video.size, depth_size, MATRIX)
    return Listing(frames, DEPTH_UNITS_PER_METRE, calibration, camera_folders=(path,), up_world=UP_WORLD)


def _color(video: VideoFile, number: int, factor: int) -> UInt8Array:
    return shrunk(video.read(number), factor)


def _odometry(path: Path) -> dict[int, OdometryRow]:
    rows: dict[int, OdometryRow] = {}
    for number, line in data_lines(path):
        if line.startswith("timestamp"):
            continue
        try:
            time_s, frame, *pose = parse_numbers(line.replace(",", " "), 9, FIELDS)
        except ValueError as error:
            raise InputError(f"{path} line {number}: {error}") from None
        rows[int(frame)] = (number, [time_s, *pose])
    return rows


def _pose(rows: dict[int, OdometryRow], frame: int) -> Float64Array:
    if frame not in rows:
        raise FrameError(f"{ODOMETRY} has no line for frame {frame} ({len(rows)} lines)")
    line, (_, x, y, z, qx, qy, qz, qw) = rows[frame]
    return pose_from_quaternion((qw, qx, qy, qz), (x, y, z), f"{ODOMETRY} line {line}")


def _matrix(path: Path) -> tuple[float, float, float, float]:
    rows = []
    for number, line in data_lines(path):
        try:
            rows.append(parse_numbers(line.replace(",", " "), 3, "three numbers a row"))
        except ValueError as error:
            raise InputError(f"{path} line {number}: {error}") from None
    if len(rows) != 3 or not np.isfinite(rows).all() or min(rows[0][0], rows[1][1]) <= 0:
        raise InputError(f"{path}: expected the matrix fx 0 cx, 0 fy cy, 0 0 1 with fx, fy > 0")
    return rows[0][0], rows[1][1], rows[0][2], rows[1][2]


READERS.register("stray-scanner")(Reader("rgb.mp4, depth/, odometry.csv, camera_matrix.csv", recognises, read))
