"""The interface of a camera driver: it opens a camera, describes its lens, and returns images as they arrive."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import require
from cuboid.ground.core.registry import Registry
from cuboid.inputs.readers.reader import Calibration
from cuboid.inputs.readers.undistortion import DepthArray


class StreamEndedError(Exception):
    """No more frames: the file that a camera plays back is at its end, or the device stopped by itself."""


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One color image with its depth, as from the camera.

    Attributes
    ----------
    timestamp_s : float
        Time of capture, seconds of the camera's clock.
    color : (H, W, 3) uint8
        RGB, with the distortion of the lens.
    depth : (h, w) uint16 or float32
        Depth in the driver's units, in the image of the depth camera if the driver's calibration has one, else aligned
        to color.
    T_world_camera : (4, 4) float64 or None
        Pose of the color camera, if the device provides it.
    arrived_s : float
        Time of arrival, seconds of the monotonic clock of this computer.
    """

    timestamp_s: float
    color: UInt8Array
    depth: DepthArray
    T_world_camera: Float64Array | None = None
    arrived_s: float = field(default_factory=time.monotonic)


class Driver(Protocol):
    """An open camera.

    Attributes
    ----------
    name : str
        Name in messages.
    calibration : Calibration
        Calibration with a known `size`, and with a depth camera if depth is not aligned to color.
    depth_units_per_metre : float
    has_poses : bool
        Whether the device provides poses.
    paced : bool
        Whether frames wait for their consumer, as those of a file do; frames of a live camera do not.
    """

    name: str
    calibration: Calibration
    depth_units_per_metre: float
    has_poses: bool
    paced: bool

    def take(self, wait_s: float) -> Shot | None:
        """Return the next frame; None if there is none within that time.

        Raises
        ------
        StreamEndedError
            There are no more frames.
        CuboidError
            The camera has failed; the message is one line.
        """

    def close(self) -> None:
        """Close the camera."""


# Opens a camera by its options (names and values from the user); raises InputError if there is no such camera.
OpenDriver = Callable[[Mapping[str, str]], Driver]

CAMERAS: Registry[OpenDriver] = Registry("camera", "cuboid.cameras")


def library(module: str, camera: str, extra: str = "", *, pip: str = "") -> Any:
    """Return a vendor's library; raise MissingExtraError if it is not installed."""
    return require(module, f"--camera {camera}", extra, pip=pip)


def refuse_unknown(camera: str, options: Mapping[str, str], option_names: tuple[str, ...]) -> None:
    """Raise InputError for an option that this camera does not have."""
    for name in options:
        if name not in option_names:
            raise InputError(f"--camera {camera}: unknown option '{name}'; there are: {', '.join(option_names)}")


def whole_number(camera: str, name: str, text: str) -> int:
    """Return an option that is a whole number, 0 or more; raise InputError if it is invalid."""
    if not (text.isascii() and text.isdigit()):
        raise InputError(f"--camera {camera}: {name} must be a whole number, got '{text}'")
    return int(text)


def image_size(camera: str, text: str) -> tuple[int, int]:
    """Return an option of the form WIDTHxHEIGHT in pixels; raise InputError if it is invalid."""
    width, _, height = text.partition("x")
    size = whole_number(camera, "size", width), whole_number(camera, "size", height)
    if min(size) < 1:
        raise InputError(f"--camera {camera}: size must be WIDTHxHEIGHT in pixels, got '{text}'")
    return size
