"""Opens a recording for tracking, with depth registered to color if the two are clearly misaligned."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.paths import as_path
from cuboid.ground.core.pose_convention import convention_names
from cuboid.ground.core.threads import return_free_memory
from cuboid.inputs.calibration.registering import Misregistration, displaced, is_off, register_recording
from cuboid.inputs.readers import Recording
from cuboid.inputs.readers import open_recording as read_recording
from cuboid.inputs.recordings.rig import FORMAT as RIG
from cuboid.inputs.recordings.rig import RigRecording, is_rig, read_rig, recordings_of

AUTO, ON, OFF = "auto", "on", "off"
# Values of `--register` and `open_recording(register=...)`.
REGISTER = (AUTO, ON, OFF)


def open_recording(
    path: str | PathLike[str],
    *,
    format: str | None = None,  # noqa: A002 - the flag's own name
    intrinsics: Sequence[float] | str | PathLike[str] | None = None,
    depth_scale: float | None = None,
    register: str = AUTO,
    pose_convention: str | None = None,
) -> Recording:
    """Open an RGB-D recording with its poses as they are; `cuboid.open_recording` also checks their clock.

    Parameters and exceptions are those of `cuboid.open_recording`.
    """
    if register not in REGISTER:
        raise ValueError(f"register must be one of {', '.join(REGISTER)}, got '{register}'")
    if format in (None, RIG) and is_rig(as_path(path)):
        if intrinsics is not None or depth_scale is not None or pose_convention is not None:
            raise InputError(f"{path}: the cameras of a rig differ; describe each in the camera.json of its recording")
        return open_rig(path, register=register)
    recording = read_recording(path, format=format, intrinsics=intrinsics, depth_scale=depth_scale)
    if pose_convention is not None:
        recording = recording.with_pose_convention(convention_names(pose_convention))
    if register == OFF or (register == AUTO and recording.depth_camera is not None):
        return recording
    registration = register_recording(recording)
    return_free_memory()
    found, registered = registration.found, registration.recording
    recording.registration_checked = True
    if found is not None and found.clear and (register == ON or is_off(found, recording.intrinsics)):
        if registration.refused is None:
            return registered.with_warning(_said(found, registered))
        advice = "depth is not changed; describe the depth camera in camera.json"
        return recording.with_warning(f"{displaced(found)}, but {registration.refused}: {advice}")
    if register == ON:
        views = 0 if found is None else found.views
        return recording.with_warning(f"depth is not clearly displaced from color ({views} views); it is not changed")
    return recording


def open_rig(path: str | PathLike[str], recordings: Sequence[Path] = (), *, register: str = AUTO) -> RigRecording:
    """Open the recordings of a rig's cameras as one.

    Parameters
    ----------
    path : str or path
        A ``rig.json``, or a folder with one.
    recordings : sequence of Path
        Recordings of the cameras, in the order of the file; by default those that the file names.
    register : {"auto", "on", "off"}
        As for `open_recording`, for each camera.

    Raises
    ------
    InputError
        The file is malformed, or a recording cannot be used; the message is one line.
    """
    file, rig = read_rig(as_path(path))
    opened = [open_recording(one, register=register) for one in recordings_of(file, rig, recordings)]
    nested = next((one for one in opened if isinstance(one, RigRecording)), None)
    if nested is not None:
        raise InputError(f"{file}: {nested.path} is a rig itself; name the recording of one camera")
    return RigRecording(file, rig, opened)


def _said(found: Misregistration, registered: Recording) -> str:
    camera, K = registered.depth_camera, registered.intrinsics
    assert camera is not None
    return (
        f"depth was displaced from color by {found.off_px:.0f} px and is registered now: depth camera fx "
        f"{camera.fx:.1f} fy {camera.fy:.1f} cx {camera.cx:.1f} cy {camera.cy:.1f}, "
        f"{100 * camera.T_color_depth[0, 3]:.1f} cm away; color camera fx {K.fx:.1f}; "
        "--register off leaves depth unchanged"
    )
