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

As published, depth and poses are the depth camera's: depth is registered to the color image, and the poses become those
of the color camera. Where the folder or the user names another camera, images count as registered unless a depth camera
is named with it.
"""

from __future__ import annotations

import re
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from cuboid.core.errors import FrameError
from cuboid.core.frame import Float64Array
from cuboid.formats.reading import UnreadableError, names_in, text_lines
from cuboid.geometry.se3 import rigid
from cuboid.readers.depth_camera import DepthCamera
from cuboid.readers.posetext import parse_numbers
from cuboid.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader, has_file

FRAME_FILE = re.compile(r"frame-(\d+)\.(color|depth|pose)\.(png|jpg|jpeg|txt)")
DEPTH_UNITS_PER_METRE = 1000.0
# 3RScan has frames of such names too, and this file beside them.
INFO_3RSCAN = "_info.txt"
# A matrix has four lines; more of a file than this is not looked at.
MAX_LINES = 20
# Color and depth of the dataset are not registered. Its page gives the depth camera (585, 585, 320, 240) and nothing of
# the color camera; that is a Kinect's: 525 (OpenNI's), 2.5 cm beside the other. Where color images show the
# edges of depth (u_depth = 1.11 u_color - 29, v_depth = 1.11 v_color - 24) both numbers hold for things 2 m away, and
# the color camera looks 2.2 pixels lower: a tilt of 0.0042.
_TILT = 0.0042
T_COLOR_DEPTH = np.array(
    [
        [1.0, 0.0, 0.0, -0.025],
        [0.0, np.cos(_TILT), -np.sin(_TILT), 0.0],
        [0.0, np.sin(_TILT), np.cos(_TILT), 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
CALIBRATION = Calibration(
    525.0,
    525.0,
    320.0,
    240.0,
    (640, 480),
    "published for 7-Scenes",
    depth_camera=DepthCamera(585.0, 585.0, 320.0, 240.0, (640, 480), T_COLOR_DEPTH),
)


def recognises(path: Path) -> bool:
    """Tell whether the folder holds files named frame-NNNNNN.color, .depth or .pose."""
    return has_file(path, FRAME_FILE) and not (path / INFO_3RSCAN).is_file()


def read(path: Path) -> Listing:
    """List the frames of a sequence; poses are read with their frames."""
    files: dict[str, dict[str, Path]] = {}
    for name in sorted(names_in(path)):  # of two forms of an image .png, the original, comes last and stays
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
    # KinectFusion made the poses from depth alone: they are the depth camera's.
    return Listing(frames, DEPTH_UNITS_PER_METRE, CALIBRATION, (path, path.parent), poses_of_depth=True)


def _pose(path: Path) -> Float64Array:
    """Read T_world_camera from the file of one frame."""
    try:
        values = parse_numbers(" ".join(islice(text_lines(path), MAX_LINES)), 16, "the 16 numbers of a 4x4 matrix")
        return rigid(np.reshape(values, (4, 4)))
    except UnreadableError as error:
        what = f"the camera pose is missing: {path.name}" if error.missing else f"{path.name} {error.reason}"
        raise FrameError(what) from None
    except ValueError as error:
        raise FrameError(f"{path.name}: {error}") from None


READERS.register("7-scenes")(
    Reader("frame-NNNNNN.color.png|jpg, frame-NNNNNN.depth.png", recognises, read),
)
