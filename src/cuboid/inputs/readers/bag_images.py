"""Conversion of ROS image messages to arrays."""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import FrameError
from cuboid.inputs.readers.images import COLOR_FLAGS, decode_bytes
from cuboid.inputs.readers.undistortion import DepthArray

COMPRESSED = "sensor_msgs/msg/CompressedImage"
RAW = "sensor_msgs/msg/Image"
# REP 118: depth as 16-bit numbers is in millimetres, as floating point in metres.
WHOLE_UNITS_PER_METRE, FLOAT_UNITS_PER_METRE = 1000.0, 1.0
DEPTH_ENCODINGS: dict[str, np.dtype[Any]] = {"16UC1": np.dtype("u2"), "mono16": np.dtype("u2"), "32FC1": np.dtype("f4")}
# Channels of color encodings, and OpenCV's conversion to RGB.
COLOR_ENCODINGS: dict[str, tuple[int, int | None]] = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "8UC3": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "8UC4": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB),
    "8UC1": (1, cv2.COLOR_GRAY2RGB),
    "yuv422": (2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2RGB_YUYV),
    "yuyv": (2, cv2.COLOR_YUV2RGB_YUYV),
}
# Header of compressed_depth_image_transport before the PNG: format, and two parameters to decode inverse depth.
_DEPTH_HEADER = struct.Struct("<iff")


def is_depth(message: Any) -> bool | None:
    """Tell whether an image message contains depth (True) or color (False); None for other encodings."""
    if message.__msgtype__ not in (RAW, COMPRESSED):
        return None
    if message.__msgtype__ == COMPRESSED:
        words = message.format.lower()
        return "compresseddepth" in words or words.split(";")[0].strip() in ("16uc1", "32fc1", "mono16")
    if message.encoding in DEPTH_ENCODINGS:
        return True
    return False if message.encoding in COLOR_ENCODINGS else None


def units_per_metre(message: Any) -> float:
    """Return the units per metre of the depth that `depth_of` returns."""
    encoding = message.format.split(";")[0].strip() if message.__msgtype__ == COMPRESSED else message.encoding
    return FLOAT_UNITS_PER_METRE if encoding == "32FC1" else WHOLE_UNITS_PER_METRE


def _refuse_no_image(message: Any, what: str) -> None:
    """Raise FrameError if a damaged index leads to a message of another type."""
    if message.__msgtype__ not in (RAW, COMPRESSED):
        raise FrameError(f"{what} is no image but a {message.__msgtype__}")


def color_of(message: Any, what: str) -> UInt8Array:
    """Return the color image (H, W, 3) of a message; raise FrameError if it is invalid."""
    _refuse_no_image(message, what)
    if message.__msgtype__ == COMPRESSED:
        return np.asarray(decode_bytes(_bytes(message), what, COLOR_FLAGS), np.uint8)
    if message.encoding not in COLOR_ENCODINGS:
        raise FrameError(f"{what} is encoded as '{message.encoding}', expected {', '.join(COLOR_ENCODINGS)}")
    channels, conversion = COLOR_ENCODINGS[message.encoding]
    pixels = _pixels(message, np.dtype("u1"), channels, what)
    return np.ascontiguousarray(pixels if conversion is None else cv2.cvtColor(pixels, conversion), np.uint8)


def depth_of(message: Any, what: str) -> DepthArray:
    """Return the depth image (H, W) of a message, in `units_per_metre`; raise FrameError if it is invalid."""
    _refuse_no_image(message, what)
    if message.__msgtype__ == COMPRESSED:
        return _compressed_depth(message, what)
    if message.encoding not in DEPTH_ENCODINGS:
        raise FrameError(f"{what} is encoded as '{message.encoding}', expected {', '.join(DEPTH_ENCODINGS)}")
    kind = DEPTH_ENCODINGS[message.encoding].newbyteorder(">" if message.is_bigendian else "<")
    pixels = _pixels(message, kind, 1, what)[..., 0]
    return pixels.astype(np.float32) if kind.kind == "f" else pixels.astype(np.uint16)


def _pixels(message: Any, kind: np.dtype[Any], channels: int, what: str) -> npt.NDArray[Any]:
    """Return the pixels of a raw image (H, W, channels) without the padding of its rows."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * kind.itemsize
    data = np.asarray(message.data).view(np.uint8).reshape(-1)
    if height < 1 or width < 1 or step < row or len(data) < step * (height - 1) + row:
        raise FrameError(f"{what} is cut short: {len(data)} bytes of {width}x{height} {message.encoding}")
    rows = np.lib.stride_tricks.as_strided(data, (height, row), (step, 1), writeable=False)
    return np.ascontiguousarray(rows).view(kind).reshape(height, width, channels)


def _compressed_depth(message: Any, what: str) -> DepthArray:
    data = _bytes(message)
    words = [word.strip() for word in message.format.split(";")]
    if "rvl" in message.format.lower():
        raise FrameError(f"{what} is compressed as RVL, expected PNG")
    inverse = (0.0, 0.0)
    if "compresseddepth" in message.format.lower():
        if len(data) < _DEPTH_HEADER.size:
            raise FrameError(f"{what} is cut short ({len(data)} bytes)")
        inverse, data = _DEPTH_HEADER.unpack_from(data)[1:], data[_DEPTH_HEADER.size :]
    image = decode_bytes(data, what, cv2.IMREAD_UNCHANGED)
    if image.ndim != 2 or image.dtype != np.uint16:
        raise FrameError(f"{what} must have one channel of 16 bits")
    if words[0] != "32FC1":
        return np.asarray(image, np.uint16)
    with np.errstate(divide="ignore", invalid="ignore"):  # the writer makes depth = a / (value - b)
        return np.where(image > 0, inverse[0] / (image.astype(np.float32) - inverse[1]), 0).astype(np.float32)


def _bytes(message: Any) -> bytes:
    return np.asarray(message.data).view(np.uint8).tobytes()
