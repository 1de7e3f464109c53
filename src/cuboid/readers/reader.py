"""The interface of a reader: it recognises its format, and lists the frames without decoding any."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy.typing as npt

from cuboid.core.frame import Float64Array
from cuboid.core.registry import Registry
from cuboid.formats.reading import names_in
from cuboid.readers.depth_camera import DepthCamera

# An image file, or, for recordings that are one big file, a function that gives the decoded image:
# color (H, W, 3) uint8 RGB, depth (H, W) uint16 or float32. It raises FrameError where it cannot.
ImageSource = Path | Callable[[], npt.NDArray[Any]]


@dataclass(frozen=True, slots=True)
class FrameEntry:
    """Where one frame of a recording lies; nothing of it is decoded.

    Attributes
    ----------
    color, depth : Path, callable or None
        None where the recording lacks it; the frame is then skipped.
    timestamp_s : float or None
        Seconds; None in recordings without timestamps.
    pose : callable or None
        Gives T_world_camera (4, 4), which `Recording` checks, or raises FrameError with the reason why this frame has
        none.
    fault : str or None
        A reason known beforehand why the frame cannot be used, one line.
    up_camera : callable or None
        Gives the direction away from the earth's pull, (3,) in coordinates of the color camera, as it was measured when
        the frame was taken, or raises FrameError; None in recordings that did not measure it.
    """

    color: ImageSource | None
    depth: ImageSource | None
    timestamp_s: float | None = None
    pose: Callable[[], Float64Array] | None = None
    fault: str | None = None
    up_camera: Callable[[], Float64Array] | None = None


@dataclass(frozen=True, slots=True)
class Calibration:
    """A camera and where what is known of it was found.

    Attributes
    ----------
    fx, fy, cx, cy : float
        Pixels.
    size : (int, int) or None
        Width and height in pixels of the images that it holds for; None where that is not said.
    source : str
        Where it comes from, for messages: "camera.json", "published for freiburg1".
    distortion : tuple of float
        Of the lens, in OpenCV's order: k1, k2, p1, p2[, k3[, k4, k5, k6]]; empty where the images are a pinhole's.
        It is taken out of color and depth.
    depth_camera : DepthCamera or None
        Where depth was taken by a camera of its own, beside this one, and is not aligned to color; then the
        attributes above are those of the color camera, and depth is registered to its image.
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
        In the order of the recording, those known to be bad included.
    depth_units_per_metre : float or None
        The format's own depth scale; None where each recording has to say.
    calibration : Calibration or None
        The pinhole that was published for the recording or its format, used where no file gives another.
    camera_folders : tuple of Path
        Folders in which a ``camera.json`` or ``camera-intrinsics.txt`` counts, the first find wins.
    poses_of_depth : bool
        Whether the poses are those of the depth camera, where depth has a camera of its own; else of the color camera.
    up_world : (float, float, float) or None
        Unit vector away from the earth's pull in the world of the poses, where the format or the file says so.
    warnings : tuple of str
        What the user should know of the files, one line each.
    """

    frames: Sequence[FrameEntry]
    depth_units_per_metre: float | None = None
    calibration: Calibration | None = None
    camera_folders: tuple[Path, ...] = ()
    poses_of_depth: bool = False
    up_world: tuple[float, float, float] | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Reader:
    """A format of recordings.

    Attributes
    ----------
    expects : str
        What a recording of this format holds, in a few words, for messages.
    recognises : callable
        Path -> bool: whether exactly this path (not something beneath it) is a recording of this format.
    read : callable
        Path -> Listing; raises InputError where the recording as a whole is faulty.
    read_with : callable, optional
        (Path, options) -> Listing, where the format has options: names and values, as the user gave them behind the
        format's name.
    files : tuple of str
        Endings of the names of files that may be such a recording; folders always may.
    gives_way : callable
        Path -> bool: whether another reader that recognises the same path is right, for it knows more of it.
    """

    expects: str
    recognises: Callable[[Path], bool]
    read: Callable[[Path], Listing]
    read_with: Callable[[Path, Mapping[str, str]], Listing] | None = None
    files: tuple[str, ...] = ()
    gives_way: Callable[[Path], bool] = lambda path: False


def has_file(path: Path, name: re.Pattern[str]) -> bool:
    """Tell whether a path is a folder with a file whose whole name matches; stops at the first.

    Raises
    ------
    InputError
        If the folder may not be read.
    """
    return path.is_dir() and any(name.fullmatch(found) for found in names_in(path))


READERS: Registry[Reader] = Registry("format", "cuboid.readers")
