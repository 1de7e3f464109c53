"""Scenes of nerfstudio, instant-ngp and similar programs with depth: ``transforms.json``.

Expected tree::

    scene/                       <- the recording
      transforms.json            fl_x, fl_y, cx, cy, w, h [, k1, k2, p1, p2 [, k3]], and frames, each with file_path,
                                 depth_file_path and transform_matrix (4x4, camera to world)
      images/frame_00001.png     8-bit color (.jpg as well), wherever file_path says
      depth/frame_00001.png      16-bit; depth_unit_scale_factor (0.001 unless given) makes metres

The files use OpenGL's camera axes (x right, y up, z back), which are converted to x right, y down, z forward; cx and cy
are relative to the corner of the image, not to the middle of its first pixel. Frames are sorted by the names of their
color images. Depth with another image size than color is from the same camera.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.inputs.readers.depth_camera import DepthCamera, check_number
from cuboid.inputs.readers.documents import read_object
from cuboid.inputs.readers.images import image_dimensions
from cuboid.inputs.readers.phone import T_OPENGL_OPENCV
from cuboid.inputs.readers.posetext import pose_from_matrix
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, Listing, Reader

TRANSFORMS = "transforms.json"
DEFAULT_SCALE = 0.001
_CAMERA = {"fx": "fl_x", "fy": "fl_y", "cx": "cx", "cy": "cy", "width": "w", "height": "h"}
_LENS = ("k1", "k2", "p1", "p2", "k3")
NUMBER = re.compile(r"(\d+)")


def recognises(path: Path) -> bool:
    """Tell whether the folder holds transforms.json."""
    return path.is_dir() and (path / TRANSFORMS).is_file()


def read(path: Path) -> Listing:
    """List the frames; raise InputError if the document has another format or no depth."""
    file = path / TRANSFORMS
    document = read_object(file)
    frames = document.get("frames")
    if not isinstance(frames, list) or not frames or not all(isinstance(frame, dict) for frame in frames):
        raise InputError(
            f"{file}: expected 'frames', a list of objects with file_path, depth_file_path, transform_matrix"
        )
    if not any(isinstance(frame.get("depth_file_path"), str) for frame in frames):
        raise InputError(f"{file}: no frame has a 'depth_file_path': the scene is without depth")
    frames.sort(key=lambda frame: _in_order(str(frame.get("file_path"))))
    scale = document.get("depth_unit_scale_factor", DEFAULT_SCALE)
    check_number("depth_unit_scale_factor", scale, str(file))
    entries = [_entry(path, frame, document) for frame in frames]
    return Listing(entries, 1.0 / scale, _calibration(file, document, frames, entries), camera_folders=(path,))


def _entry(path: Path, frame: Mapping[str, Any], document: Mapping[str, Any]) -> FrameEntry:
    color, depth = _image(path, frame.get("file_path")), _image(path, frame.get("depth_file_path"))
    other = [name for name in _CAMERA.values() if name in frame and frame[name] != document.get(name, frame[name])]
    return FrameEntry(
        color=color,
        depth=depth,
        pose=partial(_pose, frame.get("transform_matrix"), str(frame.get("file_path"))),
        fault=f"{frame.get('file_path')} has a camera of its own ({', '.join(other)})" if other else None,
    )


def _image(path: Path, name: Any) -> Path | None:
    """Return an image's file; instant-ngp omits the suffix."""
    if not isinstance(name, str) or not name or "\0" in name:
        return None
    file = path / name
    if file.suffix:
        return file
    return next((one for one in (file.with_suffix(".png"), file.with_suffix(".jpg")) if one.is_file()), file)


def _calibration(
    file: Path, document: Mapping[str, Any], frames: list[Any], entries: list[FrameEntry]
) -> Calibration | None:
    """Return the camera of all frames, or of the first one; None if there is neither."""
    entry = document if "fl_x" in document else frames[0]
    if "fl_x" not in entry:
        return None
    values = {name: entry.get(key, entry.get("fl_x") if key == "fl_y" else None) for name, key in _CAMERA.items()}
    for name, value in values.items():
        check_number(name, value, str(file))
    fx, fy, cx, cy, width, height = (float(value) for value in values.values())
    cx, cy = cx - 0.5, cy - 0.5
    for name in _LENS:
        check_number("cx", entry.get(name, 0.0), str(file), f"{name}, as ")  # any finite number
    lens = tuple(float(entry.get(name, 0.0)) for name in _LENS)
    size = (int(width), int(height))
    depth_size = next(
        (found for one in entries if isinstance(one.depth, Path) and (found := image_dimensions(one.depth))), size
    )
    camera = None
    if depth_size != size:
        sx, sy = depth_size[0] / size[0], depth_size[1] / size[1]
        center = ((cx + 0.5) * sx - 0.5, (cy + 0.5) * sy - 0.5)
        camera = DepthCamera(fx * sx, fy * sy, *center, depth_size, np.eye(4), lens if any(lens) else ())
    return Calibration(fx, fy, cx, cy, size, file.name, lens if any(lens) else (), camera)


def _pose(matrix: Any, name: str) -> Float64Array:
    try:
        values = np.array(matrix, np.float64)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape != (4, 4):
        raise FrameError(f"{name}: no camera pose: 'transform_matrix' is no 4x4 matrix")
    return pose_from_matrix(values, name) @ T_OPENGL_OPENCV


def _in_order(name: str) -> list[str]:
    """Return the key of the natural order, in which 10.png comes after 9.png."""
    return [f"{part:0>20}" if k % 2 else part for k, part in enumerate(NUMBER.split(name))]


READERS.register("nerfstudio")(Reader("transforms.json with depth_file_path", recognises, read))
