"""Where the camera poses of a run come from: the recording, the video, or both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from cuboid.core.errors import FrameError, shown
from cuboid.core.frame import Float64Array, Frame, Intrinsics
from cuboid.geometry.se3 import inverse, tidied, transform

if TYPE_CHECKING:
    from cuboid.poses import PoseEstimator
    from cuboid.poses.single_cause import SingleCause

LOST = "the camera is lost: the frame shows no place that is known"
NO_POSE = "the frame has no camera pose"
TAKEN_BACK = "the correction of the given camera poses did not hold: from frame {} on they are as given"
# Corrections of estimated poses are applied from this fraction of a voxel on: smaller ones stay within a voxel.
POSES_MOVE = 0.5
GIVEN, AUTO, CORRECTED, ESTIMATED = "given", "auto", "corrected", "estimated"
# Values of `--poses` and `Tracker(poses=...)`.
POSE_SOURCES = (GIVEN, AUTO, CORRECTED, ESTIMATED)


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
    origin : {"given", "corrected", "estimated"}
        What `run.json` calls them.
    """

    given_with_frames: bool
    origin: str

    def locate(self, frame: Frame) -> Posed:
        """Return where a frame was taken; raises FrameError where that is not known."""

    def trajectory(self) -> Mapping[int, Float64Array] | None:
        """Return the poses of all frames as corrected since; None where the first word is the last."""

    def warnings(self) -> tuple[str, ...]:
        """Return what the user should know of the poses."""


def given_pose(frame: Frame) -> Float64Array:
    """Return the pose that a frame came with; raises FrameError where it has none."""
    if frame.T_world_camera is None:
        raise FrameError(NO_POSE)
    return frame.T_world_camera


class GivenPoses:
    """The recording's own poses."""

    given_with_frames = True
    origin = GIVEN

    def locate(self, frame: Frame) -> Posed:
        """Return the frame's own pose; raises FrameError where it has none."""
        return Posed(given_pose(frame))

    def trajectory(self) -> None:
        """Nothing is corrected."""
        return

    def warnings(self) -> tuple[str, ...]:
        """Nothing is known of them."""
        return ()


class CorrectedPoses:
    """The recording's own poses, corrected as they come from the frame on at which they have proved to drift.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of the frames that come.
    apply : bool
        Whether the correction is applied; else the poses stay as they are, and a warning says that they drift.
    """

    given_with_frames = True

    def __init__(self, intrinsics: Intrinsics, *, apply: bool = True) -> None:
        from cuboid.poses import DriftCorrection

        self.origin = CORRECTED if apply else GIVEN
        self._drift = DriftCorrection(intrinsics)
        self._apply = apply

    def locate(self, frame: Frame) -> Posed:
        """Return the frame's own pose, corrected where that applies; raises FrameError where it has none."""
        given = given_pose(frame)
        if self._apply:
            return Posed(self._drift.correct(frame, given))
        if self._drift.proven_at is None:
            self._drift.correct(frame, given)
        return Posed(given)

    def trajectory(self) -> None:
        """Poses are final when they are given."""
        return

    def warnings(self) -> tuple[str, ...]:
        """Return why the poses do not fit the frames, and what was done about it."""
        drift = self._drift
        if drift.proven_at is not None:
            since = f"the given camera poses drift: from frame {drift.proven_at} on "
            if not self._apply:
                return (f"{since}they disagree with earlier frames; --poses corrected aligns them",)
            return (f"{since}they are aligned to earlier frames, {100.0 * drift.most_m:.0f} cm off at most",)
        taken_back = () if drift.taken_back_at is None else (TAKEN_BACK.format(drift.taken_back_at),)
        return (*taken_back, *(() if drift.cause is None else (_other_cause(drift.cause),)))


def _other_cause(cause: SingleCause) -> str:
    """Return why given poses misfit, where it is not drift."""
    if cause.scale is None:
        return (
            "the given camera poses do not fit the frames, everywhere alike: they may be those of another sensor than "
            "the camera, or the depth is not registered to the color (--register)"
        )
    return (
        f"depth and given camera poses differ in scale: the depth is {cause.scale:.2f} times what the poses say; "
        f"--depth-scale with {cause.scale:.2f} times its value, if the depth is wrong"
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
    origin = ESTIMATED

    def __init__(self, intrinsics: Intrinsics, least_m: float) -> None:
        from cuboid.poses import PoseEstimator

        self._estimator = PoseEstimator(intrinsics)
        self._least_m = least_m
        self._reported: list[Float64Array] = []  # pose of each keyframe, as last reported

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
        """No warnings: lost frames are reported one by one."""
        return ()

    @property
    def estimator(self) -> PoseEstimator:
        """The estimator of the poses."""
        return self._estimator

    def _moved(self) -> dict[int, Float64Array]:
        """Return how keyframes have moved since the last report, where it matters."""
        keyframes = self._estimator.keyframes
        self._reported += [k.T_world_camera for k in keyframes[len(self._reported) :]]
        moved: dict[int, Float64Array] = {}
        farthest_m = 0.0
        for keyframe, before in zip(keyframes, self._reported, strict=True):
            if keyframe.T_world_camera is before or keyframe.submap:
                continue
            seen = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, keyframe.depth_m]])
            displacement = transform(keyframe.T_world_camera, seen) - transform(before, seen)
            farthest_m = max(farthest_m, float(np.linalg.norm(displacement, axis=1).max()))
            moved[keyframe.number] = tidied(keyframe.T_world_camera @ inverse(before))
        if farthest_m < self._least_m:
            return {}
        self._reported = [k.T_world_camera for k in keyframes]
        return moved


class BridgedPoses:
    """The recording's own poses, and where it has none those that are estimated from the video, from the last one on.

    Parameters
    ----------
    intrinsics : Intrinsics
    given : callable
        Returns T_world_camera of a frame by its index; raises FrameError where there is none.
    """

    given_with_frames = False
    origin = GIVEN

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
        """No warnings: lost frames are reported one by one."""
        return ()


def checked_origin(poses: str) -> str:
    """Return where poses come from as a caller said it; raises ValueError where that is none of `POSE_SOURCES`."""
    if poses not in POSE_SOURCES:
        raise ValueError(f"poses must be one of {', '.join(POSE_SOURCES)}, got {shown(poses)}")
    return poses


def source_of_poses(poses: str, intrinsics: Intrinsics, voxel_m: float) -> Poses:
    """Return the source of poses that one of `POSE_SOURCES` names.

    Parameters
    ----------
    poses : str
    intrinsics : Intrinsics
        Pinhole of the frames that it will be asked about.
    voxel_m : float
        Side of a voxel of the map.
    """
    if poses == ESTIMATED:
        return EstimatedPoses(intrinsics, POSES_MOVE * voxel_m)
    return GivenPoses() if poses == GIVEN else CorrectedPoses(intrinsics, apply=poses == CORRECTED)
