"""TUM RGB-D (Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012), and its format.

Expected tree::

    rgbd_dataset_freiburg1_xyz/    <- the recording
      rgb.txt                      lines "timestamp filename", # begins a comment
      depth.txt                    the same
      groundtruth.txt              lines "timestamp tx ty tz qx qy qz qw", camera to world; may be absent
      rgb/1305031102.175304.png    8-bit color (.jpg as well)
      depth/1305031102.160407.png  16-bit, 1/5000 m, 0 is no reading
      camera.json                  for cameras other than freiburg1, 2 and 3

Color, depth and poses have separate timestamps. Each color image takes the depth image nearest in time,
one to one; the frame's time, and its pose, are those of the depth image, since depth is what is measured.

Color and depth are aligned and have the same distortion: the depth images were registered to the distorted color
images. The distortion that the dataset's page gives for freiburg1 and 2 (the images of freiburg3 come without) is
removed from both. On fr1/xyz the error of poses estimated from the images is then 1.16 cm, and 1.70 cm without it. The
focal length with the best agreement of frames under the given poses is 522.9 +- 1.4 pixels, and 531.0 +- 1.5 without
it; the page gives 517.3. Undistorting only color would misalign it with depth: the mean distance from a depth edge to
the nearest color edge (at most 6 pixels), where the distortion is over 3 pixels, grows from 3.04 to 3.30 pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.inputs.readers.posetext import Trajectory, parse_time, parsed_lines
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader

TUM_UNITS_PER_METRE = 5000.0
# Color and depth of one frame are at most this far apart in time (seconds): more than half the 33 ms between
# two images, so that each finds a partner where none was dropped; the dataset's own tool has the same.
ASSOCIATE_WITHIN_S = 0.02
# Folders of the Bonn dataset, which has the same files, are named rgbd_bonn_balloon and the like.
BONN = "rgbd_bonn"
# Minimum ratio of the rates of color and depth (60 Hz and 30 Hz) at which color images without depth are ignored.
FASTER_STREAM = 1.5

# Color camera and the distortion of its lens (k1, k2, p1, p2, k3), by the dataset's page; the folder's name tells which
# camera it was.
PUBLISHED = {
    "freiburg1": ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    "freiburg2": ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    "freiburg3": ((535.4, 539.2, 320.1, 247.6), ()),
}


def recognises(path: Path) -> bool:
    """Tell whether the folder holds rgb.txt and depth.txt, and is none of the Bonn dataset."""
    return has_lists(path) and not path.name.lower().startswith(BONN)


def has_lists(path: Path) -> bool:
    """Tell whether the folder holds rgb.txt and depth.txt."""
    return (path / "rgb.txt").is_file() and (path / "depth.txt").is_file()


def read(path: Path) -> Listing:
    """List the frames; InputError where a list or the trajectory has a line of another form."""
    frames = list_frames(path, lambda trajectory, time_s: trajectory.at(time_s))
    return Listing(frames, TUM_UNITS_PER_METRE, _published(path), camera_folders=(path,))


def list_frames(path: Path, pose_at: Callable[[Trajectory, float], Float64Array]) -> list[FrameEntry]:
    """List the frames of the two lists, with poses as `pose_at` makes them of the trajectory; raises as `read` does."""
    colors, depths = _image_list(path / "rgb.txt"), _image_list(path / "depth.txt")
    trajectory = Trajectory(path / "groundtruth.txt") if (path / "groundtruth.txt").is_file() else None
    pose = None if trajectory is None else partial(pose_at, trajectory)
    pairs = associate([t for t, _ in colors], [t for t, _ in depths], ASSOCIATE_WITHIN_S)
    all_are_frames = len(colors) <= FASTER_STREAM * len(depths)
    frames = [
        _entry(path, color, depths[pairs[k]] if k in pairs else None, pose)
        for k, color in enumerate(colors)
        if all_are_frames or k in pairs
    ]
    if not frames:
        raise InputError(
            f"{path}: no color image of rgb.txt ({len(colors)}) has a depth image of depth.txt "
            f"({len(depths)}) within {1000 * ASSOCIATE_WITHIN_S:g} ms"
        )
    return frames


def associate(times_a_s: list[float], times_b_s: list[float], within_s: float) -> dict[int, int]:
    """Pair two sets of times one to one, the nearest pairs first.

    Parameters
    ----------
    times_a_s, times_b_s : list of float
        Seconds, in any order.
    within_s : float
        Largest difference in a pair.

    Returns
    -------
    dict of int to int
        Positions in a with their positions in b; positions without a partner are absent.
    """
    order = np.argsort(np.asarray(times_b_s, np.float64), kind="stable")
    sorted_b = np.asarray(times_b_s, np.float64)[order]
    candidates = []
    for a, time_s in enumerate(times_a_s):
        first = np.searchsorted(sorted_b, time_s - within_s, side="left")
        end = np.searchsorted(sorted_b, time_s + within_s, side="right")
        candidates += [(abs(times_b_s[b] - time_s), a, int(b)) for b in order[first:end]]
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for _, a, b in sorted(candidates):
        if a not in pairs and b not in taken:
            pairs[a] = b
            taken.add(b)
    return pairs


def _entry(
    folder: Path,
    color: tuple[float, str],
    depth: tuple[float, str] | None,
    pose: Callable[[float], Float64Array] | None,
) -> FrameEntry:
    time_s, color_name = color
    fault = None
    if depth is None:
        fault = f"color without depth: none within {1000 * ASSOCIATE_WITHIN_S:g} ms of {color_name}"
    else:
        time_s = depth[0]
    return FrameEntry(
        color=folder / color_name,
        depth=folder / depth[1] if depth else None,
        timestamp_s=time_s,
        pose=None if pose is None else partial(pose, time_s),
        fault=fault,
        pose_after=None if pose is None else partial(pose_later, pose, time_s),
    )


def pose_later(pose: Callable[[float], Float64Array], time_s: float, after_s: float) -> Float64Array:
    """Return the pose of a later time."""
    return pose(time_s + after_s)


def _image_list(path: Path) -> list[tuple[float, str]]:
    """Read lines "timestamp filename", sorted by time."""
    return sorted(image for _, image in parsed_lines(path, _image))


def _image(line: str) -> tuple[float, str]:
    word, _, name = line.replace("\t", " ").partition(" ")
    try:
        time_s = parse_time(word)
    except ValueError as error:
        raise ValueError(f"{error} and a file's name") from None
    if not name.strip():
        raise ValueError(f"expected 'timestamp filename', got {shown(line)}")
    return time_s, name.strip()


def _published(path: Path) -> Calibration | None:
    for name, (intrinsics, distortion) in PUBLISHED.items():
        if name in path.name.lower():
            return Calibration(*intrinsics, (640, 480), f"published for {name}", distortion)
    return None


READERS.register("tum")(Reader("rgb.txt, depth.txt", recognises, read))
