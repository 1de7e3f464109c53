"""Exports of the app Record3D for the iPhone, its "EXR + JPG sequence".

Expected tree::

    export/                  <- the recording; or the folder EXR_RGBD in it
      metadata.json          w, h, K (9 numbers, column by column), poses (qx qy qz qw x y z), frameTimestamps, fps
      rgb/0.jpg              8-bit color
      depth/0.exr            metres, one channel

The number in a name is the frame's index in `poses`. The files use ARKit's camera axes (x right, y up, z back), which
are converted to x right, y down, z forward. Color is downsampled by an integer factor, to a third of 1440x1920.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.extras import missing
from cuboid.ground.formats.reading import UnreadableError, names_in, opened
from cuboid.ground.formats.stored import local_file
from cuboid.inputs.readers.depth_camera import check_number
from cuboid.inputs.readers.documents import read_object
from cuboid.inputs.readers.image_folder import images_by_number
from cuboid.inputs.readers.images import MAX_IMAGE_BYTES, MAX_PIXELS, decode_color
from cuboid.inputs.readers.phone import T_OPENGL_OPENCV, UP_WORLD, phone_cameras, shrink_factor, shrunk
from cuboid.inputs.readers.posetext import pose_from_quaternion
from cuboid.inputs.readers.reader import READERS, FrameEntry, Listing, Reader, has_file

METADATA = "metadata.json"
DEPTH_FILE = re.compile(r"(\d+)\.exr")
DEFAULT_RATE_HZ = 30.0


def recognises(path: Path) -> bool:
    """Tell whether the folder holds metadata.json, rgb and depth with files N.exr."""
    return (path / METADATA).is_file() and (path / "rgb").is_dir() and has_file(path / "depth", DEPTH_FILE)


def read(path: Path) -> Listing:
    """List the frames; raise InputError if the metadata is malformed or OpenEXR is not installed."""
    _require_openexr(path)
    metadata = read_object(path / METADATA)
    K, size = color_camera(metadata, str(path / METADATA))
    depths = {
        int(match[1]): path / "depth" / name
        for name in names_in(path / "depth")
        if (match := DEPTH_FILE.fullmatch(name))
    }
    colors = images_by_number(path / "rgb")
    depth_size = next((found for number in sorted(depths) if (found := _exr_size(depths[number]))), None)
    if depth_size is None:
        raise InputError(f"{path}: no image of depth/ can be read")
    frames = [
        frame_entry(number, metadata, METADATA, colors.get(number), _exr_source(depths.get(number)), size)
        for number in sorted(colors.keys() | depths.keys())
    ]
    return Listing(frames, 1.0, phone_cameras(K, size, depth_size, METADATA), (path,), up_world=UP_WORLD)


def color_camera(metadata: dict[str, Any], where: str) -> tuple[tuple[float, float, float, float], tuple[int, int]]:
    """Return fx, fy, cx, cy and the size of color as recorded; InputError where the metadata do not tell."""
    for name in ("w", "h"):
        check_number(name, metadata.get(name), where)
    matrix: Any = metadata.get("K")
    if not isinstance(matrix, list) or len(matrix) != 9:
        raise InputError(f"{where}: expected 'K' with 9 numbers, column by column")
    for name, k in (("fx", 0), ("fy", 4), ("cx", 6), ("cy", 7)):
        check_number(name, matrix[k], where, "K, ")
    K = (float(matrix[0]), float(matrix[4]), float(matrix[6]), float(matrix[7]))
    return K, (int(metadata["w"]), int(metadata["h"]))


def frame_entry(
    number: int,
    metadata: dict[str, Any],
    name: str,
    color: Path | None,
    depth: Callable[[], Float32Array] | None,
    size: tuple[int, int],
) -> FrameEntry:
    """Return the frame of this number; `name` is that of the metadata's file, `size` that of color as recorded."""
    return FrameEntry(
        color=None if color is None else partial(_color, color, shrink_factor(size)),
        depth=depth,
        timestamp_s=_time_s(metadata, number),
        pose=partial(_pose, metadata.get("poses"), number, name) if "poses" in metadata else None,
    )


def _exr_source(file: Path | None) -> Callable[[], Float32Array] | None:
    return None if file is None else partial(_depth, file)


def _time_s(metadata: dict[str, Any], number: int) -> float:
    """Return the time of a frame: from the metadata, else from the frame rate."""
    times, fps = metadata.get("frameTimestamps"), metadata.get("fps")
    if isinstance(times, list) and number < len(times) and isinstance(times[number], (int, float)):
        return float(times[number])
    return number / (float(fps) if isinstance(fps, (int, float)) and fps > 0 else DEFAULT_RATE_HZ)


def _pose(poses: Any, number: int, file: str) -> Float64Array:
    name = f"frame {number} of {file}"
    if not isinstance(poses, list) or number >= len(poses):
        raise FrameError(f"{file} has no pose of frame {number}")
    try:
        qx, qy, qz, qw, x, y, z = (float(value) for value in poses[number])
    except (TypeError, ValueError):
        raise FrameError(f"{name}: the pose is not qx qy qz qw x y z") from None
    return pose_from_quaternion((qw, qx, qy, qz), (x, y, z), name) @ T_OPENGL_OPENCV


def _color(file: Path, factor: int) -> UInt8Array:
    return shrunk(decode_color(file, f"{file.parent.name}/{file.name}"), factor)


def _depth(file: Path) -> Float32Array:
    """Return the one channel of an EXR image."""
    import OpenEXR

    name = f"depth image depth/{file.name}"
    try:
        with opened(file, MAX_IMAGE_BYTES):  # otherwise the library would wait for a FIFO
            local = str(local_file(file))
    except UnreadableError as error:
        raise FrameError(f"{name} {error.reason}") from None
    except OSError as error:
        raise FrameError(f"{name} cannot be read: {error.strerror}") from None
    try:
        with OpenEXR.File(local, header_only=True) as image:
            low, high = (np.array(corner, np.int64) for corner in image.header()["dataWindow"])
        if not 0 < int(np.prod(high - low + 1)) <= MAX_PIXELS:
            raise ValueError(f"no image has a window from {low.tolist()} to {high.tolist()}")
        with OpenEXR.File(local) as image:
            pixels = next(iter(image.channels().values())).pixels
            found = np.array(pixels, np.float32)
    except Exception as error:  # the library raises all kinds of errors on damaged files
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise FrameError(f"{name} cannot be decoded: {reason}") from None
    if found.ndim != 2:
        raise FrameError(f"{name} must have one channel, it has {found.shape}")
    return found


def _exr_size(file: Path) -> tuple[int, int] | None:
    try:
        height, width = _depth(file).shape
    except FrameError:
        return None
    return int(width), int(height)


def _require_openexr(path: Path) -> None:
    try:
        import OpenEXR  # noqa: F401 - only to tell that it is there
    except ImportError:
        raise InputError(missing(f"{path}: its depth", "OpenEXR", "phone")) from None


READERS.register("record3d")(Reader("metadata.json, rgb/, depth/N.exr", recognises, read))
