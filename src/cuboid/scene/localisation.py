"""Where the frames of a scene's recordings were taken, in the scene's world; what is not placed yet stands aside.

A recording whose world is not known to be the scene's is localised by its appearance. Until then it is a part of its
own: level as the scene is, but so far aside that nothing of it meets anything else. When it is recognised it is moved
to where it belongs, with all that was found in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cuboid.core.config import TrackerConfig
from cuboid.core.errors import FrameError
from cuboid.core.frame import Float64Array, Frame, Intrinsics
from cuboid.core.state import Record
from cuboid.core.working import thin
from cuboid.geometry.se3 import angle, exp, inverse, mean_motion, tidied, transform
from cuboid.poses.estimator import PoseEstimator, PoseEstimatorState
from cuboid.poses.sources import LOST, NO_POSE, Posed
from cuboid.surfaces.standing import find_flat_areas
from cuboid.surfaces.up import UpVote

# Parts that are not connected stand so far from each other, metres: farther than any room is wide. Voxels reach 10 km.
ASIDE_M = 200.0
# Frames of a new part without a level surface, at most: after that the images' up is used.
MAX_FRAMES_WITHOUT_UP = 30
# Frames of a recording with poses of its own are searched for at this interval, until this many recognised ones agree:
# one alone may be a shift along a wall. Then its keyframes are searched for, until this many were recognised: each has
# an error of a centimetre, and a lever as long as the room.
SEARCH_EVERY, AGREEING, ENOUGH = 5, 2, 12
# Two frames that were recognised agree when each puts the other within this of where it was found: metres, radians.
SAME_M, SAME_RAD = 0.05, 0.05

ESTIMATED, SAME_WORLD, OWN_WORLD = "estimated", "same world", "own world"


@dataclass(frozen=True, slots=True)
class Joined:
    """A part that became part of another one.

    Attributes
    ----------
    middle : (3,) float64
        Where it stood in the world: all within half of `ASIDE_M` of it was its.
    T_new_old : (4, 4) float64
        Transform to where it belongs.
    """

    middle: Float64Array
    T_new_old: Float64Array

    def in_frame(self, T_world_frame: Float64Array) -> Joined:
        """Return the same motion in another frame than the world."""
        T_frame_world = inverse(T_world_frame)
        middle = transform(T_frame_world, self.middle)
        return Joined(middle, T_frame_world @ self.T_new_old @ T_world_frame)

    def contains(self, points: Float64Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Tell which points (N, 3) of the world were the part's."""
        return np.asarray(np.linalg.norm(points - self.middle, axis=1) < ASIDE_M / 2)


@dataclass(frozen=True, slots=True)
class ScenePosesState(Record):
    """State of `ScenePoses`.

    Attributes
    ----------
    config : TrackerConfig
        Configuration at the beginning of the scene; the tracker may have estimated more noise since.
    estimator : PoseEstimatorState
    keyframe_poses : dict of int to (4, 4) float64
        Pose of each keyframe in the world, as the tracker has it.
    T_world_part : dict of int to (4, 4) float64
        Pose of each part of the scene in the world.
    joined : tuple of ((3,) float64, (4, 4) float64)
        Parts that were joined to others and are not processed yet; see `Joined`.
    mode : str
        `ESTIMATED`, `SAME_WORLD` or `OWN_WORLD`: the poses of this recording.
    part : int
        Part of the scene to which this recording belongs, if its poses are in a world of its own.
    T_part_recording : (4, 4) float64
        Pose of its world in that part.
    own : tuple of int
        Its keyframes.
    seen_as : tuple of (int, (4, 4) float64, (4, 4) float64)
        Its recognised frames: part, pose in the part, and pose in the world of the recording.
    aligned : bool
        Whether the pose of its world was found from frames that agree.
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
    """Tells where frames were taken, of all recordings of a scene; frames have the scene's numbers.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of the frames that come.
    config : TrackerConfig
    """

    NOT_SAVED = frozenset({"intrinsics", "_least_m"})

    def __init__(self, intrinsics: Intrinsics, config: TrackerConfig) -> None:
        self.intrinsics, self._config = intrinsics, config
        self._estimator = PoseEstimator(intrinsics)
        self._least_m = 0.5 * config.voxel_m  # what moves by less stays in its voxel
        self._keyframe_poses: dict[int, Float64Array] = {}  # pose in the world, as last reported
        self._T_world_part: dict[int, Float64Array] = {0: np.eye(4)}
        self._joined: list[tuple[Float64Array, Float64Array]] = []
        self.mode = SAME_WORLD
        # For a recording with poses of its own: the part, the pose of its world there, and its keyframes.
        self._part = 0
        self._T_part_recording: Float64Array = np.eye(4)
        self._own: list[int] = []
        # Frames that were recognised: part, pose in it, and pose in the recording's world.
        self._seen_as: list[tuple[int, Float64Array, Float64Array]] = []
        self._aligned = self._recognised = False
        self._last_part = self._waited = 0

    def state(self) -> ScenePosesState:
        """Return the state of now; see `PoseEstimator.state`."""
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
        """Return poses that go on from a state."""
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
        """Expect the frames of a recording; the scene's world is that of the first one.

        Its poses are `ESTIMATED`, or given, in the `SAME_WORLD` or in its `OWN_WORLD`.
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
        """Whether there is anything that frames can be recognised by."""
        return bool(self._estimator.keyframes)

    @property
    def T_world_recording(self) -> Float64Array:
        """Transform from the world of a recording with poses of its own to the scene's, (4, 4)."""
        return tidied(self._T_world_part.get(self._part, np.eye(4)) @ self._T_part_recording)

    @property
    def recognised(self) -> bool:
        """Whether the last frame that has a pose is in the part of the scene that it began with."""
        return self._recognised

    def take(self, frame: Frame) -> None:
        """Take in a frame whose pose is in the scene's world, so that later recordings recognise the place."""
        assert frame.T_world_camera is not None
        number = self._estimator.take(frame, frame.T_world_camera, 0)
        if number is not None:
            self._keyframe_poses[number] = frame.T_world_camera

    def locate(self, frame: Frame, up: Float64Array | None) -> Posed:
        """Return where a frame was taken.

        Parameters
        ----------
        frame : Frame
            With a pose in the recording's own world, unless poses are estimated.
        up : (3,) float64 or None
            Of the scene; None while unknown.

        Raises
        ------
        FrameError
            Nobody knows.
        """
        part, T_part_camera, anchor = self._estimated(frame) if self.mode == ESTIMATED else self._given(frame)
        if part not in self._T_world_part:
            self._T_world_part[part] = self._aside(part, frame, T_part_camera, up)
        self._last_part, self._recognised = part, part == 0
        moved = self._moved()
        return Posed(tidied(self._T_world_part[part] @ T_part_camera), anchor, moved)

    def trajectory(self, first_frame: int) -> Mapping[int, Float64Array] | None:
        """Return T_world_camera of the frames from one on as corrected since; None where they never are."""
        if self.mode == SAME_WORLD:
            return None
        return {
            frame: tidied(self._T_world_part[part] @ T)
            for frame, (part, T) in self._estimator.trajectories().items()
            if frame >= first_frame and part in self._T_world_part
        }

    @property
    def part(self) -> int:
        """The part of the scene that the last frame with a pose is in."""
        return self._last_part

    def stands_in(self, part: int, place: Float64Array) -> bool:
        """Tell whether a place (3,) of the world lies in a part."""
        T = self._T_world_part.get(part)
        return T is not None and bool(Joined(T[:3, 3], T).contains(place[None])[0])

    def connect(self, part: int, T_world_part_now: Float64Array) -> None:
        """Let a part lie where the layout of its objects says: T_new_old in the world."""
        T = T_world_part_now @ self._T_world_part[part]
        self._estimator.join(part, 0, T)
        if self._part == part:
            self._part, self._T_part_recording, self._aligned = 0, tidied(T @ self._T_part_recording), True

    def take_joined(self) -> list[Joined]:
        """Return which parts have become parts of others since the last time."""
        joined, self._joined = self._joined, []
        return [Joined(middle, T) for middle, T in joined]

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
        if due and not (self._aligned and len(self._seen_as) >= ENOUGH):
            self._look_for(frame)
            T_part_camera = tidied(self._T_part_recording @ frame.T_world_camera)
        self._estimator.anchor_frame(frame.index, T_part_camera, self._own[-1])
        return self._part, T_part_camera, self._own[-1]

    def _look_for(self, frame: Frame) -> None:
        """Recognise a frame, and let the recording lie where frames that agree say."""
        assert frame.T_world_camera is not None
        place = self._estimator.find(frame, self._own)
        if place is None:
            return
        known = self._estimator.keyframes[place.keyframe]
        T_known_camera = known.T_world_camera @ place.T_keyframe_camera
        T_known_recording = T_known_camera @ inverse(frame.T_world_camera)
        agreeing = [
            (T, given)
            for part, T, given in self._seen_as
            if part == known.submap and _near(T_known_recording @ given, T)
        ]
        self._seen_as.append((known.submap, T_known_camera, frame.T_world_camera))
        if len(agreeing) < AGREEING - 1:
            return
        T_known, given = (np.array(poses) for poses in zip(*agreeing, self._seen_as[-1][1:], strict=True))
        better = mean_motion(T_known, given)
        if self._part != known.submap:
            self._estimator.join(self._part, known.submap, better @ inverse(self._T_part_recording))
            self._part = known.submap
        else:
            self._estimator.move(self._own, better @ inverse(self._T_part_recording))
        self._T_part_recording, self._aligned = better, True

    def _aside(self, part: int, frame: Frame, T_part_camera: Float64Array, up: Float64Array | None) -> Float64Array:
        """Return where a new part stands: aside, and level."""
        T = np.eye(4)
        beside = np.array([1.0, 0.0, 0.0]) if up is None else np.eye(3)[int(np.argmin(np.abs(up)))]
        if up is not None:
            beside -= up * (up @ beside)
            own = self._up_of(frame, T_part_camera)
            T[:3, :3] = _turn(own, up)
        T[:3, 3] = ASIDE_M * part * beside / np.linalg.norm(beside)
        return T

    def _up_of(self, frame: Frame, T_part_camera: Float64Array) -> Float64Array:
        """Return up in a part's world as a frame shows it; raises FrameError while none does."""
        c, vote = self._config, UpVote()
        image = thin(frame, self.intrinsics, c.working_width_px, 0)
        up = vote.update(find_flat_areas(image.depth, c), T_part_camera, frame.up_camera)
        self._waited += 1
        if up is None and self._waited < MAX_FRAMES_WITHOUT_UP:
            raise FrameError(LOST)
        return vote.image_up if up is None else up

    def _moved(self) -> dict[int, Float64Array]:
        """Return how keyframes have moved since the last report, where it matters."""
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
            seen = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, keyframe.depth_m]])
            farthest_m = max(
                farthest_m, float(np.linalg.norm(transform(T, seen) - transform(before, seen), axis=1).max())
            )
            moved[keyframe.number] = tidied(T @ inverse(before))
        if farthest_m < self._least_m:
            return {}
        self._note_joined(moved)
        self._keyframe_poses = now
        return moved

    def _note_joined(self, moved: Mapping[int, Float64Array]) -> None:
        """Note which parts are no more: all that stood there moves with their keyframes."""
        present = {k.submap for k in self._estimator.keyframes}
        for part in sorted(self._T_world_part.keys() - present - {0}):
            middle = self._T_world_part.pop(part)[:3, 3]
            own = [k for k in moved if np.linalg.norm(self._keyframe_poses[k][:3, 3] - middle) < ASIDE_M / 2]
            if own:
                self._joined.append((middle, moved[own[0]]))


def _near(T: Float64Array, T_other: Float64Array) -> bool:
    away = T @ inverse(T_other)
    return bool(np.linalg.norm(T[:3, 3] - T_other[:3, 3]) < SAME_M and angle(away) < SAME_RAD)


def _turn(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the least rotation (3, 3) from a direction to another."""
    axis, cosine = np.cross(a, b), float(a @ b)
    if np.linalg.norm(axis) < 1e-9:
        axis = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))]) if cosine < 0 else axis
    length = float(np.linalg.norm(axis))
    turned = np.zeros(6) if length == 0 else np.append(np.zeros(3), axis / length * np.arccos(np.clip(cosine, -1, 1)))
    return np.asarray(exp(turned)[:3, :3])
