"""Opens one picture: a color and a depth image, or a folder with one of each."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.paths import as_path
from cuboid.inputs.readers import FrameEntry, Listing, Recording
from cuboid.inputs.readers.calibration import choose
from cuboid.inputs.recordings.opening import OFF, open_recording

FORMAT = "picture"


def open_picture(
    color: str | PathLike[str],
    depth: str | PathLike[str] | None = None,
    *,
    intrinsics: Sequence[float] | str | PathLike[str] | None = None,
    depth_scale: float | None = None,
) -> Recording:
    """Open one picture as a recording of one frame.

    Parameters
    ----------
    color : str or path
        The color image; without `depth`, a recording of one frame, such as a folder with the two images.
    depth : str or path, optional
        The depth image, aligned to color.
    intrinsics, depth_scale : optional
        As for `open_recording`; by default those of a ``camera.json`` beside one of the images.

    Raises
    ------
    InputError
        If a file does not exist, the camera is not known, or the recording has several frames.
    """
    path = as_path(color)
    if depth is None:
        found = open_recording(path, intrinsics=intrinsics, depth_scale=depth_scale, register=OFF)
        if len(found) != 1:
            raise InputError(f"{path}: has {len(found)} frames, expected one picture; 'cuboid track' takes a recording")
        return found
    images = path, as_path(depth)
    for image in images:
        if not image.is_file():
            raise InputError(f"{image}: no such file; expected a color and a depth image")
    folders = tuple(dict.fromkeys(image.parent for image in images))
    listing = Listing([FrameEntry(*images)], camera_folders=folders)
    return Recording(path, FORMAT, listing, *choose(listing, intrinsics, depth_scale, path))
