"""Estimated poses of a moving rig: the video of its first camera gives them, and the other cameras follow."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.se3 import exp, inverse, log, tidied
from cuboid.method.poses.sources import ESTIMATED, LOST, EstimatedPoses, Posed

# The rig moves on as between the last two frames of its first camera for this time at most, seconds: in 0.1 s a
# hand-held camera changes its velocity.
MAX_AHEAD_S = 0.1


class RigPoses:
    """One pose of a moving rig at a time, from its first camera; a frame in between gets the extrapolated pose.

    Parameters
    ----------
    intrinsics : Intrinsics
        Intrinsics of the first camera.
    T_rig_camera : mapping of str to (4, 4) float64
        Pose of each camera in the rig, by name; the first one is the reference.
    min_shift_m : float
        As for `EstimatedPoses`.
    """

    given_with_frames = False
    origin = ESTIMATED

    def __init__(self, intrinsics: Intrinsics, T_rig_camera: Mapping[str, Float64Array], min_shift_m: float) -> None:
        self._reference = next(iter(T_rig_camera))
        T_reference_rig = inverse(T_rig_camera[self._reference])
        self._T_reference_camera = {name: T_reference_rig @ T for name, T in T_rig_camera.items()}
        self._poses = EstimatedPoses(intrinsics, min_shift_m)
        # The last frame of the reference, and the one before: index, time, pose.
        self._last: tuple[int, float, Posed] | None = None
        self._before: tuple[float, Float64Array] | None = None
        # For each frame of another camera: a frame of the reference, and its pose relative to it.
        self._followed: dict[int, tuple[int, Float64Array]] = {}

    def locate(self, frame: Frame) -> Posed:
        """Return the pose of a frame; raises FrameError while the first camera is lost."""
        if frame.camera_name == self._reference:
            return self._locate_reference(frame)
        if self._last is None or not 0.0 <= frame.timestamp_s - self._last[1] <= MAX_AHEAD_S:
            raise FrameError(LOST)
        index, time_s, posed = self._last
        moved = self._motion_until(frame.timestamp_s, time_s, posed.T_world_camera)
        T_reference_camera = moved @ self._T_reference_camera[frame.camera_name]
        self._followed[frame.index] = index, T_reference_camera
        return Posed(tidied(posed.T_world_camera @ T_reference_camera), posed.anchor)

    def _locate_reference(self, frame: Frame) -> Posed:
        last, self._last = self._last, None  # while it is lost, so are the others
        posed = self._poses.locate(frame)
        # A correction is no motion.
        self._before = None if last is None or posed.moved else (last[1], last[2].T_world_camera)
        self._last = frame.index, frame.timestamp_s, posed
        return posed

    def _motion_until(self, time_s: float, last_s: float, T_world_last: Float64Array) -> Float64Array:
        """Return T_last_now (4, 4): the motion of the reference since its last frame, at constant velocity."""
        if self._before is None or not 0.0 < last_s - self._before[0] <= MAX_AHEAD_S:
            return np.eye(4)
        before_s, T_world_before = self._before
        twist = log(inverse(T_world_before) @ T_world_last)
        return exp(twist * (time_s - last_s) / (last_s - before_s))

    def trajectory(self) -> Mapping[int, Float64Array]:
        """Return the corrected poses of all frames."""
        found = dict(self._poses.trajectory())
        followed = {k: found[index] @ T for k, (index, T) in self._followed.items() if index in found}
        return found | followed

    def warnings(self) -> tuple[str, ...]:
        """Return the warnings of the first camera's poses."""
        return self._poses.warnings()
