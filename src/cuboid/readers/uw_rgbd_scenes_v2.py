"""UW RGB-D Scenes v2 (Lai, Bo, Fox, "Unsupervised feature learning for 3D scene labeling", ICRA 2014).

Expected tree::

    rgbd-scenes-v2/
      imgs/scene_01/           <- the recording
        00000-color.png        8-bit color (.jpg as well)
        00000-depth.png        16-bit, 1/10000 m, 0 is no reading, aligned to color
        ...
      pc/01.pose               a line a frame: qw qx qy qz tx ty tz, camera to world; may be absent

The line of a frame is the one of its number, so a part of a scene keeps its poses.
The pose file is also found inside the scene's folder.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

from cuboid.core.errors import FrameError, InputError
from cuboid.core.frame import Float64Array
from cuboid.formats.reading import names_in, text_lines
from cuboid.readers.posetext import parse_numbers, pose_from_quaternion
from cuboid.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader, has_file

IMAGE = re.compile(r"(\d+)-(color|depth)\.(png|jpg|jpeg)")
POSE_FIELDS = "qw qx qy qz tx ty tz"
DEPTH_UNITS_PER_METRE = 10000.0

# Not the 570.3, (320, 240) of the dataset's page: with those the given poses do not fit together, and every
# object comes out as two or three ghosts 2-3 cm apart. Scene 01, fused with its poses, is sharpest here.
CALIBRATION = Calibration(534.8, 534.8, 320.9, 246.9, (640, 480), "fitted to the poses of UW RGB-D Scenes v2")


def recognises(path: Path) -> bool:
    """Tell whether the folder holds images named NNNNN-color and NNNNN-depth."""
    return has_file(path, IMAGE)


def read(path: Path) -> Listing:
    """List the frames of a scene; InputError if the pose file is empty."""
    images: dict[int, dict[str, Path]] = {}
    for name in sorted(names_in(path)):  # of two forms of an image .png, the original, comes last and stays
        if match := IMAGE.fullmatch(name):
            images.setdefault(int(match[1]), {})[match[2]] = path / name
    dataset = path.parent.parent if path.parent.name == "imgs" else path
    pose_lines = _pose_lines(dataset, path)
    frames = [
        FrameEntry(
            color=images[number].get("color"),
            depth=images[number].get("depth"),
            pose=partial(_pose, *pose_lines, number) if pose_lines else None,
        )
        for number in sorted(images)
    ]
    return Listing(frames, DEPTH_UNITS_PER_METRE, CALIBRATION, camera_folders=(path, dataset))


def _pose_lines(dataset: Path, scene: Path) -> tuple[str, list[str]] | None:
    """Return the pose file's name and lines, or None where there is no such file."""
    number = scene.name.removeprefix("scene_")
    for file in (dataset / "pc" / f"{number}.pose", scene / f"{number}.pose"):
        if file.is_file():
            lines = list(text_lines(file))
            while lines and not lines[-1].strip():
                lines.pop()
            if not lines:
                raise InputError(f"{file} is empty; without the file the recording counts as one without poses")
            return file.name, lines
    return None


def _pose(name: str, lines: list[str], number: int) -> Float64Array:
    """Return T_world_camera of the frame of this number."""
    if number >= len(lines):
        raise FrameError(f"{name} has {len(lines)} lines, none for frame number {number}")
    where = f"{name} line {number + 1}"
    try:
        values = parse_numbers(lines[number], 7, POSE_FIELDS)
    except ValueError as error:
        raise FrameError(f"{where}: {error}") from None
    return pose_from_quaternion(values[:4], values[4:], where)


READERS.register("uw-rgbd-scenes-v2")(Reader("NNNNN-color.png|jpg, NNNNN-depth.png", recognises, read))
