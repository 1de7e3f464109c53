"""The interface of a camera driver: it opens a camera, describes its lens, and gives images as they are taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from cuboid.core.errors import InputError
from cuboid.core.extras import require
from cuboid.core.frame import Float64Array, UInt8Array
from cuboid.core.registry import Registry
from cuboid.readers.reader import Calibration
from cuboid.readers.undistortion import DepthArray


class StreamEndedError(Exception):
    """No frame will follow: the file that a camera plays back is at its end, or the device stopped by itself."""


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One color image with its depth, as the camera gives them.

    Attributes
    ----------
    timestamp_s : float
        When it was taken, seconds of the camera's clock.
    color : (H, W, 3) uint8
        RGB, with the distortion of the lens.
    depth : (h, w) uint16 or float32
        In the driver's units, of its own camera where the driver's calibration has a depth camera, else aligned to
        color.
    T_world_camera : (4, 4) float64 or None
        Pose of the color camera, where the device tells it.
    """

    timestamp_s: float
    color: UInt8Array
    depth: DepthArray
    T_world_camera: Float64Array | None = None


class Driver(Protocol):
    """An open camera.

    Attributes
    ----------
    name : str
        What messages call it.
    calibration : Calibration
        Its `size` is known; with a depth camera where depth is not aligned to color.
    depth_units_per_metre : float
    has_poses : bool
        Whether it tells where it is.
    paced : bool
        Whether frames wait for who takes them, as those of a file do; those of a camera do not.
    """

    name: str
    calibration: Calibration
    depth_units_per_metre: float
    has_poses: bool
    paced: bool

    def take(self, wait_s: float) -> Shot | None:
        """Return the next frame; None where there is none within that time.

        Raises
        ------
        StreamEndedError
            None will follow.
        CuboidError
            The camera has failed; one line says how.
        """

    def close(self) -> None:
        """Let go of the camera."""


# Opens a camera by its options, names and values as the user gave them. It raises InputError where there is none.
OpenDriver = Callable[[Mapping[str, str]], Driver]

CAMERAS: Registry[OpenDriver] = Registry("camera", "cuboid.cameras")


def library(module: str, camera: str, extra: str = "", *, pip: str = "") -> Any:
    """Return a vendor's library; raises MissingExtraError where it is not installed."""
    return require(module, f"--camera {camera}", extra, pip=pip)


def refuse_unknown(camera: str, options: Mapping[str, str], known: tuple[str, ...]) -> None:
    """Raise InputError where an option is none of this camera."""
    for name in options:
        if name not in known:
            raise InputError(f"--camera {camera}: unknown option '{name}'; there are: {', '.join(known)}")


def whole_number(camera: str, name: str, text: str) -> int:
    """Return an option that is a whole number, 0 or more; raises InputError where it is none."""
    if not (text.isascii() and text.isdigit()):
        raise InputError(f"--camera {camera}: {name} must be a whole number, got '{text}'")
    return int(text)


def image_size(camera: str, text: str) -> tuple[int, int]:
    """Return an option of the form WIDTHxHEIGHT in pixels; raises InputError where it is none."""
    width, _, height = text.partition("x")
    size = whole_number(camera, "size", width), whole_number(camera, "size", height)
    if min(size) < 1:
        raise InputError(f"--camera {camera}: size must be WIDTHxHEIGHT in pixels, got '{text}'")
    return size
