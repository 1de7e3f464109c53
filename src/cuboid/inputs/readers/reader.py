"""The interface of a reader: it recognises its format, and lists the frames without decoding them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.registry import Registry
from cuboid.ground.formats.reading import names_in
from cuboid.inputs.readers.depth_camera import DepthCamera

# An image file, or, for recordings in one big file, a function that returns the decoded image: color (H, W, 3) uint8
# RGB, depth (H, W) uint16 or float32. It raises FrameError if it fails.
ImageSource = Path | Callable[[], npt.NDArray[Any]]


@dataclass(frozen=True, slots=True)
class FrameEntry:
    """The sources of one frame of a recording, not decoded.

    Attributes
    ----------
    color, depth : Path, callable or None
        Source of the image; None if it is missing, and the frame is then skipped.
    timestamp_s : float or None
        Seconds; None in recordings without timestamps.
    pose : callable or None
        Returns T_world_camera (4, 4), which `Recording` checks, or raises FrameError with the reason why this frame has
        none.
    pose_after : callable, optional
        Returns the pose at a time, seconds, after that of the frame, where poses have times of their own. By default
        it is interpolated between the poses of frames.
    fault : str or None
        Reason, known in advance, why the frame cannot be used, one line.
    up_camera : callable or None
        Returns the measured up direction (opposite to gravity), (3,), in the color camera, or raises FrameError; None
        in recordings without such measurements.
    """

    color: ImageSource | None
    depth: ImageSource | None
    timestamp_s: float | None = None
    pose: Callable[[], Float64Array] | None = None
    fault: str | None = None
    up_camera: Callable[[], Float64Array] | None = None
    pose_after: Callable[[float], Float64Array] | None = None


@dataclass(frozen=True, slots=True)
class Calibration:
    """A camera and the source of its parameters.

    Attributes
    ----------
    fx, fy, cx, cy : float
        Pixels.
    size : (int, int) or None
        Width and height in pixels of the images to which it applies; None if unknown.
    source : str
        Source of the parameters, for messages: "camera.json", "published for freiburg1".
    distortion : tuple of float
        Distortion of the lens, in OpenCV's order: k1, k2, p1, p2[, k3[, k4, k5, k6]]; empty for undistorted images. It
        is removed from color and depth.
    depth_camera : DepthCamera or None
        A separate depth camera, if depth is not aligned to color; the attributes above then belong to the color camera,
        and depth is registered to its image.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int] | None
    source: str
    distortion: tuple[float, ...] = ()
    depth_camera: DepthCamera | None = None


@dataclass(frozen=True, slots=True)
class Listing:
    """The contents of a recording, as a reader found them.

    Attributes
    ----------
    frames : sequence of FrameEntry
        Frames in the order of the recording, including known bad ones.
    depth_units_per_metre : float or None
        The format's depth scale; None if each recording has its own.
    calibration : Calibration or None
        The pinhole that was published for the recording or its format, used unless a file gives another one.
    camera_folders : tuple of Path
        Folders that are searched for a ``camera.json`` or ``camera-intrinsics.txt``; the first one found is used.
    poses_of_depth : bool
        Whether the poses belong to the depth camera, if there is a separate one; else to the color camera.
    up_world : (float, float, float) or None
        Up (opposite to gravity), a unit vector in the world of the poses, if the format or the file gives it.
    warnings : tuple of str
        Warnings for the user about the files, one line each.
    assumed : str
        Why the calibration and the depth scale above are only assumed, in words; empty if they are known to hold.
    """

    frames: Sequence[FrameEntry]
    depth_units_per_metre: float | None = None
    calibration: Calibration | None = None
    camera_folders: tuple[Path, ...] = ()
    poses_of_depth: bool = False
    up_world: tuple[float, float, float] | None = None
    warnings: tuple[str, ...] = ()
    assumed: str = ""


@dataclass(frozen=True, slots=True)
class Reader:
    """A format of recordings.

    Attributes
    ----------
    expects : str
        Contents of a recording of this format, in a few words, for messages.
    recognises : callable
        Path -> bool: whether exactly this path (not a path below it) is a recording of this format.
    read : callable
        Path -> Listing; raises InputError if the recording as a whole is faulty.
    read_with : callable, optional
        (Path, options) -> Listing, for formats with options: names and values from the user, after the format's name.
    files : tuple of str
        Suffixes of files that may be such a recording; folders are always tried.
    gives_way : callable
        Path -> bool: whether another, more specific reader that recognises the same path takes precedence.
    """

    expects: str
    recognises: Callable[[Path], bool]
    read: Callable[[Path], Listing]
    read_with: Callable[[Path, Mapping[str, str]], Listing] | None = None
    files: tuple[str, ...] = ()
    gives_way: Callable[[Path], bool] = lambda path: False


def has_file(path: Path, name: re.Pattern[str]) -> bool:
    """Tell whether a path is a folder with a file whose whole name matches.

    Raises
    ------
    InputError
        If the folder may not be read.
    """
    return path.is_dir() and any(name.fullmatch(found) for found in names_in(path))


READERS: Registry[Reader] = Registry("format", "cuboid.readers")
