"""Sources of the camera poses of a run: the recording, the video, or both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, shown
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.pose_convention import advised
from cuboid.ground.geometry.se3 import inverse, tidied, view_shift_m

if TYPE_CHECKING:
    from cuboid.method.poses import PoseEstimator
    from cuboid.method.poses.single_cause import SingleCause

LOST = "the camera is lost: the frame shows no place that is known"
NO_POSE = "the frame has no camera pose"
DRIFT = "the given camera poses drift: from frame {} on"
WITHDRAWN = "the correction of the given camera poses did not hold: from frame {} on they are as given"
# Smallest correction of estimated poses that is applied, voxels: smaller ones have no effect.
MIN_CORRECTION = 0.5
GIVEN, AUTO, CORRECTED, ESTIMATED, SYNCHRONISED = "given", "auto", "corrected", "estimated", "synchronised"
# Values of `--poses` and `Tracker(poses=...)`; the last is for frames of a loop, whose clock nobody has checked.
POSE_SOURCES = (GIVEN, AUTO, CORRECTED, ESTIMATED, SYNCHRONISED)


@dataclass(frozen=True, slots=True)
class Posed:
    """The pose of a frame.

    Attributes
    ----------
    T_world_camera : (4, 4) float64
    anchor : int
        Keyframe to which the pose is anchored; the frame's points move with it.
    moved : mapping of int to (4, 4) float64
        Motion T_new_old of the world around each keyframe that was corrected; empty if there was no correction.
    """

    T_world_camera: Float64Array
    anchor: int = 0
    moved: Mapping[int, Float64Array] = field(default_factory=dict)


class Poses(Protocol):
    """A source of camera poses.

    Attributes
    ----------
    given_with_frames : bool
        Whether frames come with a pose, and a frame without one is skipped.
    origin : {"given", "corrected", "estimated"}
        Name of the source in `run.json`.
    """

    given_with_frames: bool
    origin: str

    def locate(self, frame: Frame) -> Posed:
        """Return the pose of a frame; raises FrameError if it is unknown."""

    def trajectory(self) -> Mapping[int, Float64Array] | None:
        """Return the corrected poses of all frames; None if poses are never corrected."""

    def warnings(self) -> tuple[str, ...]:
        """Return warnings about the poses for the user."""


def given_pose(frame: Frame) -> Float64Array:
    """Return the pose that came with a frame; raises FrameError if it has none."""
    if frame.T_world_camera is None:
        raise FrameError(NO_POSE)
    return frame.T_world_camera


class GivenPoses:
    """The poses of the recording."""

    given_with_frames = True
    origin = GIVEN

    def locate(self, frame: Frame) -> Posed:
        """Return the pose of the frame; raises FrameError if it has none."""
        return Posed(given_pose(frame))

    def trajectory(self) -> None:
        """Return None: poses are never corrected."""
        return

    def warnings(self) -> tuple[str, ...]:
        """Return no warnings: given poses are not checked."""
        return ()


class FixedPoses(GivenPoses):
    """The poses of a camera that stands still: the world is its frame, and poses that came with frames are ignored."""

    given_with_frames = False

    def locate(self, frame: Frame) -> Posed:
        """Return the identity."""
        return Posed(np.eye(4))


class CorrectedPoses:
    """The poses of the recording, corrected online from the frame on at which they have proved to drift.

    Parameters
    ----------
    intrinsics : Intrinsics
        Intrinsics of the frames.
    apply : bool
        Whether to apply the correction; if False, the poses are unchanged and a warning reports their drift.
    """

    given_with_frames = True

    def __init__(self, intrinsics: Intrinsics, *, apply: bool = True) -> None:
        from cuboid.method.poses import DriftCorrection

        self.origin = CORRECTED if apply else GIVEN
        self._drift = DriftCorrection(intrinsics)
        self._apply = apply

    def locate(self, frame: Frame) -> Posed:
        """Return the pose of the frame, corrected if necessary; raises FrameError if it has none."""
        given = given_pose(frame)
        if self._apply:
            return Posed(self._drift.correct(frame, given))
        if self._drift.proven_at is None:
            self._drift.correct(frame, given)
        return Posed(given)

    def trajectory(self) -> None:
        """Return None: poses are final when they are returned."""
        return

    def warnings(self) -> tuple[str, ...]:
        """Return which correction was made."""
        drift = self._drift
        if drift.withdrawn_at is not None:
            return (WITHDRAWN.format(drift.withdrawn_at),)
        if drift.proven_at is None or not self._apply:
            return ()
        by = f"they are aligned to earlier frames, {100.0 * drift.max_shift_m:.0f} cm off at most"
        return (f"{DRIFT.format(drift.proven_at)} {by}", *drift.left_out.warnings())

    @property
    def misfit(self) -> str | None:
        """Why the poses do not fit the frames, unless they are corrected; None if they fit."""
        drift = self._drift
        if drift.cause is not None:
            return _other_cause(drift.cause)
        if drift.proven_at is None or self._apply:
            return None
        return f"{DRIFT.format(drift.proven_at)} they disagree with earlier frames; --poses corrected aligns them"


def _other_cause(cause: SingleCause) -> str:
    """Return the warning for given poses that do not fit for another reason than drift."""
    if cause.convention:
        return advised(cause.convention, "they agree with the frames")
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
    """Poses estimated from the video; those of older frames are corrected later.

    Parameters
    ----------
    intrinsics : Intrinsics
    min_shift_m : float
        Corrections that move nothing by more than this, metres, are withheld until they add up to it.
    """

    given_with_frames = False
    origin = ESTIMATED

    def __init__(self, intrinsics: Intrinsics, min_shift_m: float) -> None:
        from cuboid.method.poses import PoseEstimator

        self._estimator = PoseEstimator(intrinsics)
        self._min_shift_m = min_shift_m
        self._reported: list[Float64Array] = []  # pose of each keyframe, as last reported

    def locate(self, frame: Frame) -> Posed:
        """Return the estimated pose of a frame; raises FrameError while the camera is lost."""
        estimate = self._estimator.update(frame)
        if estimate.T_world_camera is None:
            raise FrameError(LOST)
        return Posed(estimate.T_world_camera, estimate.keyframe, self._moved())

    def trajectory(self) -> Mapping[int, Float64Array]:
        """Return the corrected poses of all frames."""
        return self._estimator.trajectory()

    def warnings(self) -> tuple[str, ...]:
        """Return how many moving pixels were left out; lost frames are reported one by one."""
        return self._estimator.left_out.warnings()

    @property
    def estimator(self) -> PoseEstimator:
        """The estimator of the poses."""
        return self._estimator

    def _moved(self) -> dict[int, Float64Array]:
        """Return the motions of keyframes since the last report; empty if none reaches `min_shift_m`."""
        keyframes = self._estimator.keyframes
        self._reported += [k.T_world_camera for k in keyframes[len(self._reported) :]]
        moved: dict[int, Float64Array] = {}
        farthest_m = 0.0
        for keyframe, before in zip(keyframes, self._reported, strict=True):
            if keyframe.T_world_camera is before or keyframe.submap:
                continue
            farthest_m = max(farthest_m, view_shift_m(keyframe.T_world_camera, before, keyframe.depth_m))
            moved[keyframe.number] = tidied(keyframe.T_world_camera @ inverse(before))
        if farthest_m < self._min_shift_m:
            return {}
        self._reported = [k.T_world_camera for k in keyframes]
        return moved


class BridgedPoses:
    """The poses of the recording; gaps are filled with poses estimated from the video, relative to the last given one.

    Parameters
    ----------
    intrinsics : Intrinsics
    given : callable
        Returns T_world_camera of a frame by its index; raises FrameError if there is none.
    """

    given_with_frames = False
    origin = GIVEN

    def __init__(self, intrinsics: Intrinsics, given: Callable[[int], Float64Array | None]) -> None:
        from cuboid.method.poses import PoseEstimator

        self._estimator = PoseEstimator(intrinsics)
        self._given = given
        self._T_world_estimate: Float64Array | None = None

    def locate(self, frame: Frame) -> Posed:
        """Return the given or the estimated pose; raises FrameError before the first given one and while lost."""
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
        """Return None: the given poses define the world and are not corrected."""
        return

    def warnings(self) -> tuple[str, ...]:
        """Return no warnings: lost frames are reported one by one."""
        return ()


def checked_origin(poses: str) -> str:
    """Return the name of a pose source given by a caller; raises ValueError if it is not one of `POSE_SOURCES`."""
    if poses not in POSE_SOURCES:
        raise ValueError(f"poses must be one of {', '.join(POSE_SOURCES)}, got {shown(poses)}")
    return poses
