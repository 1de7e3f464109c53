"""Recordings of phones: a large color image and a small depth image of the same camera."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.images import decode_bytes, decode_depth, image_bytes, image_dimensions
from cuboid.inputs.readers.reader import Calibration

# Depth has 192x256 pixels: color is downsampled by an integer factor so that its longer side is about this. Finer color
# shows more texture, not more shape, and costs time in proportion.
LONGEST_SIDE_PX = 640
# Maximum relative difference of a frame's focal length from the median; beyond it the zoom is different.
SAME_FOCAL = 0.03
# Up in ARKit's world, as used by all these apps (world alignment "gravity").
UP_WORLD = (0.0, 1.0, 0.0)
# Transform from a camera with OpenCV's axes (y down, z forward) to one with the axes of ARKit and OpenGL.
T_OPENGL_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


def shrink_factor(size: tuple[int, int]) -> int:
    """Return the downsampling factor of color with this width and height."""
    return max(1, max(size) // LONGEST_SIDE_PX)


def shrunk(color: UInt8Array, factor: int) -> UInt8Array:
    """Return color (H, W, 3) downsampled by the mean of blocks of `factor` x `factor` pixels."""
    height, width = color.shape[0] // factor, color.shape[1] // factor
    if not height or not width:
        raise FrameError(f"the color image is {color.shape[1]}x{color.shape[0]}, too small to be shrunk by {factor}")
    whole = color[: height * factor, : width * factor]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def phone_cameras(
    K: tuple[float, float, float, float], size: tuple[int, int], depth_size: tuple[int, int], source: str
) -> Calibration:
    """Return the cameras of downsampled color and of depth with the same view.

    Parameters
    ----------
    K : (float, float, float, float)
        fx, fy, cx, cy for color as recorded.
    size, depth_size : (int, int)
        Width and height as recorded.
    source : str
        Source of the intrinsics, for messages.
    """
    factor = shrink_factor(size)
    color = _scaled(K, 1 / factor, 1 / factor)
    depth = _scaled(K, depth_size[0] / size[0], depth_size[1] / size[1])
    camera = DepthCamera(*depth, depth_size, np.eye(4))
    return Calibration(*color, (size[0] // factor, size[1] // factor), source, depth_camera=camera)


def depth_size_of(depths: Iterable[Path], path: Path, name: str = "depth") -> tuple[int, int]:
    """Return width and height of the first readable depth image; raise InputError if none is."""
    size = next((found for depth in depths if (found := image_dimensions(depth))), None)
    if size is None:
        raise InputError(f"{path}: no image of {name}/ can be read")
    return size


def confident_depth(file: Path, confidence: Path, least: int) -> npt.NDArray[np.uint16]:
    """Return a depth image (H, W) without readings of less confidence; all readings if there is no confidence.

    Raises
    ------
    FrameError
        One of the two cannot be decoded, or they differ in size.
    """
    raw = decode_depth(file, f"depth/{file.name}").astype(np.uint16, copy=False)
    if not confidence.is_file():
        return raw
    name = f"image confidence/{confidence.name}"
    sure = decode_bytes(image_bytes(confidence, name), name, cv2.IMREAD_UNCHANGED)
    if sure.shape != raw.shape:
        raise FrameError(f"{name} is {sure.shape[1::-1]}, depth {raw.shape[::-1]}")
    return np.where(sure >= least, raw, 0).astype(np.uint16)


def _scaled(K: tuple[float, float, float, float], sx: float, sy: float) -> tuple[float, float, float, float]:
    fx, fy, cx, cy = K
    return fx * sx, fy * sy, (cx + 0.5) * sx - 0.5, (cy + 0.5) * sy - 0.5
