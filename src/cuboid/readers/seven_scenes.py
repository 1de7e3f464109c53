"""7-Scenes (Shotton et al., "Scene coordinate regression forests", CVPR 2013), and its form.

Expected tree::

    chess/
      seq-01/                        <- the recording
        frame-000000.color.png       8-bit color (.jpg as well)
        frame-000000.depth.png       16-bit, millimetres; 0 and 65535 are no reading
        frame-000000.pose.txt        4x4 matrix, camera to world; inf or nan: the frame is lost; may be absent
        ...
      camera-intrinsics.txt          3x3 matrix, here or in seq-01; may be absent

The frames may also lie in the upper folder itself.
"""

from __future__ import annotations

import os
import re
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from cuboid.errors import FrameError
from cuboid.formats.reading import UnreadableError, text_lines
from cuboid.frame import Float64Array
from cuboid.geometry.se3 import rigid
from cuboid.readers.posetext import parse_numbers
from cuboid.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader, holds

FRAME_FILE = re.compile(r"frame-(\d+)\.(color|depth|pose)\.(png|jpg|jpeg|txt)")
DEPTH_UNITS_PER_METRE = 1000.0
# A matrix has four lines; more of a file than this is not looked at.
MOST_LINES = 20
# The dataset's page gives these for all its scenes.
CALIBRATION = Calibration(585.0, 585.0, 320.0, 240.0, (640, 480), "published for 7-Scenes")


def recognises(path: Path) -> bool:
    """Tell whether the folder holds files named frame-NNNNNN.color, .depth or .pose."""
    return holds(path, FRAME_FILE)


def read(path: Path) -> Listing:
    """List the frames of a sequence; poses are read with their frames."""
    files: dict[str, dict[str, Path]] = {}
    for name in sorted(os.listdir(path)):  # of two forms of an image .png, the original, comes last and stays
        if match := FRAME_FILE.fullmatch(name):
            files.setdefault(match[1], {})[match[2]] = path / name
    has_poses = any("pose" in of_frame for of_frame in files.values())
    frames = [
        FrameEntry(
            color=files[number].get("color"),
            depth=files[number].get("depth"),
            pose=partial(_pose, path / f"frame-{number}.pose.txt") if has_poses else None,
        )
        for number in sorted(files, key=int)
    ]
    return Listing(frames, DEPTH_UNITS_PER_METRE, CALIBRATION, camera_folders=(path, path.parent))


def _pose(path: Path) -> Float64Array:
    """Read T_world_camera from the file of one frame."""
    try:
        values = parse_numbers(" ".join(islice(text_lines(path), MOST_LINES)), 16, "the 16 numbers of a 4x4 matrix")
        return rigid(np.reshape(values, (4, 4)))
    except UnreadableError as error:
        what = f"the camera pose is missing: {path.name}" if error.missing else f"{path.name} {error.reason}"
        raise FrameError(what) from None
    except ValueError as error:
        raise FrameError(f"{path.name}: {error}") from None


READERS.register("7-scenes")(
    Reader("frame-NNNNNN.color.png|jpg, frame-NNNNNN.depth.png", recognises, read),
)
