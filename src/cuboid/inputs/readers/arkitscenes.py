"""ARKitScenes (Baruch et al., NeurIPS Datasets and Benchmarks 2021): videos of iPads, with poses of its laser scans.

Expected tree, of the raw dataset or of 3dod::

    41048190/
      41048190_frames/                                   <- the recording; in the raw dataset the folder above
        lowres_wide/41048190_3393.132.png                8-bit color, 256x192; or vga_wide/, or wide/
        lowres_wide_intrinsics/41048190_3393.132.pincam  width height fx fy cx cy
        lowres_depth/41048190_3393.132.png               16-bit, 256x192, millimetres
        confidence/41048190_3393.132.png                 0, 1 or 2: depth of 0 is no reading; may be absent
        lowres_wide.traj                                 lines "timestamp rx ry rz tx ty tz": world to camera, the
                                                         rotation as axis times angle; may be absent

The number in a name is its time in seconds. Poses come at 10 Hz, and are interpolated. The world's z points up. The
focal length changes slightly with the focus; the median is used, and frames far from it are skipped.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.geometry import se3
from cuboid.inputs.readers.image_folder import images_in
from cuboid.inputs.readers.images import decode_color
from cuboid.inputs.readers.phone import SAME_FOCAL, confident_depth, depth_size_of, phone_cameras, shrink_factor, shrunk
from cuboid.inputs.readers.posetext import TimedPose, Trajectory, parse_numbers, parsed_lines
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader, has_file
from cuboid.inputs.readers.tum import associate, pose_later

DEPTH_UNITS_PER_METRE = 1000.0
# Folders of color, the first existing one is used: resolution similar to other phones' videos; as depth; much higher.
COLOR_FOLDERS = ("vga_wide", "lowres_wide", "wide")
DEPTH, CONFIDENCE, TRAJECTORY = "lowres_depth", "confidence", "lowres_wide.traj"
NAME = re.compile(r"\d+_(\d+\.\d+)")
DEPTH_FILE = re.compile(rf"{NAME.pattern}\.png")
MIN_CONFIDENCE = 1
# Color and depth are taken at the same time; their timestamps may differ in the last digit.
SAME_TIME_S = 0.005
# Number of camera files that are read to find the median camera.
CAMERAS_READ = 25
# Poses come 0.1 s apart.
LARGEST_GAP_S = 0.25
# The line of a file with the camera of a frame.
PINCAM = "width height fx fy cx cy"


def recognises(path: Path) -> bool:
    """Tell whether the folder contains lowres_depth and a color folder, with names of an id and a time."""
    return _color_folder(path) is not None and has_file(path / DEPTH, DEPTH_FILE)


def _color_folder(path: Path) -> str | None:
    return next((name for name in COLOR_FOLDERS if (path / name).is_dir()), None)


def read(path: Path) -> Listing:
    """List the frames; raise InputError if the trajectory has another format, or no camera can be read."""
    folder = _color_folder(path)
    assert folder is not None, "recognises"
    colors, depths = _by_time(path / folder), _by_time(path / DEPTH)
    pairs = associate([time_s for time_s, _ in colors], [time_s for time_s, _ in depths], SAME_TIME_S)
    cameras = path / f"{folder}_intrinsics"
    K, size = _usual_camera(cameras, [file for _, file in colors])
    depth_size = depth_size_of((file for _, file in depths), path, DEPTH)
    trajectory = None
    if (path / TRAJECTORY).is_file():
        trajectory = Trajectory(path / TRAJECTORY, _line, LARGEST_GAP_S)
    frames = []
    for k, (time_s, color) in enumerate(colors):
        depth = depths[pairs[k]][1] if k in pairs else None
        frames.append(
            FrameEntry(
                color=partial(_color, color, cameras, K[0], shrink_factor(size)),
                depth=None
                if depth is None
                else partial(confident_depth, depth, path / CONFIDENCE / depth.name, MIN_CONFIDENCE),
                timestamp_s=time_s,
                pose=None if trajectory is None else partial(trajectory.at, time_s),
                pose_after=None if trajectory is None else partial(pose_later, trajectory.at, time_s),
                fault=None if k in pairs else f"color without depth: none of the time of {folder}/{color.name}",
            )
        )
    calibration = phone_cameras(K, size, depth_size, cameras.name)
    if size == depth_size:
        calibration = Calibration(*K, size, cameras.name)
    return Listing(frames, DEPTH_UNITS_PER_METRE, calibration, camera_folders=(path,), up_world=(0.0, 0.0, 1.0))


def _by_time(folder: Path) -> list[tuple[float, Path]]:
    return sorted((float(match[1]), file) for file in images_in(folder) if (match := NAME.fullmatch(file.stem)))


def _line(line: str) -> TimedPose:
    """Read a line of the trajectory, world to camera."""
    time_s, rx, ry, rz, *translation = parse_numbers(line, 7, "timestamp rx ry rz tx ty tz")
    T = se3.inverse(se3.assembled(cv2.Rodrigues(np.array((rx, ry, rz)))[0], translation))
    return time_s, (*se3.quat_wxyz_from_rotation(T[:3, :3]).tolist(), *T[:3, 3].tolist())


def _usual_camera(folder: Path, colors: list[Path]) -> tuple[tuple[float, float, float, float], tuple[int, int]]:
    """Return the median fx, fy, cx, cy of some frames, and the size; raise InputError if none can be read."""
    step, found, fault = max(1, len(colors) // CAMERAS_READ), [], "there are no images"
    for file in colors[::step]:
        try:
            found.append(_camera(folder / f"{file.stem}.pincam"))
        except InputError as error:
            fault = str(error)
    if not found:
        raise InputError(f"{folder}: no camera of a frame can be read; {fault}")
    width, height, fx, fy, cx, cy = np.median(found, axis=0).tolist()
    return (fx, fy, cx, cy), (int(width), int(height))


def _camera(path: Path) -> list[float]:
    for number, camera in parsed_lines(path, lambda line: parse_numbers(line, 6, PINCAM)):
        if not np.isfinite(camera).all() or min(camera[:4]) <= 0 or max(camera) > 1e6:
            raise InputError(f"{path} line {number}: expected {PINCAM}, above 0")
        return camera
    raise InputError(f"{path}: is empty, expected {PINCAM}")


def _color(file: Path, cameras: Path, fx: float, factor: int) -> UInt8Array:
    camera = cameras / f"{file.stem}.pincam"
    if camera.is_file():
        try:
            color_fx = _camera(camera)[2]
        except InputError as error:
            raise FrameError(str(error)) from None
        if abs(color_fx / fx - 1) > SAME_FOCAL:
            raise FrameError(f"the camera of {file.name} differs from the others: fx {color_fx:.1f}, median {fx:.1f}")
    return shrunk(decode_color(file, f"{file.parent.name}/{file.name}"), factor)


READERS.register("arkitscenes")(
    Reader("lowres_wide/, lowres_depth/, lowres_wide_intrinsics/, lowres_wide.traj", recognises, read)
)
