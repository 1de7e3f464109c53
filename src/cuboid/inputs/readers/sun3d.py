"""SUN3D (Xiao et al., "SUN3D: a database of big spaces reconstructed using SfM and object labels", ICCV 2013).

Expected tree::

    hotel_umd/maryland_hotel3/                 <- the recording
      image/0000001-000000000000.jpg           8-bit color; the name is its number and its time in microseconds
      depth/0000001-000000020000.png           16-bit, millimetres, the lowest three bits moved to the top
      intrinsics.txt                           3x3 matrix
      extrinsics/20140909153047.txt            three rows of a 3x4 matrix for each image, camera to world; the last by
                                               name counts; may be absent

Each color image takes the depth image nearest in time, one to one.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.formats.reading import names_in
from cuboid.inputs.readers.image_folder import images_in
from cuboid.inputs.readers.images import decode_depth
from cuboid.inputs.readers.posetext import numbered_rows, pinhole_of, pose_from_matrix
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader, has_file
from cuboid.inputs.readers.tum import associate

DEPTH_UNITS_PER_METRE = 1000.0
INTRINSICS, EXTRINSICS = "intrinsics.txt", "extrinsics"
NAME = re.compile(r"(\d+)-(\d+)")
DEPTH_FILE = re.compile(rf"{NAME.pattern}\.png")
# Half the time between two images of a Kinect, and some.
WITHIN_S = 0.02


def recognises(path: Path) -> bool:
    """Tell whether the folder holds image, intrinsics.txt and depth with names of a number and a time."""
    return (path / INTRINSICS).is_file() and (path / "image").is_dir() and has_file(path / "depth", DEPTH_FILE)


def read(path: Path) -> Listing:
    """List the frames; InputError where the intrinsics or the extrinsics have another form."""
    colors, depths = _by_time(path / "image"), _by_time(path / "depth")
    pairs = associate([time_s for time_s, _ in colors], [time_s for time_s, _ in depths], WITHIN_S)
    file = _extrinsics(path)
    rows = None if file is None else numbered_rows(file, 4, "4 numbers a row")
    frames = []
    for k, (time_s, color) in enumerate(colors):
        fault = None if k in pairs else f"color without depth: none within {1000 * WITHIN_S:g} ms of image/{color.name}"
        frames.append(
            FrameEntry(
                color=color,
                depth=partial(_depth, depths[pairs[k]][1]) if k in pairs else None,
                timestamp_s=time_s,
                pose=None if rows is None or file is None else partial(_pose, rows, k, f"{EXTRINSICS}/{file.name}"),
                fault=fault,
            )
        )
    if not frames:
        raise InputError(f"{path}: image/ holds no images")
    matrix = [row for _, row in numbered_rows(path / INTRINSICS, 3, "3 numbers a row")]
    calibration = Calibration(*pinhole_of(matrix, path / INTRINSICS), None, INTRINSICS)
    return Listing(frames, DEPTH_UNITS_PER_METRE, calibration, camera_folders=(path,))


def _by_time(folder: Path) -> list[tuple[float, Path]]:
    """Return the images of a folder in the order of their numbers, with their times in seconds."""
    named = [(match, file) for file in images_in(folder) if (match := NAME.fullmatch(file.stem))]
    return [(1e-6 * int(match[2]), file) for match, file in sorted(named, key=lambda one: int(one[0][1]))]


def _depth(file: Path) -> npt.NDArray[np.uint16]:
    raw = decode_depth(file, f"depth/{file.name}").astype(np.uint16, copy=False)
    return np.asarray((raw >> 3) | (raw << 13), np.uint16)


def _extrinsics(path: Path) -> Path | None:
    folder = path / EXTRINSICS
    names = sorted(name for name in names_in(folder) if name.endswith(".txt")) if folder.is_dir() else []
    return folder / names[-1] if names else None


def _pose(rows: list[tuple[int, list[float]]], k: int, name: str) -> Float64Array:
    pose_rows = rows[3 * k : 3 * k + 3]
    if len(pose_rows) < 3:
        raise FrameError(f"{name} has {len(rows)} rows, none for image {k + 1}")
    return pose_from_matrix([*(row for _, row in pose_rows), [0.0, 0.0, 0.0, 1.0]], f"{name} line {pose_rows[0][0]}")


READERS.register("sun3d")(Reader("image/, depth/NNNNNNN-TIME.png, intrinsics.txt", recognises, read))
