"""Scenes of the BOP benchmark (https://bop.felk.cvut.cz).

Expected tree::

    000001/                   <- the recording
      scene_camera.json       for each image number: cam_K (9 numbers, row by row), depth_scale (mm a unit) and,
                              where known, cam_R_w2c (9 numbers) and cam_t_w2c (mm)
      rgb/000000.png          8-bit color (.jpg as well); or gray/
      depth/000000.png        16-bit, aligned to color

A recording has one camera and one scale: images with another than the first are skipped.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.geometry import se3
from cuboid.inputs.readers.documents import read_object
from cuboid.inputs.readers.image_folder import images_by_number
from cuboid.inputs.readers.posetext import pose_from_matrix
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader

CAMERAS = "scene_camera.json"
COLOR_FOLDERS = ("rgb", "gray")
# Maximum difference of parameters of the same camera, pixels.
SAME_CAMERA_PX = 0.01


def recognises(path: Path) -> bool:
    """Tell whether the folder holds scene_camera.json, rgb or gray, and depth."""
    return (path / CAMERAS).is_file() and (path / "depth").is_dir() and _color(path) is not None


def read(path: Path) -> Listing:
    """List the frames; raise InputError if the cameras have another format."""
    folder, file = _color(path), path / CAMERAS
    assert folder is not None, "recognises"
    cameras = {int(key): value for key, value in read_object(file).items() if key.isdigit() and isinstance(value, dict)}
    colors, depths = (images_by_number(one) for one in (folder, path / "depth"))
    numbers = sorted(colors.keys() | depths.keys())
    first = next((number for number in numbers if number in cameras), None)
    if first is None:
        raise InputError(f"{file}: has no camera of an image in {folder.name}/ or depth/")
    K, scale = _camera(cameras[first], f"{file}: image {first}")
    has_poses = any("cam_R_w2c" in camera for camera in cameras.values())
    frames = [
        FrameEntry(
            color=colors.get(number),
            depth=depths.get(number),
            pose=partial(_pose, cameras.get(number, {}), number) if has_poses else None,
            fault=_fault(cameras.get(number), number, K, scale),
        )
        for number in numbers
    ]
    fx, fy, cx, cy = K
    return Listing(frames, 1000.0 / scale, Calibration(fx, fy, cx, cy, None, CAMERAS), camera_folders=(path,))


def _color(path: Path) -> Path | None:
    return next((path / name for name in COLOR_FOLDERS if (path / name).is_dir()), None)


def _camera(camera: dict[str, Any], where: str) -> tuple[tuple[float, float, float, float], float]:
    """Return fx, fy, cx, cy and the scale; raise InputError if they are invalid."""
    K, scale = _numbers(camera.get("cam_K"), 9), _numbers([camera.get("depth_scale", 1.0)], 1)
    if K is None or scale is None or min(K[0], K[4], scale[0]) <= 0:
        raise InputError(f"{where}: expected 'cam_K' with 9 numbers, row by row, and a 'depth_scale' above 0")
    return (float(K[0]), float(K[4]), float(K[2]), float(K[5])), float(scale[0])


def _numbers(values: Any, count: int) -> Float64Array | None:
    try:
        found = np.array(values, np.float64).reshape(-1)
    except (TypeError, ValueError):
        return None
    return found if len(found) == count and np.isfinite(found).all() else None


def _fault(
    camera: dict[str, Any] | None, number: int, K: tuple[float, float, float, float], scale: float
) -> str | None:
    """Return the reason why an image cannot be used with the recording's camera, or None."""
    if camera is None:
        return f"{CAMERAS} has no camera of image {number}"
    try:
        image_K, image_scale = _camera(camera, f"{CAMERAS}: image {number}")
    except InputError as error:
        return str(error)
    if image_scale != scale or not np.allclose(image_K, K, atol=SAME_CAMERA_PX):
        return f"image {number} has a camera or a depth scale of its own"
    return None


def _pose(camera: dict[str, Any], number: int) -> Float64Array:
    R, t = _numbers(camera.get("cam_R_w2c"), 9), _numbers(camera.get("cam_t_w2c"), 3)
    if R is None or t is None:
        raise FrameError(f"{CAMERAS} has no pose of image {number}")
    T_camera_world = se3.assembled(R.reshape(3, 3), t / 1000.0)
    return se3.inverse(pose_from_matrix(T_camera_world, f"image {number} of {CAMERAS}"))


READERS.register("bop")(Reader("scene_camera.json, rgb/ or gray/, depth/", recognises, read))
