"""Opens a recording for tracking: depth registered to color, and poses at the times of the frames."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.threads import return_free_memory
from cuboid.inputs.readers import Recording
from cuboid.inputs.readers.recording import PoseClock
from cuboid.inputs.readers.usable import usable_poses
from cuboid.inputs.recordings import opening
from cuboid.inputs.recordings.opening import AUTO, OFF
from cuboid.inputs.recordings.rig import RigRecording
from cuboid.method.poses.clock import MIN_MOTIONS, PoseOffset, misfit_of, pose_offset_of, scale_misfit
from cuboid.method.poses.motions import found_motions, levels_of_frames, telling_frames

# Largest offset that a user may give, milliseconds: beyond it, clocks differ by more than a delay.
MAX_GIVEN_MS = 10_000.0
# Number of frames whose poses are read for the choice of those that are compared, and length of one stretch of them.
CONSIDERED, STRETCH = 1800, 150
# A camera in a hand is slower, metres per second. A recording without times whose camera seems to be faster is not one
# of 30 Hz: poses between its frames are not known.
HAND_SPEED_M_S, SPEED_FRAMES = 0.5, 5


def open_recording(
    path: str | PathLike[str],
    *,
    format: str | None = None,  # noqa: A002 - the flag's own name
    intrinsics: Sequence[float] | str | PathLike[str] | None = None,
    depth_scale: float | None = None,
    register: str = AUTO,
    pose_convention: str | None = None,
    pose_offset: str | float = AUTO,
) -> Recording:
    """Open an RGB-D recording; its format is recognised from its contents.

    Parameters
    ----------
    path : str or path
        A folder, a file, an archive or a URL; or a ``rig.json``, or a folder with one.
    format : str, optional
        Name of the format, if it is not recognised. Options of the format follow a colon, as in
        "ros-bag:color=/camera/color/image_raw".
    intrinsics : sequence of 4 floats or path, optional
        fx, fy, cx, cy in pixels, instead of those in the recording; or a file in the format of ``camera.json``, whose
        depth scale is used too, or of ``camera-intrinsics.txt``.
    depth_scale : float, optional
        Units per metre of the depth images, instead of the format's own.
    register : {"auto", "on", "off"}
        Whether depth is registered to color: "auto" if the frames clearly show a misalignment and the recording names
        no depth camera, "on" also for a small misalignment, "off" never. A registration that two cameras side by side
        cannot have, or that does not fit given poses, is not applied. The check reads some frames, which takes a
        second.
    pose_convention : str, optional
        Convention of the recording's poses, if it differs from the format's: "inverse" (world to camera), "opengl" (the
        camera's y up, z backward), "mm" or "cm" (translations), "wxyz" or "xyzw" (quaternions), or several, as in
        "inverse,mm".
    pose_offset : {"auto", "off"} or float
        What is added to the times of the given poses, milliseconds. "auto": the offset that the images show, if they
        prove one; else nothing. The check reads some frames, which takes a second or two. "off": nothing.

    Returns
    -------
    Recording
        Its `warnings` report a registration and corrected times, or why depth was not registered; `pose_clock` has the
        offset.

    Raises
    ------
    InputError
        There is no recording, or more than one, or it cannot be used; the message is one line with the reason.
    ValueError
        `register` or `pose_offset` is none of these.

    Examples
    --------
    >>> recording = open_recording("rgbd-scenes-v2/imgs/scene_01")  # doctest: +SKIP
    >>> for frame in recording.iterate():  # doctest: +SKIP
    ...     ...
    """
    added_ms = _checked(pose_offset)
    recording = opening.open_recording(
        path,
        format=format,
        intrinsics=intrinsics,
        depth_scale=depth_scale,
        register=register,
        pose_convention=pose_convention,
    )
    if isinstance(recording, RigRecording):
        if added_ms:
            raise InputError(f"{path}: a pose offset is for the recording of one camera, not for a rig")
        return recording
    if added_ms is None:
        return synchronised(recording)
    if not added_ms or not recording.has_poses:
        return recording
    given = recording.with_pose_clock(PoseClock(added_s=1e-3 * added_ms))
    return given.with_warning(f"{added_ms:g} ms are added to the times of the given poses (--pose-offset)")


def synchronised(recording: Recording) -> Recording:
    """Return a recording with the measured clock of its poses, which is corrected if the offset is certain."""
    clock, text = measured_clock(recording)
    recording = recording.with_pose_clock(clock)
    if not clock.added_s:
        return recording
    return recording.with_warning(f"{text}; they are corrected; --pose-offset off leaves them as given")


def checked_clock(recording: Recording) -> tuple[str, dict[str, Any]]:
    """Return what the images show of the clock of a recording's poses: for a user, and for JSON."""
    if not recording.has_poses:
        return "the recording has no poses", {}
    clock, text = measured_clock(recording)
    done = "'cuboid track' corrects them" if clock.added_s else f"not corrected: {clock.doubt}"
    said = f"{text}; {done}" if text else "not measured: the velocity changes too little, or no times, depth or texture"
    return f"{said}; {clock.misfit}" if clock.misfit else said, clock.settings()


def measured_clock(recording: Recording) -> tuple[PoseClock, str]:
    """Return the clock of the given poses of a recording, and the offset in words; empty if there is none."""
    found, misfit = measured(recording)
    if found is None:
        return PoseClock(misfit=misfit or ""), ""
    added_s = 0.0 if found.doubt else found.offset_s
    clock = PoseClock(added_s, found.offset_s, found.error_s, found.doubt, misfit or "")
    return clock, f"the times of the given poses are {found.text}"


def measured(recording: Recording) -> tuple[PoseOffset | None, str | None]:
    """Compare the given poses of a recording with the motion in its images.

    Returns
    -------
    PoseOffset or None
        The offset between the clocks of poses and images; None if the recording does not determine one.
    str or None
        A warning if depth and poses differ in scale, or if the poses fit clearly worse than the images' own motion.
    """
    frames: list[int] = []
    times_s: list[float] = []
    poses: list[Float64Array] = []
    considered = _considered(len(recording)) if recording.has_poses else ()
    for index, T in usable_poses(recording, considered).items():
        time_s = recording.timestamp_s(index)
        if not times_s or time_s > times_s[-1]:
            frames.append(index)
            times_s.append(time_s)
            poses.append(T)
    if len(frames) < MIN_MOTIONS:
        return None, None
    times, T_world_camera = np.array(times_s), np.array(poses)
    triples = telling_frames(times, T_world_camera)
    levels_of = levels_of_frames(recording.without_poses().read, recording.intrinsics)
    motions = found_motions(levels_of, frames, times, T_world_camera, triples)
    found = pose_offset_of(times, T_world_camera, motions)
    return_free_memory()
    misfit = None if found is None else scale_misfit(found)
    if not recording.has_timestamps and _speed_m_s(times, T_world_camera) > HAND_SPEED_M_S:
        return None, misfit
    if misfit is None and (found is None or found.doubt):
        misfit = misfit_of(T_world_camera, motions)
    return found, misfit


def _speed_m_s(times_s: Float64Array, T_world_camera: Float64Array) -> float:
    """Return the median speed of a camera over `SPEED_FRAMES` frames: noise of single poses hardly matters."""
    elapsed_s = times_s[SPEED_FRAMES:] - times_s[:-SPEED_FRAMES]
    moved_m = np.linalg.norm(T_world_camera[SPEED_FRAMES:, :3, 3] - T_world_camera[:-SPEED_FRAMES, :3, 3], axis=1)
    return float(np.median(moved_m / elapsed_s))


def _considered(count: int) -> list[int]:
    """Return the frames of a recording whose poses are read: all, or stretches evenly over it."""
    if count <= CONSIDERED:
        return list(range(count))
    starts = np.linspace(0, count - STRETCH, CONSIDERED // STRETCH).round().astype(int).tolist()
    return [k for start in starts for k in range(start, start + STRETCH)]


def _checked(pose_offset: str | float) -> float | None:
    """Return the offset of a caller, milliseconds; None if it is to be measured."""
    if pose_offset == AUTO:
        return None
    if pose_offset == OFF:
        return 0.0
    if isinstance(pose_offset, str) or not abs(pose_offset) <= MAX_GIVEN_MS:
        raise ValueError(
            f"pose_offset must be '{AUTO}', '{OFF}' or at most {MAX_GIVEN_MS:g} milliseconds, got {shown(pose_offset)}"
        )
    return float(pose_offset)
