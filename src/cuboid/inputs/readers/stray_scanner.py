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

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.table_validation import data_lines
from cuboid.inputs.readers.image_folder import images_by_number
from cuboid.inputs.readers.phone import UP_WORLD, confident_depth, depth_size_of, phone_cameras, shrink_factor, shrunk
from cuboid.inputs.readers.posetext import PoseLine, parse_numbers, parsed_lines, pinhole_of, pose_of_frame
from cuboid.inputs.readers.reader import READERS, FrameEntry, Listing, Reader
from cuboid.inputs.readers.video_file import VideoFile

DEPTH_UNITS_PER_METRE = 1000.0
VIDEO, ODOMETRY, MATRIX = "rgb.mp4", "odometry.csv", "camera_matrix.csv"
FIELDS = "timestamp, frame, x, y, z, qx, qy, qz, qw"
# Confidence below which a depth is no reading: ARKit's "low" is mostly the edge of something else.
MIN_CONFIDENCE = 1


def recognises(path: Path) -> bool:
    """Tell whether the folder holds depth, odometry.csv and camera_matrix.csv."""
    return (path / "depth").is_dir() and (path / ODOMETRY).is_file() and (path / MATRIX).is_file()


def read(path: Path) -> Listing:
    """List the frames; InputError where the video is missing or a file has another form."""
    if not (path / VIDEO).is_file():
        raise InputError(f"{path}: {VIDEO} is missing: without it a recording of Stray Scanner has no color")
    video = VideoFile(path / VIDEO)
    depths = images_by_number(path / "depth")
    depth_size = depth_size_of((depths[number] for number in sorted(depths)), path)
    (poses, times_s), factor = _odometry(path / ODOMETRY), shrink_factor(video.size)
    frames = [
        FrameEntry(
            color=partial(_color, video, number, factor),
            depth=partial(confident_depth, depths[number], path / "confidence" / depths[number].name, MIN_CONFIDENCE),
            timestamp_s=times_s.get(number),
            pose=partial(pose_of_frame, poses, number, ODOMETRY),
        )
        for number in sorted(depths)
    ]
    matrix = [row for _, row in parsed_lines(path / MATRIX, lambda line: _numbers(line, 3, "three numbers a row"))]
    calibration = phone_cameras(pinhole_of(matrix, path / MATRIX), video.size, depth_size, MATRIX)
    return Listing(frames, DEPTH_UNITS_PER_METRE, calibration, camera_folders=(path,), up_world=UP_WORLD)


def _color(video: VideoFile, number: int, factor: int) -> UInt8Array:
    return shrunk(video.read(number), factor)


def _odometry(path: Path) -> tuple[dict[int, PoseLine], dict[int, float]]:
    """Return the poses and the times of the frames."""
    lines = (one for one in data_lines(path) if not one[1].startswith("timestamp"))
    poses, times_s = {}, {}
    for number, (time_s, frame, *pose) in parsed_lines(path, lambda line: _numbers(line, 9, FIELDS), lines):
        poses[int(frame)], times_s[int(frame)] = (number, pose), time_s
    return poses, times_s


def _numbers(line: str, count: int, expected: str) -> list[float]:
    return parse_numbers(line.replace(",", " "), count, expected)


READERS.register("stray-scanner")(Reader("rgb.mp4, depth/, odometry.csv, camera_matrix.csv", recognises, read))
