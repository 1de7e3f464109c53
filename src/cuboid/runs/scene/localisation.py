"""Camera poses of a scene's recordings in the scene's world; recordings not localised yet are placed far away.

If the world of a recording is not known to be the scene's, the recording is localised by appearance. Until then it is a
separate part of the scene: level, but so far away that it overlaps nothing else. Once it is recognised, it is moved to
its true place, with everything that was found in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.state import Record
from cuboid.ground.core.working import thin
from cuboid.ground.geometry.se3 import angle, exp, inverse, mean_motion, tidied, transform, view_shift_m
from cuboid.method.poses.estimator import PoseEstimator, PoseEstimatorState
from cuboid.method.poses.sources import ESTIMATED, LOST, MIN_CORRECTION, NO_POSE, Posed
from cuboid.method.surfaces.standing import find_flat_areas
from cuboid.method.surfaces.up import UpVote

# Distance between unconnected parts, metres: more than the width of any room. Voxel indices reach 10 km.
ASIDE_M = 200.0
# Maximum number of frames of a new part without a level surface; after them the up direction of the images is used.
MAX_FRAMES_WITHOUT_UP = 30
# A recording with its own poses: place recognition runs every SEARCH_EVERY frames until AGREEING recognised frames
# agree (a single one may be shifted along a wall), then for its keyframes until ENOUGH_KNOWN are recognised: each
# has an error of a centimetre, with a lever arm as long as the room.
SEARCH_EVERY, AGREEING, ENOUGH_KNOWN = 5, 2, 12
# Two recognised frames agree if each predicts the pose of the other within these tolerances, metres and radians.
SAME_M, SAME_RAD = 0.05, 0.05

SAME_WORLD, OWN_WORLD = "same world", "own world"


@dataclass(frozen=True, slots=True)
class JoinedPart:
    """A part of the scene that was joined to another one.

    Attributes
    ----------
    middle : (3,) float64
        Old position of the part in the world: everything within half of `ASIDE_M` belonged to it.
    T_new_old : (4, 4) float64
        Transform to its new place.
    """

    middle: Float64Array
    T_new_old: Float64Array

    def in_frame(self, T_world_frame: Float64Array) -> JoinedPart:
        """Return the same motion, expressed in another coordinate frame than the world."""
        T_frame_world = inverse(T_world_frame)
        middle = transform(T_frame_world, self.middle)
        return JoinedPart(middle, T_frame_world @ self.T_new_old @ T_world_frame)

    def contains(self, points: Float64Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return which points (N, 3) of the world belonged to the part."""
        return np.asarray(np.linalg.norm(points - self.middle, axis=1) < ASIDE_M / 2)


@dataclass(frozen=True, slots=True)
class ScenePosesState(Record):
    """State of `ScenePoses`.

    Attributes
    ----------
    config : TrackerConfig
        Configuration at the beginning of the scene; the tracker may have raised the noise estimate since.
    estimator : PoseEstimatorState
    keyframe_poses : dict of int to (4, 4) float64
        Pose of each keyframe in the world, as last given to the tracker.
    T_world_part : dict of int to (4, 4) float64
        Pose of each part of the scene in the world.
    joined : tuple of ((3,) float64, (4, 4) float64)
        Parts that were joined to others and are not processed yet; see `JoinedPart`.
    mode : str
        Kind of this recording's poses: `ESTIMATED`, `SAME_WORLD` or `OWN_WORLD`.
    part : int
        Part of the scene to which this recording belongs, if its poses are in its own world.
    T_part_recording : (4, 4) float64
        Pose of the recording's world in that part.
    own : tuple of int
        Numbers of the recording's keyframes.
    seen_as : tuple of (int, (4, 4) float64, (4, 4) float64)
        Recognised frames: part, pose in the part, and pose in the world of the recording.
    aligned : bool
        Whether the pose of the recording's world was found from frames that agree.
    recognised : bool
        Whether the last frame with a pose is in part 0.
    last_part : int
        Part of the last frame with a pose.
    waited : int
        Number of frames in new parts without a level surface.
    """

    config: TrackerConfig
    estimator: PoseEstimatorState
    keyframe_poses: dict[int, Float64Array]
    T_world_part: dict[int, Float64Array]
    joined: tuple[tuple[Float64Array, Float64Array], ...]
    mode: str
    part: int
    T_part_recording: Float64Array
    own: tuple[int, ...]
    seen_as: tuple[tuple[int, Float64Array, Float64Array], ...]
    aligned: bool
    recognised: bool
    last_part: int
    waited: int


class ScenePoses:
    """Camera poses of the frames of all recordings of a scene; frames have the scene's numbers.

    Parameters
    ----------
    intrinsics : Intrinsics
        Intrinsics of new frames.
    config : TrackerConfig
    """

    NOT_SAVED = frozenset({"intrinsics", "_min_shift_m"})

    def __init__(self, intrinsics: Intrinsics, config: TrackerConfig) -> None:
        self.intrinsics, self._config = intrinsics, config
        self._estimator = PoseEstimator(intrinsics)
        self._min_shift_m = MIN_CORRECTION * config.voxel_m
        self._keyframe_poses: dict[int, Float64Array] = {}  # pose in the world, as last reported
        self._T_world_part: dict[int, Float64Array] = {0: np.eye(4)}
        self._joined: list[tuple[Float64Array, Float64Array]] = []
        self.mode = SAME_WORLD
        # For a recording with its own poses: the part, the pose of the recording's world in it, and its keyframes.
        self._part = 0
        self._T_part_recording: Float64Array = np.eye(4)
        self._own: list[int] = []
        # Recognised frames: part, pose in the part, and pose in the recording's world.
        self._seen_as: list[tuple[int, Float64Array, Float64Array]] = []
        self._aligned = self._recognised = False
        self._last_part = self._waited = 0

    def state(self) -> ScenePosesState:
        """Return the current state; see `PoseEstimator.state`."""
        return ScenePosesState(
            config=self._config,
            estimator=self._estimator.state(),
            keyframe_poses=dict(self._keyframe_poses),
            T_world_part=dict(self._T_world_part),
            joined=tuple(self._joined),
            mode=self.mode,
            part=self._part,
            T_part_recording=self._T_part_recording,
            own=tuple(self._own),
            seen_as=tuple(self._seen_as),
            aligned=self._aligned,
            recognised=self._recognised,
            last_part=self._last_part,
            waited=self._waited,
        )

    @classmethod
    def from_state(cls, state: ScenePosesState, intrinsics: Intrinsics) -> ScenePoses:
        """Return poses that continue from a state."""
        poses = cls(intrinsics, state.config)
        poses._estimator = PoseEstimator.from_state(state.estimator, intrinsics)
        poses._keyframe_poses, poses._T_world_part = state.keyframe_poses, state.T_world_part
        poses._joined = list(state.joined)
        poses.mode, poses._part, poses._T_part_recording = state.mode, state.part, state.T_part_recording
        poses._own, poses._seen_as = list(state.own), list(state.seen_as)
        poses._aligned, poses._recognised = state.aligned, state.recognised
        poses._last_part, poses._waited = state.last_part, state.waited
        return poses

    def begin(self, mode: str, *, first: bool) -> None:
        """Begin a recording; the first recording defines the scene's world.

        Its poses are `ESTIMATED`, or given: in the `SAME_WORLD` as the scene or in its `OWN_WORLD`.
        """
        self.mode = SAME_WORLD if first and mode == OWN_WORLD else mode
        self._own, self._seen_as, self._aligned, self._waited = [], [], False, 0
        self._part, self._T_part_recording = 0, np.eye(4)
        self._recognised = first or mode == SAME_WORLD
        if not first and mode == ESTIMATED:
            self._estimator.begin_lost()
        elif not first and mode == OWN_WORLD:
            self._part = self._estimator.begin_submap()

    @property
    def knows_places(self) -> bool:
        """Whether there are keyframes for place recognition."""
        return bool(self._estimator.keyframes)

    @property
    def T_world_recording(self) -> Float64Array:
        """Transform (4, 4) from the world of a recording with its own poses to the scene's world."""
        return tidied(self._T_world_part.get(self._part, np.eye(4)) @ self._T_part_recording)

    @property
    def recognised(self) -> bool:
        """Whether the last frame with a pose is in part 0, with which the scene began."""
        return self._recognised

    def take(self, frame: Frame) -> None:
        """Add a frame with a pose in the scene's world, so that later recordings recognise the place."""
        assert frame.T_world_camera is not None
        number = self._estimator.take(frame, frame.T_world_camera, 0)
        if number is not None:
            self._keyframe_poses[number] = frame.T_world_camera

    def locate(self, frame: Frame, up: Float64Array | None) -> Posed:
        """Return the camera pose of a frame in the scene's world.

        Parameters
        ----------
        frame : Frame
            With a pose in the recording's own world, unless poses are estimated.
        up : (3,) float64 or None
            Up direction of the scene; None while unknown.

        Raises
        ------
        FrameError
            The pose is unknown.
        """
        part, T_part_camera, anchor = self._estimated(frame) if self.mode == ESTIMATED else self._given(frame)
        if part not in self._T_world_part:
            self._T_world_part[part] = self._place_aside(part, frame, T_part_camera, up)
        self._last_part, self._recognised = part, part == 0
        moved = self._moved()
        return Posed(tidied(self._T_world_part[part] @ T_part_camera), anchor, moved)

    def trajectory(self, first_frame: int) -> Mapping[int, Float64Array] | None:
        """Return the corrected T_world_camera from a frame on; None if poses are never corrected."""
        if self.mode == SAME_WORLD:
            return None
        return {
            frame: tidied(self._T_world_part[part] @ T)
            for frame, (part, T) in self._estimator.trajectories().items()
            if frame >= first_frame and part in self._T_world_part
        }

    @property
    def part(self) -> int:
        """The part of the scene that contains the last frame with a pose."""
        return self._last_part

    def stands_in(self, part: int, place: Float64Array) -> bool:
        """Return whether a place (3,) of the world lies in a part."""
        T = self._T_world_part.get(part)
        return T is not None and bool(JoinedPart(T[:3, 3], T).contains(place[None])[0])

    def connect(self, part: int, T_world_part_now: Float64Array) -> None:
        """Join a part to part 0 by the motion that the object layout gives: T_new_old in the world."""
        T = T_world_part_now @ self._T_world_part[part]
        self._estimator.join(part, 0, T)
        if self._part == part:
            self._part, self._T_part_recording, self._aligned = 0, tidied(T @ self._T_part_recording), True

    def take_joined(self) -> list[JoinedPart]:
        """Return the parts that were joined to others since the last call."""
        joined, self._joined = self._joined, []
        return [JoinedPart(middle, T) for middle, T in joined]

    def _estimated(self, frame: Frame) -> tuple[int, Float64Array, int]:
        estimate = self._estimator.update(frame)
        if estimate.T_submap_camera is None:
            raise FrameError(LOST)
        return estimate.submap, estimate.T_submap_camera, estimate.keyframe

    def _given(self, frame: Frame) -> tuple[int, Float64Array, int]:
        if frame.T_world_camera is None:
            raise FrameError(NO_POSE)
        T_part_camera = tidied(self._T_part_recording @ frame.T_world_camera)
        number = self._estimator.take(frame, T_part_camera, self._part)
        self._own += [] if number is None else [number]
        if not self._own:
            raise FrameError(LOST)
        due = number is not None or (not self._aligned and frame.index % SEARCH_EVERY == 0)
        if due and not (self._aligned and len(self._seen_as) >= ENOUGH_KNOWN):
            self._recognise(frame)
            T_part_camera = tidied(self._T_part_recording @ frame.T_world_camera)
        self._estimator.anchor_frame(frame.index, T_part_camera, self._own[-1])
        return self._part, T_part_camera, self._own[-1]

    def _recognise(self, frame: Frame) -> None:
        """Try to recognise a frame; place the recording by the recognised frames that agree."""
        assert frame.T_world_camera is not None
        place = self._estimator.find(frame, self._own)
        if place is None:
            return
        keyframe = self._estimator.keyframes[place.keyframe]
        T_submap_camera = keyframe.T_world_camera @ place.T_keyframe_camera
        T_submap_recording = T_submap_camera @ inverse(frame.T_world_camera)
        agreeing = [
            (T, given)
            for part, T, given in self._seen_as
            if part == keyframe.submap and _near(T_submap_recording @ given, T)
        ]
        self._seen_as.append((keyframe.submap, T_submap_camera, frame.T_world_camera))
        if len(agreeing) < AGREEING - 1:
            return
        T_submap_cameras, given = (np.array(poses) for poses in zip(*agreeing, self._seen_as[-1][1:], strict=True))
        T_part_recording = mean_motion(T_submap_cameras, given)
        if self._part != keyframe.submap:
            self._estimator.join(self._part, keyframe.submap, T_part_recording @ inverse(self._T_part_recording))
            self._part = keyframe.submap
        else:
            self._estimator.move(self._own, T_part_recording @ inverse(self._T_part_recording))
        self._T_part_recording, self._aligned = T_part_recording, True

    def _place_aside(
        self, part: int, frame: Frame, T_part_camera: Float64Array, up: Float64Array | None
    ) -> Float64Array:
        """Return T_world_part of a new part: far from the others, and level."""
        T = np.eye(4)
        direction = np.array([1.0, 0.0, 0.0]) if up is None else np.eye(3)[int(np.argmin(np.abs(up)))]
        if up is not None:
            direction -= up * (up @ direction)
            part_up = self._up_of(frame, T_part_camera)
            T[:3, :3] = _turn(part_up, up)
        T[:3, 3] = ASIDE_M * part * direction / np.linalg.norm(direction)
        return T

    def _up_of(self, frame: Frame, T_part_camera: Float64Array) -> Float64Array:
        """Return up in a part's world from a frame; raise FrameError while no frame shows it."""
        c, vote = self._config, UpVote()
        image = thin(frame, self.intrinsics, c.working_width_px, 0)
        up = vote.update(find_flat_areas(image.depth, c), T_part_camera, frame.up_camera)
        self._waited += 1
        if up is None and self._waited < MAX_FRAMES_WITHOUT_UP:
            raise FrameError(LOST)
        return vote.image_up if up is None else up

    def _moved(self) -> dict[int, Float64Array]:
        """Return the motion of keyframes since the last report; empty if it is below half a voxel."""
        moved: dict[int, Float64Array] = {}
        now: dict[int, Float64Array] = {}
        farthest_m = 0.0
        for keyframe in self._estimator.keyframes:
            if keyframe.submap not in self._T_world_part:
                continue
            T = self._T_world_part[keyframe.submap] @ keyframe.T_world_camera
            before = self._keyframe_poses.setdefault(keyframe.number, T)
            now[keyframe.number] = T
            if np.array_equal(before, T):
                continue
            farthest_m = max(farthest_m, view_shift_m(T, before, keyframe.depth_m))
            moved[keyframe.number] = tidied(T @ inverse(before))
        if farthest_m < self._min_shift_m:
            return {}
        self._note_joined(moved)
        self._keyframe_poses = now
        return moved

    def _note_joined(self, moved: Mapping[int, Float64Array]) -> None:
        """Record parts that no longer exist: their contents move with their keyframes."""
        present = {k.submap for k in self._estimator.keyframes}
        for part in sorted(self._T_world_part.keys() - present - {0}):
            middle = self._T_world_part.pop(part)[:3, 3]
            keyframes = [k for k in moved if np.linalg.norm(self._keyframe_poses[k][:3, 3] - middle) < ASIDE_M / 2]
            if keyframes:
                self._joined.append((middle, moved[keyframes[0]]))


def _near(T: Float64Array, T_other: Float64Array) -> bool:
    away = T @ inverse(T_other)
    return bool(np.linalg.norm(T[:3, 3] - T_other[:3, 3]) < SAME_M and angle(away) < SAME_RAD)


def _turn(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the smallest rotation (3, 3) that turns one direction into another."""
    axis, cosine = np.cross(a, b), float(a @ b)
    if np.linalg.norm(axis) < 1e-9:
        axis = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))]) if cosine < 0 else axis
    length = float(np.linalg.norm(axis))
    turned = np.zeros(6) if length == 0 else np.append(np.zeros(3), axis / length * np.arccos(np.clip(cosine, -1, 1)))
    return np.asarray(exp(turned)[:3, :3])
