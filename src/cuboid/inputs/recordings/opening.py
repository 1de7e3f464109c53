"""Opens a recording for tracking, with depth registered to color if the two are clearly misaligned."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.paths import as_path
from cuboid.ground.core.pose_convention import convention_names
from cuboid.ground.core.threads import return_free_memory
from cuboid.inputs.calibration.known_cameras import camera_text, fitting_camera
from cuboid.inputs.calibration.registering import Misregistration, displaced, is_off, register_recording
from cuboid.inputs.readers import Calibration, Recording
from cuboid.inputs.readers import open_recording as read_recording
from cuboid.inputs.readers.missing_camera import UnknownIntrinsicsError
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
    try:
        recording = read_recording(path, format=format, intrinsics=intrinsics, depth_scale=depth_scale)
    except UnknownIntrinsicsError as error:
        _add_known_camera(error, path, format, depth_scale)
        raise
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
        advice = _camera_advice(path, format, recording)
        return recording.with_warning(f"{displaced(found)}, but {registration.refused}: depth is not changed; {advice}")
    if register == ON:
        views = 0 if found is None else found.views
        return recording.with_warning(f"depth is not clearly displaced from color ({views} views); it is not changed")
    return recording


# What describes two cameras that are not known.
THREE_THINGS = (
    "describe the cameras in camera.json: fx, fy, cx, cy of color, the same of depth as 'depth_camera', and "
    "'T_color_depth'"
)


def _known_camera(
    path: str | PathLike[str],
    format: str | None,  # noqa: A002 - as of `open_recording`
    depth_scale: float | None,
    sizes: tuple[tuple[int, int], tuple[int, int]],
) -> tuple[str, str] | None:
    """Return the name of a known camera that fits the edges of a recording, and its camera.json; None if none does."""

    def opened(calibration: Calibration, units: float) -> Recording:
        return read_recording(path, format=format, intrinsics=calibration, depth_scale=depth_scale or units)

    found = fitting_camera(opened, *sizes)
    return None if found is None else (found[0].name, camera_text(found[1]))


def _add_known_camera(
    error: UnknownIntrinsicsError,
    path: str | PathLike[str],
    format: str | None,  # noqa: A002
    depth_scale: float | None,
) -> None:
    """Add the known camera that fits the images to the error about unknown intrinsics, or what is to be provided."""
    if error.sizes is None:
        return
    known = _known_camera(path, format, depth_scale, error.sizes)
    if known is not None:
        name, text = known
        error.add_note(f"the edges of depth and color agree for this camera: {name}; if it is yours, write instead:")
        error.add_note(f"  {text}")
    elif error.sizes[0] != error.sizes[1]:
        error.add_note(THREE_THINGS)


def _camera_advice(path: str | PathLike[str], format: str | None, recording: Recording) -> str:  # noqa: A002
    """Return what to write into camera.json for a recording whose depth cannot be registered."""
    size = recording.intrinsics.width, recording.intrinsics.height
    known = _known_camera(path, format, recording.depth_units_per_metre, (size, size))
    if known is None:
        return THREE_THINGS
    return f"its edges agree for this camera: {known[0]}; if it is yours, write into camera.json: {known[1]}"


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
