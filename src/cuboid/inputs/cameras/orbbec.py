"""Orbbec cameras (Astra 2, Gemini, Femto), by pyorbbecsdk2.

Options: ``serial=`` which of several, ``size=WIDTHxHEIGHT`` of color (640x480), ``rate=HZ`` (30).

The package pins old versions of packages that only its examples need, so it cannot be part of an extra; see `PIP`.
Depth comes in the image of the depth camera; it is registered to color with the device's calibration.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.geometry.se3 import assembled, rigid
from cuboid.inputs.cameras.driver import CAMERAS, Shot, image_size, library, refuse_unknown, whole_number
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.reader import Calibration

NAME = "orbbec"
OPTIONS = ("serial", "size", "rate")
SIZE, RATE_HZ = "640x480", "30"
PIP = "--no-deps pyorbbecsdk2"
MILLIMETRES = 1000.0
# OpenCV's conversions to RGB from other color formats.
CONVERSIONS = {"BGR": cv2.COLOR_BGR2RGB, "YUYV": cv2.COLOR_YUV2RGB_YUYV, "UYVY": cv2.COLOR_YUV2RGB_UYVY}


class Orbbec:
    """A camera of the Orbbec SDK.

    Parameters
    ----------
    options : mapping of str to str

    Raises
    ------
    InputError
        There is no such camera.
    MissingExtraError
        pyorbbecsdk2 is not installed.
    """

    has_poses = False
    paced = False
    depth_units_per_metre = MILLIMETRES

    def __init__(self, options: Mapping[str, str]) -> None:
        refuse_unknown(NAME, options, OPTIONS)
        self._sdk = sdk = library("pyorbbecsdk", NAME, pip=PIP)
        size = image_size(NAME, options.get("size", SIZE))
        rate = whole_number(NAME, "rate", options.get("rate", RATE_HZ))
        try:
            device = _device(sdk, options.get("serial"))
            self._pipeline = sdk.Pipeline(device)
            self._pipeline.start(self._config(size, rate))
        except (RuntimeError, sdk.OBError) as error:
            raise InputError(f"--camera {NAME}: the camera cannot be opened: {error}") from None
        try:
            info = device.get_device_info()
            self.name = f"{info.get_name()} {info.get_serial_number()}"
            self.calibration = calibration_of(self._pipeline.get_camera_param())
        except BaseException:
            self._pipeline.stop()
            raise

    def _config(self, size: tuple[int, int], rate: int) -> Any:
        """Return the configuration of the streams: the given color size if available, and default depth."""
        sdk, config = self._sdk, self._sdk.Config()
        colors = self._pipeline.get_stream_profile_list(sdk.OBSensorType.COLOR_SENSOR)
        depths = self._pipeline.get_stream_profile_list(sdk.OBSensorType.DEPTH_SENSOR)
        try:
            color = colors.get_video_stream_profile(*size, sdk.OBFormat.RGB, rate)
        except sdk.OBError:
            color = colors.get_default_video_stream_profile()
        config.enable_stream(color)
        config.enable_stream(depths.get_default_video_stream_profile())
        config.set_frame_aggregate_output_mode(sdk.OBFrameAggregateOutputMode.FULL_FRAME_REQUIRE)
        self._pipeline.enable_frame_sync()
        return config

    def take(self, wait_s: float) -> Shot | None:
        """Return the next color image with its depth; None if there is none within that time."""
        frames = self._pipeline.wait_for_frames(max(1, round(wait_s * 1e3)))
        if frames is None:
            return None
        color, depth = frames.get_color_frame(), frames.get_depth_frame()
        if color is None or depth is None:
            return None
        return Shot(color.get_timestamp_us() * 1e-6, rgb_of(color), depth_of(depth))

    def close(self) -> None:
        """Stop the streams."""
        self._pipeline.stop()


def _device(sdk: Any, serial: str | None) -> Any:
    found = sdk.Context().query_devices()
    if found.get_count() == 0:
        raise InputError(f"--camera {NAME}: no camera is there")
    if serial is None:
        return found.get_device_by_index(0)
    return found.get_device_by_serial_number(serial)


def rgb_of(frame: Any) -> UInt8Array:
    """Return a color frame as RGB (H, W, 3); raise FrameError for an unknown format."""
    height, width = frame.get_height(), frame.get_width()
    data, kind = np.asarray(frame.get_data()).view(np.uint8).reshape(-1), str(frame.get_format()).rpartition(".")[2]
    if kind == "MJPG":
        image = cv2.imdecode(data, cv2.IMREAD_COLOR)
        if image is None:
            raise FrameError("a color image cannot be decoded")
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
    channels = 3 if kind in ("RGB", "BGR") else 2
    if (kind != "RGB" and kind not in CONVERSIONS) or len(data) != height * width * channels:
        raise FrameError(f"a color image is {len(data)} bytes of {width}x{height} {kind}, expected RGB")
    pixels = data.reshape(height, width, channels)
    return np.array(pixels if kind == "RGB" else cv2.cvtColor(pixels, CONVERSIONS[kind]), np.uint8)


def depth_of(frame: Any) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Return a depth frame in millimetres (h, w): the units differ between devices and modes."""
    height, width = frame.get_height(), frame.get_width()
    data = np.asarray(frame.get_data()).view(np.uint8).reshape(-1)
    if len(data) != height * width * 2:
        raise FrameError(f"a depth image is {len(data)} bytes of {width}x{height} pixels of 16 bits")
    return data.view("<u2").reshape(height, width).astype(np.float32) * np.float32(frame.get_depth_scale())


def calibration_of(param: Any) -> Calibration:
    """Return both cameras and the transform between them, which the SDK has in millimetres."""
    color, depth = param.rgb_intrinsic, param.depth_intrinsic
    rotation, shift_mm = (np.asarray(part, np.float64) for part in (param.transform.rot, param.transform.transform))
    T_color_depth = assembled(rotation.reshape(3, 3), shift_mm.reshape(3) / MILLIMETRES)
    camera = DepthCamera(*_K(depth), (depth.width, depth.height), rigid(T_color_depth), _lens(param.depth_distortion))
    return Calibration(*_K(color), (color.width, color.height), "the device", _lens(param.rgb_distortion), camera)


def _K(found: Any) -> tuple[float, float, float, float]:
    return float(found.fx), float(found.fy), float(found.cx), float(found.cy)


def _lens(found: Any) -> tuple[float, ...]:
    """Return the coefficients in OpenCV's order; empty where all are 0."""
    values = (found.k1, found.k2, found.p1, found.p2, found.k3, found.k4, found.k5, found.k6)
    return tuple(float(value) for value in values) if any(values) else ()


CAMERAS.register(NAME)(Orbbec)
