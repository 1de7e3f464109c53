"""The recording of finished results, opened again."""

from __future__ import annotations

from pathlib import Path

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.locate import open_recording
from cuboid.inputs.readers.reader import Calibration
from cuboid.inputs.readers.recording import Recording


def reopen_recording(
    path: Path,
    format: str,  # noqa: A002 - as in open_recording
    intrinsics: Intrinsics,
    distortion: tuple[float, ...],
    depth_camera: DepthCamera | None,
    last_frame: int,
    depth_units_per_metre: float | None = None,
) -> Recording:
    """Open the recording that results were made from.

    Parameters
    ----------
    path : Path
        Present path of the recording.
    format : str
        Name of the format, from the results.
    intrinsics : Intrinsics
        Intrinsics of the color image, from the results.
    distortion : tuple of float
        Distortion of the lens, from the results; it was removed.
    depth_camera : DepthCamera or None
        Depth camera from the results, whose depth was registered to color.
    last_frame : int
        The last frame in the results.
    depth_units_per_metre : float, optional
        Units of the depth images, from the results; default: the recording's own.

    Raises
    ------
    InputError
        The recording is missing, or its image size or number of frames differs from the results.
    """
    K = intrinsics
    camera = Calibration(K.fx, K.fy, K.cx, K.cy, None, "the results", distortion, depth_camera)
    recording = open_recording(path, format=format, intrinsics=camera, depth_scale=depth_units_per_metre)
    size = recording.intrinsics.width, recording.intrinsics.height
    if size != (K.width, K.height) or len(recording) <= last_frame:
        raise InputError(
            f"{recording.path}: is not the recording of the results: expected frame {last_frame} "
            f"and {K.width} x {K.height} pixels, got {len(recording)} frames of {size[0]} x {size[1]}"
        )
    return recording
