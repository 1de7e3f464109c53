"""ICL-NUIM (Handa et al., "A benchmark for RGB-D visual odometry, 3D reconstruction and SLAM", ICRA 2014).

Expected tree, that of the "TUM RGB-D compatible PNGs"::

    living_room_traj2_frei_png/       <- the recording
      rgb/0.png                       8-bit color
      depth/0.png                     16-bit, 1/5000 m
      associations.txt                lines "0 depth/0.png 0 rgb/0.png"
      livingRoom2.gt.freiburg         lines "number tx ty tz qx qy qz qw"; downloaded apart; may be absent

The dataset is rendered with a left-handed camera (x right, y up, z forward), so its page gives a negative fy. The
reader flips y in camera and world: fy is positive, and poses are those of a right-handed camera with y down, in a world
with y down.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.formats.reading import names_in
from cuboid.ground.formats.table_validation import data_lines
from cuboid.inputs.readers.posetext import PoseLine, numbered_rows, pose_of_frame
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader

TUM_UNITS_PER_METRE = 5000.0
ASSOCIATIONS, TRAJECTORY_ENDING = "associations.txt", ".gt.freiburg"
LINE = re.compile(r"(\d+)\s+(depth/\S+)\s+\d+\s+(rgb/\S+)")
CALIBRATION = Calibration(481.20, 480.00, 319.50, 239.50, (640, 480), "published for ICL-NUIM")
# Flips y of a left-handed coordinate frame.
TURN = np.diag([1.0, -1.0, 1.0, 1.0])


def recognises(path: Path) -> bool:
    """Tell whether the folder contains rgb, depth and associations.txt with lines of this format."""
    if not all((path / name).is_dir() for name in ("rgb", "depth")) or not (path / ASSOCIATIONS).is_file():
        return False
    try:
        return any(LINE.fullmatch(line) for _, line in list(data_lines(path / ASSOCIATIONS))[:3])
    except InputError:
        return False


def read(path: Path) -> Listing:
    """List the frames; raise InputError if a line has another format."""
    file = next((path / name for name in sorted(names_in(path)) if name.endswith(TRAJECTORY_ENDING)), None)
    poses = None if file is None else _poses(file)
    frames = []
    for number, line in data_lines(path / ASSOCIATIONS):
        match = LINE.fullmatch(line)
        if match is None:
            where = f"{path / ASSOCIATIONS} line {number}"
            raise InputError(f"{where}: expected '0 depth/0.png 0 rgb/0.png', got {shown(line)}")
        pose = None if poses is None or file is None else partial(_pose, poses, int(match[1]), file.name)
        frames.append(FrameEntry(path / match[3], path / match[2], pose=pose))
    return Listing(frames, TUM_UNITS_PER_METRE, CALIBRATION, camera_folders=(path,))


def _poses(path: Path) -> dict[int, PoseLine]:
    poses: dict[int, PoseLine] = {}
    for number, (frame, *pose) in numbered_rows(path, 8, "number tx ty tz qx qy qz qw"):
        if not frame.is_integer():
            raise InputError(f"{path} line {number}: expected the number of a frame, got {frame:g}")
        poses[int(frame)] = (number, pose)
    return poses


def _pose(poses: dict[int, PoseLine], frame: int, name: str) -> Float64Array:
    return TURN @ pose_of_frame(poses, frame, name) @ TURN


READERS.register("icl-nuim")(Reader("rgb/, depth/, associations.txt", recognises, read))
