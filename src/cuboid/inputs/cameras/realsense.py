"""RealSense cameras, by pyrealsense2 (extra ``realsense``).

Options: ``serial=`` which of several, ``size=WIDTHxHEIGHT`` and ``rate=HZ`` of both streams (640x480, 30), ``file=`` a
``.bag`` of the SDK, which is played back frame by frame as if it were the camera.

Depth comes in the image of the depth camera; it is registered to color with the device's calibration.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.geometry.se3 import assembled, rigid
from cuboid.inputs.cameras.driver import (
    CAMERAS,
    Shot,
    StreamEndedError,
    image_size,
    library,
    refuse_unknown,
    whole_number,
)
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.reader import Calibration

NAME = "realsense"
OPTIONS = ("serial", "size", "rate", "file")
SIZE, RATE_HZ = "640x480", "30"
# The SDK projects with the same polynomial in all of these (rsutil.h); the others are fisheye lenses.
KNOWN_LENSES = ("none", "brown_conrady", "modified_brown_conrady", "inverse_brown_conrady")
# Time without frames after which a file is at its end, milliseconds: not all versions of the SDK report the end.
FILE_END_MS = 2000


class RealSense:
    """A camera of the RealSense SDK, or a file that it recorded.

    Parameters
    ----------
    options : mapping of str to str
    device : rs.device, optional
        Device to use instead of a detected one: the SDK's software device.

    Raises
    ------
    InputError
        There is no such camera or file, or its lens is a fisheye.
    MissingExtraError
        pyrealsense2 is not installed.
    """

    has_poses = False

    def __init__(self, options: Mapping[str, str], device: Any = None) -> None:
        refuse_unknown(NAME, options, OPTIONS)
        self._rs = rs = library("pyrealsense2", NAME, "realsense")
        self.paced = "file" in options
        config = self._config(options)
        if device is None and not self.paced and len(rs.context().query_devices()) == 0:
            raise InputError(f"--camera {NAME}: no camera is there")  # otherwise the pipeline would wait 15 s for one
        self._pipeline = rs.pipeline()
        try:
            if device is not None:
                self._pipeline.set_device(device)
            profile = self._pipeline.start(config)
        except RuntimeError as error:
            raise InputError(
                f"--camera {NAME}: {options.get('file', 'the camera')} cannot be opened: {error}"
            ) from None
        try:
            device = profile.get_device()
            if self.paced:
                device.as_playback().set_real_time(False)
            self.name = _name(rs, device)
            self.depth_units_per_metre = round(1.0 / device.first_depth_sensor().get_depth_scale(), 3)
            self.calibration = _calibration(rs, profile, self.name)
        except BaseException:
            self._pipeline.stop()
            raise

    def _config(self, options: Mapping[str, str]) -> Any:
        rs = self._rs
        config = rs.config()
        if "file" in options:
            if not Path(options["file"]).is_file():
                raise InputError(f"--camera {NAME}: {options['file']}: there is no such file")
            config.enable_device_from_file(options["file"], False)
            return config
        if "serial" in options:
            config.enable_device(options["serial"])
        width, height = image_size(NAME, options.get("size", SIZE))
        rate = whole_number(NAME, "rate", options.get("rate", RATE_HZ))
        config.enable_stream(rs.stream.color, width, height, rs.format.rgb8, rate)
        config.enable_stream(rs.stream.depth, width, height, rs.format.z16, rate)
        return config

    def take(self, wait_s: float) -> Shot | None:
        """Return the next color image with its depth; None if there is none within that time."""
        wait_ms = FILE_END_MS if self.paced else max(1, round(wait_s * 1e3))
        there, frames = self._pipeline.try_wait_for_frames(wait_ms)
        if not there:
            if self.paced:
                raise StreamEndedError
            return None
        color, depth = frames.get_color_frame(), frames.get_depth_frame()
        if not color or not depth:
            return None
        pixels = np.asanyarray(depth.get_data()).astype(np.uint16)  # a copy: the SDK reuses its memory
        return Shot(color.get_timestamp() * 1e-3, _rgb(color), pixels)

    def close(self) -> None:
        """Stop the streams."""
        self._pipeline.stop()


def _name(rs: Any, device: Any) -> str:
    parts = [
        device.get_info(what) for what in (rs.camera_info.name, rs.camera_info.serial_number) if device.supports(what)
    ]
    return " ".join(parts) or "RealSense"


def _rgb(color: Any) -> UInt8Array:
    """Return an image as RGB; files may have other channels than a camera's stream."""
    pixels = np.asanyarray(color.get_data())
    kind = color.get_profile().format().name
    if pixels.ndim != 3 or kind not in ("rgb8", "bgr8", "rgba8", "bgra8"):
        raise InputError(f"--camera {NAME}: color is {kind}, expected rgb8")
    rgb = pixels[..., :3] if kind.startswith("rgb") else pixels[..., 2::-1]
    return np.array(rgb, np.uint8, order="C")


def _calibration(rs: Any, profile: Any, name: str) -> Calibration:
    """Return both cameras and the transform between them."""
    color, depth = (profile.get_stream(kind).as_video_stream_profile() for kind in (rs.stream.color, rs.stream.depth))
    K, size, lens = _pinhole(color.get_intrinsics(), name)
    depth_K, depth_size, depth_lens = _pinhole(depth.get_intrinsics(), name)
    beside = depth.get_extrinsics_to(color)
    # The SDK's rotation is column-major.
    T_color_depth = assembled(np.array(beside.rotation).reshape(3, 3).T, beside.translation)
    camera = DepthCamera(*depth_K, depth_size, rigid(T_color_depth), depth_lens)
    return Calibration(*K, size, "the device", lens, camera)


def _pinhole(found: Any, name: str) -> tuple[tuple[float, float, float, float], tuple[int, int], tuple[float, ...]]:
    lens = tuple(float(value) for value in found.coeffs)
    if any(lens) and found.model.name not in KNOWN_LENSES:
        raise InputError(f"{name}: its lens is of the kind '{found.model.name}'; expected {', '.join(KNOWN_LENSES)}")
    return (found.fx, found.fy, found.ppx, found.ppy), (found.width, found.height), lens if any(lens) else ()


CAMERAS.register(NAME)(RealSense)
