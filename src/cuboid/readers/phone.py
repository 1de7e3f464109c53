"""Recordings of phones: a large color image and a small depth image of the same camera."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.core.errors import FrameError
from cuboid.core.frame import UInt8Array
from cuboid.formats.reading import UnreadableError, read_bytes
from cuboid.readers.depth_camera import DepthCamera
from cuboid.readers.images import MAX_IMAGE_BYTES, decode_bytes, decode_depth
from cuboid.readers.reader import Calibration

# Depth has 192x256 pixels: color is shrunk by a whole number to about this width or height, whichever is longer. Finer
# color says more of textures than of shapes, and costs in proportion.
LONGEST_SIDE_PX = 640
# A frame whose focal length is further than this fraction from the median is of another zoom.
SAME_FOCAL = 0.03
# Of ARKit's world, as all these apps run it (world alignment "gravity").
UP_WORLD = (0.0, 1.0, 0.0)
# Carries coordinates of a camera with OpenCV's axes (y down, z forward) to those of one with ARKit's and OpenGL's.
T_OPENGL_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


def shrink_factor(size: tuple[int, int]) -> int:
    """Return by how much color of this width and height is shrunk."""
    return max(1, max(size) // LONGEST_SIDE_PX)


def shrunk(color: UInt8Array, factor: int) -> UInt8Array:
    """Return color (H, W, 3) with each block of `factor` x `factor` pixels its mean."""
    height, width = color.shape[0] // factor, color.shape[1] // factor
    if not height or not width:
        raise FrameError(f"the color image is {color.shape[1]}x{color.shape[0]}, too small to be shrunk by {factor}")
    whole = color[: height * factor, : width * factor]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def phone_cameras(
    K: tuple[float, float, float, float], size: tuple[int, int], depth_size: tuple[int, int], source: str
) -> Calibration:
    """Return the cameras of color that was shrunk and of depth that shows the same.

    Parameters
    ----------
    K : (float, float, float, float)
        fx, fy, cx, cy for color as it was recorded.
    size, depth_size : (int, int)
        Width and height as recorded.
    source : str
        Where they come from.
    """
    factor = shrink_factor(size)
    color = _scaled(K, 1 / factor, 1 / factor)
    depth = _scaled(K, depth_size[0] / size[0], depth_size[1] / size[1])
    camera = DepthCamera(*depth, depth_size, np.eye(4))
    return Calibration(*color, (size[0] // factor, size[1] // factor), source, depth_camera=camera)


def confident_depth(file: Path, confidence: Path, least: int) -> npt.NDArray[np.uint16]:
    """Return a depth image (H, W) without the readings whose confidence is less; all where there is no such image.

    Raises
    ------
    FrameError
        One of the two cannot be decoded, or they differ in size.
    """
    raw = decode_depth(file, f"depth/{file.name}").astype(np.uint16, copy=False)
    if not confidence.is_file():
        return raw
    name = f"image confidence/{confidence.name}"
    try:
        sure = decode_bytes(read_bytes(confidence, MAX_IMAGE_BYTES), name, cv2.IMREAD_UNCHANGED)
    except UnreadableError as error:
        raise FrameError(f"{name} {error.reason}") from None
    if sure.shape != raw.shape:
        raise FrameError(f"{name} is {sure.shape[1::-1]}, depth {raw.shape[::-1]}")
    return np.where(sure >= least, raw, 0).astype(np.uint16)


def _scaled(K: tuple[float, float, float, float], sx: float, sy: float) -> tuple[float, float, float, float]:
    fx, fy, cx, cy = K
    return fx * sx, fy * sy, (cx + 0.5) * sx - 0.5, (cy + 0.5) * sy - 0.5
