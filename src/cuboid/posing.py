"""Where the camera poses of a run come from: the recording, the video, or both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from cuboid.errors import FrameError
from cuboid.frame import Float64Array, Frame, Intrinsics
from cuboid.geometry.se3 import inverse, tidied, transform

if TYPE_CHECKING:
    from cuboid.poses import PoseEstimator

LOST = "the camera is lost: the frame shows no place that is known"
NO_POSE = "the frame has no camera pose"
# Corrections of estimated poses are told from this fraction of a voxel on: what moves by less stays in its voxel.
POSES_MOVE = 0.5


@dataclass(frozen=True, slots=True)
class Posed:
    """Where a frame was taken.

    Attributes
    ----------
    T_world_camera : (4, 4) float64
    anchor : int
        Keyframe that the pose is anchored to; what the frame shows moves with it.
    moved : mapping of int to (4, 4) float64
        For each keyframe how the world around it has moved (T_new_old) where the poses were corrected, else empty.
    """

    T_world_camera: Float64Array
    anchor: int = 0
    moved: Mapping[int, Float64Array] = field(default_factory=dict)


class Poses(Protocol):
    """Tells where frames were taken.

    Attributes
    ----------
    given_with_frames : bool
        Whether the pose comes with the frame and a frame without one is bad.
    """

    given_with_frames: bool

    def locate(self, frame: Frame) -> Posed:
        """Return where a frame was taken; raises FrameError where that is not known."""

    def trajectory(self) -> Mapping[int, Float64Array] | None:
        """Return the poses of all frames as corrected since; None where the first word is the last."""

    def warnings(self) -> tuple[str, ...]:
        """Return what the user should know of the poses."""


class GivenPoses:
    """The recording's own poses."""

    given_with_frames = True

    def locate(self, frame: Frame) -> Posed:
        """Return the frame's own pose; raises FrameError where it has none."""
        if frame.T_world_camera is None:
            raise FrameError(NO_POSE)
        return Posed(frame.T_world_camera)

    def trajectory(self) -> None:
        """Nothing is corrected."""
        return

    def warnings(self) -> tuple[str, ...]:
        """Nothing is known of them."""
        return ()


class SteadiedPoses(GivenPoses):
    """The recording's own poses, corrected as they come where they have proved to drift.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of the frames that come.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        from cuboid.poses import DriftCorrection

        self._drift = DriftCorrection(intrinsics)

    def locate(self, frame: Frame) -> Posed:
        """Return the frame's own pose, corrected; raises FrameError where it has none."""
        given = super().locate(frame).T_world_camera
        return Posed(self._drift.correct(frame, given))

    def warnings(self) -> tuple[str, ...]:
        """Return that the poses drift, where they do."""
        if self._drift.proven_at is None:
            return ()
        return (
            f"the given camera poses drift: from frame {self._drift.proven_at} on they are held to what was seen "
            f"before, {100.0 * self._drift.most_m:.0f} cm off at most",
        )


class EstimatedPoses:
    """Poses estimated from the video; those of older frames are corrected as more is seen.

    Parameters
    ----------
    intrinsics : Intrinsics
    least_m : float
        Corrections that move nothing by more than this, metres, are kept back until they add up.
    """

    given_with_frames = False

    def __init__(self, intrinsics: Intrinsics, least_m: float) -> None:
        from cuboid.poses import PoseEstimator

        self._estimator = PoseEstimator(intrinsics)
        self._least_m = least_m
        self._told: list[Float64Array] = []  # pose of each keyframe as last told

    def locate(self, frame: Frame) -> Posed:
        """Return where a frame was taken; raises FrameError while the camera is lost."""
        estimate = self._estimator.update(frame)
        if estimate.T_world_camera is None:
            raise FrameError(LOST)
        return Posed(estimate.T_world_camera, estimate.keyframe, self._moved())

    def trajectory(self) -> Mapping[int, Float64Array]:
        """Return the poses of all frames as corrected since."""
        return self._estimator.trajectory()

    def warnings(self) -> tuple[str, ...]:
        """Nothing: what is lost is told frame by frame."""
        return ()

    @property
    def estimator(self) -> PoseEstimator:
        """What estimates them."""
        return self._estimator

    def _moved(self) -> dict[int, Float64Array]:
        """Return how keyframes have moved since that was last told, where it is worth telling."""
        keyframes = self._estimator.keyframes
        self._told += [k.T_world_camera for k in keyframes[len(self._told) :]]
        moved: dict[int, Float64Array] = {}
        farthest_m = 0.0
        for keyframe, before in zip(keyframes, self._told, strict=True):
            if keyframe.T_world_camera is before or keyframe.submap:
                continue
            seen = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, keyframe.depth_m]])
            displacement = transform(keyframe.T_world_camera, seen) - transform(before, seen)
            farthest_m = max(farthest_m, float(np.linalg.norm(displacement, axis=1).max()))
            moved[keyframe.number] = tidied(keyframe.T_world_camera @ inverse(before))
        if farthest_m < self._least_m:
            return {}
        self._told = [k.T_world_camera for k in keyframes]
        return moved


class BridgedPoses:
    """The recording's own poses, and where it has none those that the video tells from the last one on.

    Parameters
    ----------
    intrinsics : Intrinsics
    given : callable
        Returns T_world_camera of a frame by its index; raises FrameError where there is none.
    """

    given_with_frames = False

    def __init__(self, intrinsics: Intrinsics, given: Callable[[int], Float64Array | None]) -> None:
        from cuboid.poses import PoseEstimator

        self._estimator = PoseEstimator(intrinsics)
        self._given = given
        self._T_world_estimate: Float64Array | None = None

    def locate(self, frame: Frame) -> Posed:
        """Return the given pose or the bridge; raises FrameError before the first one and while the camera is lost."""
        estimated = self._estimator.update(frame).T_world_camera
        try:
            given = self._given(frame.index)
        except FrameError:
            given = None
        if given is not None:
            self._T_world_estimate = None if estimated is None else tidied(given @ inverse(estimated))
            return Posed(given)
        if estimated is None:
            raise FrameError(LOST)
        if self._T_world_estimate is None:
            raise FrameError(NO_POSE)
        return Posed(tidied(self._T_world_estimate @ estimated))

    def trajectory(self) -> None:
        """Nothing is corrected: the given poses are the world."""
        return

    def warnings(self) -> tuple[str, ...]:
        """Nothing: what is lost is told frame by frame."""
        return ()
