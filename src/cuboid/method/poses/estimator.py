"""Estimation of the camera pose of each frame from the frames alone."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.state import Record
from cuboid.ground.geometry import se3
from cuboid.method.poses.alignment import Alignment, Prior, Reference, align
from cuboid.method.poses.atlas import Atlas, AtlasState, FrameFeatures, Place
from cuboid.method.poses.keyframes import NEW_VIEW, OVERLAP_LEVEL, Keyframe
from cuboid.method.poses.moving import MAX_COMPARED, LeftOut, keyframe_without, levels_without, moving_pixels
from cuboid.method.poses.places import describe, locate
from cuboid.method.poses.pyramid import Level, SmallImage, keep, shrink

# View distance of keyframes with given poses, radians: fewer are needed, because only lost frames are aligned to them.
GIVEN_VIEW = 0.3
# Number of overlapping keyframes to which a frame is aligned, and number of frames after which they are chosen again.
LOCAL, CHOOSE_EVERY = 3, 5
# Constant motion is expected; within a thirtieth of a second it changes by about this: metres, radians.
CHANGE_M, CHANGE_RAD = 0.03, np.radians(3.0)
RATE_HZ = 30.0
# After a longer gap than this, seconds, the motion is not extrapolated.
LONGEST_S = 0.5
# An alignment with a better fit than this is not repeated from another start.
SURE_FIT = 0.8
# Poses within this distance count as the same start or result of a search: metres, radians.
SAME_POSE_M, SAME_POSE_RAD = 0.005, 0.005
# A lost camera is first tracked from its last pose for this many frames; then only known places are searched.
MAX_TRACKED_LOST_FRAMES = 3
# Number of known places with which a lost frame is compared.
MAX_COMPARED_PLACES = 4
# A camera lost for this many frames starts a new submap; then it searches known places at this interval of frames.
MAX_LOST_FRAMES, SEARCH_EVERY = 30, 5
# An image with this many corners is good enough for a keyframe.
ENOUGH_CORNERS = 50


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """The estimated pose of a frame.

    Attributes
    ----------
    frame : int
    T_submap_camera : (4, 4) float64 or None
        Pose in the world of the submap's first camera; None while lost.
    covariance : (6, 6) float64 or None
        Covariance of a motion (translation, rotation) of the camera in its own frame relative to the surrounding
        keyframes, metres and radians; None while lost.
    keyframe : int
        Number of the keyframe to which the frame is anchored, -1 while lost.
    is_keyframe : bool
    corrected : bool
        Whether poses of keyframes have changed in this update.
    submap : int
        0 is the world of the first frame; other submaps are not connected with it until they are joined.
    """

    frame: int
    T_submap_camera: Float64Array | None
    covariance: Float64Array | None
    keyframe: int
    is_keyframe: bool
    corrected: bool
    submap: int = 0

    @property
    def T_world_camera(self) -> Float64Array | None:
        """Pose in the world of the first frame's camera, (4, 4); None while lost, and in an unconnected submap."""
        return None if self.submap else self.T_submap_camera


@dataclass(slots=True)
class _Shot:
    """A frame at reduced size; `moving` marks its moving pixels (h, w), None if there are none."""

    index: int
    small: SmallImage
    levels: tuple[Level, ...]
    moving: UInt8Array | None = None
    _features: FrameFeatures | None = None

    @property
    def features(self) -> FrameFeatures:
        """Its levels and appearance, computed on demand."""
        if self._features is None:
            level = self.levels[0]
            self._features = FrameFeatures(self.levels, describe(self.small.gray, level.image[..., 3], level.camera))
        return self._features


@dataclass(frozen=True, slots=True)
class PoseEstimatorState(Record):
    """State of a `PoseEstimator`.

    Attributes
    ----------
    atlas : AtlasState
    anchors : dict of int to (int, (4, 4) float64)
        Keyframe and T_keyframe_camera of each frame.
    submap : int
        Submap of the camera.
    submaps : int
        Number of submaps so far.
    lost : int
        Number of frames since the last frame with a pose.
    elsewhere : bool
        Whether frames at an unknown place may lie outside of submap 0.
    T_world_camera : (4, 4) float64
        Pose of the last frame with a pose.
    motion : (6,) float64
        Motion of the camera frame per second.
    time_s : float
        Time of that frame.
    local : tuple of int
        Keyframes to which frames are aligned.
    """

    atlas: AtlasState
    anchors: dict[int, tuple[int, Float64Array]]
    submap: int
    submaps: int
    lost: int
    elsewhere: bool
    T_world_camera: Float64Array
    motion: Float64Array
    time_s: float
    local: tuple[int, ...]


class PoseEstimator:
    """Estimates the poses of a stream of RGB-D frames of a scene.

    Each frame is aligned to the surrounding keyframes, without the pixels that move (`cuboid.method.poses.moving`). A
    frame with a new view becomes a keyframe, with edges to keyframes that it overlaps and to keyframes of similar
    appearance; the pose graph of these edges corrects all keyframes.

    Parameters
    ----------
    intrinsics : Intrinsics
        Intrinsics of every frame.

    Attributes
    ----------
    left_out : LeftOut
        The moving pixels that were left out, since this estimator was made.
    """

    NOT_SAVED = frozenset({"intrinsics", "left_out", "_reference"})

    def __init__(self, intrinsics: Intrinsics) -> None:
        self.intrinsics = intrinsics
        self.left_out = LeftOut()
        self._atlas = Atlas()
        self._anchors: dict[int, tuple[int, Float64Array]] = {}
        self._submap = 0
        self._submaps = 1
        self._lost = 0
        self._elsewhere = False  # whether frames at an unknown place may lie outside of submap 0
        self._T_world_camera = np.eye(4)
        self._motion = np.zeros(6)  # motion of the camera frame per second
        self._time_s = 0.0
        self._local: list[int] = []
        self._reference = Reference((), 0)

    def state(self) -> PoseEstimatorState:
        """Return the current state; see `Atlas.state`."""
        return PoseEstimatorState(
            self._atlas.state(),
            dict(self._anchors),
            self._submap,
            self._submaps,
            self._lost,
            self._elsewhere,
            self._T_world_camera,
            self._motion,
            self._time_s,
            tuple(self._local),
        )

    @classmethod
    def from_state(cls, state: PoseEstimatorState, intrinsics: Intrinsics) -> PoseEstimator:
        """Return an estimator that continues from a state."""
        estimator = cls(intrinsics)
        estimator._atlas, estimator._anchors = Atlas.from_state(state.atlas), state.anchors
        estimator._submap, estimator._submaps = state.submap, state.submaps
        estimator._lost, estimator._elsewhere = state.lost, state.elsewhere
        estimator._T_world_camera, estimator._motion, estimator._time_s = (
            state.T_world_camera,
            state.motion,
            state.time_s,
        )
        if state.local:
            estimator._align_to(list(state.local))
        return estimator

    @property
    def keyframes(self) -> list[Keyframe]:
        """The keyframes by number, with their corrected poses."""
        return self._atlas.keyframes

    @property
    def loops(self) -> int:
        """Number of places recognised by appearance (loop closures), without relocalisations of a lost camera."""
        return self._atlas.loops

    def trajectory(self) -> dict[int, Float64Array]:
        """Return the corrected T_world_camera (4, 4) of each frame that has one, by frame index."""
        return {frame: T for frame, (submap, T) in self.trajectories().items() if submap == 0}

    def trajectories(self) -> dict[int, tuple[int, Float64Array]]:
        """Return the submap and the corrected pose in it, (4, 4), of each frame that has one, by frame index."""
        found = {}
        for frame, (k, T_keyframe_camera) in sorted(self._anchors.items()):
            keyframe = self.keyframes[k]
            found[frame] = keyframe.submap, se3.tidied(keyframe.T_world_camera @ T_keyframe_camera)
        return found

    def begin_lost(self) -> None:
        """Expect frames of another recording: relocalise them, or else start a new submap at once."""
        self._lost, self._elsewhere = MAX_LOST_FRAMES, True

    def begin_submap(self) -> int:
        """Return the number of a new submap."""
        self._submaps += 1
        return self._submaps - 1

    def take(self, frame: Frame, T_submap_camera: Float64Array, submap: int) -> int | None:
        """Add a frame whose pose is known exactly; return its number if it becomes a keyframe.

        Parameters
        ----------
        frame : Frame
        T_submap_camera : (4, 4) float64
        submap : int
        """
        if self._atlas.view_distance(T_submap_camera, submap) <= GIVEN_VIEW:
            return None
        shot = self._shot(frame)
        if not self._has_depth(shot) or len(shot.features.appearance.corners) < ENOUGH_CORNERS:
            return None
        return self._atlas.add_given(shot.index, T_submap_camera, submap, shot.small, shot.features)

    def anchor_frame(self, frame: int, T_submap_camera: Float64Array, keyframe: int) -> None:
        """Anchor the pose (4, 4) of a frame, added by `take`, to a keyframe."""
        self._anchors[frame] = keyframe, se3.inverse(self.keyframes[keyframe].T_world_camera) @ T_submap_camera

    def find(self, frame: Frame, excluded: Collection[int]) -> Place | None:
        """Search for the place of a frame among all keyframes except the excluded ones, by number."""
        shot = self._shot(frame)
        if not self._has_depth(shot) or len(shot.features.appearance.corners) < ENOUGH_CORNERS:
            return None
        numbers = [k.number for k in self.keyframes if k.number not in excluded]
        return self._atlas.recognise(shot.features, shot.small.camera, numbers, MAX_COMPARED_PLACES)

    def join(self, submap: int, to: int, T_to_submap: Float64Array) -> None:
        """Merge a submap into another one by a transform (4, 4)."""
        self._atlas.join(submap, to, T_to_submap)
        if submap == self._submap:
            self._submap, self._T_world_camera = to, se3.tidied(T_to_submap @ self._T_world_camera)
            if self._local:
                self._align_to(self._local)

    def move(self, numbers: Collection[int], T_new_old: Float64Array) -> None:
        """Move several keyframes by the same motion (4, 4)."""
        for number in numbers:
            keyframe = self.keyframes[number]
            keyframe.T_world_camera = se3.tidied(T_new_old @ keyframe.T_world_camera)

    def _shot(self, frame: Frame) -> _Shot:
        gray, depth_m, camera = shrink(frame, self.intrinsics)
        small = keep(gray, depth_m, camera)
        return _Shot(frame.index, small, small.levels())  # the same levels that a keyframe rebuilds later

    def update(self, frame: Frame) -> PoseEstimate:
        """Estimate the pose of a frame.

        Raises
        ------
        FrameError
            If the frame does not have the size of the intrinsics.
        """
        expected = (self.intrinsics.height, self.intrinsics.width)
        if frame.depth_m.shape != expected:
            raise FrameError(
                f"frame {frame.index} is {frame.depth_m.shape[1]} x {frame.depth_m.shape[0]} pixels, "
                f"expected {expected[1]} x {expected[0]}"
            )
        shot = self._shot(frame)
        if not self.keyframes:
            return self._begin(shot, frame.timestamp_s)
        elapsed_s = self._elapsed(frame.timestamp_s)
        found = self._follow(shot, elapsed_s) if self._lost < MAX_TRACKED_LOST_FRAMES else None
        if found is None:
            return self._search(shot, frame.timestamp_s)
        return self._accept(shot, found, elapsed_s, frame.timestamp_s)

    def _begin(self, shot: _Shot, time_s: float) -> PoseEstimate:
        """Start a submap with a frame, if it shows enough."""
        features = shot.features
        if len(features.appearance.corners) < ENOUGH_CORNERS or not self._has_depth(shot):
            return _lost(shot.index)
        if self.keyframes or self._elsewhere:
            self._submap = self.begin_submap()
        number, _ = self._atlas.add(shot.index, np.eye(4), self._submap, shot.small, features)
        self._set_pose(np.eye(4), time_s)
        self._align_to([number])
        self._anchors[shot.index] = number, np.eye(4)
        return PoseEstimate(shot.index, np.eye(4), np.zeros((6, 6)), number, True, False, self._submap)

    def _has_depth(self, shot: _Shot) -> bool:
        """Return whether more than an eighth of the pixels have readings."""
        depth_m = shot.levels[-1].image[..., 3]
        return int(np.count_nonzero(depth_m)) * 2 > depth_m.size // 4

    def _elapsed(self, time_s: float) -> float:
        """Return the time since the last pose; the nominal frame time if the timestamps are invalid."""
        elapsed_s = time_s - self._time_s
        return elapsed_s if 0 < elapsed_s < np.inf else 1.0 / RATE_HZ

    def _follow(self, shot: _Shot, elapsed_s: float) -> Alignment | None:
        """Align a frame to the surrounding keyframes; of several starting poses the best result counts.

        The first start is the extrapolated motion. If the result is uncertain, the search is repeated from the last
        pose, and from the pose given by corners shared with a keyframe, until two results agree.
        """
        T_last = se3.inverse(self._T_world_camera)
        T_expected = se3.exp(self._motion * elapsed_s) @ T_last if elapsed_s < LONGEST_S else T_last
        change = np.array([CHANGE_M] * 3 + [CHANGE_RAD] * 3) * max(elapsed_s * RATE_HZ, 1.0)
        best: Alignment | None = None
        tried: list[Float64Array] = []
        for T_given in (T_expected, T_last, None):
            T_start = self._from_corners(shot) if T_given is None else T_given
            if T_start is None or any(_same(T_start, T) for T in tried):
                continue  # the same start gives the same result
            tried.append(T_start)
            found = self._align_still(shot, T_start, Prior(T_start, np.diag(change**-2)))
            if not found.reliable:
                continue
            is_confirmed = best is not None and _same(found.T_camera_reference, best.T_camera_reference)
            if best is None or found.fit > best.fit:
                best = found
            if is_confirmed or best.fit > SURE_FIT:
                break
        return best

    def _align_still(self, shot: _Shot, T_start: Float64Array, prior: Prior) -> Alignment:
        """Align a frame to the surrounding keyframes; if pixels move, align it once more without these."""
        found = align(self._reference, shot.levels, T_start, prior)
        shot.moving = self._moving_pixels(shot, se3.inverse(found.T_camera_reference))
        if shot.moving is None:
            return found
        still = levels_without(shot.levels, shot.moving)
        # The second alignment starts at a fine level: the first one has come near.
        return align(self._reference, still, found.T_camera_reference, prior, coarsest=1)

    def _moving_pixels(self, shot: _Shot, T_world_camera: Float64Array) -> UInt8Array | None:
        """Return which pixels of a frame move: first by the surrounding keyframes, then by all that overlap it."""
        if self._moving_by(shot, T_world_camera, self._local) is None:
            return None
        overlapping = self._atlas.overlapping(T_world_camera, shot.levels[OVERLAP_LEVEL], self._submap)
        return self._moving_by(shot, T_world_camera, overlapping[:MAX_COMPARED])

    def _moving_by(self, shot: _Shot, T_world_camera: Float64Array, numbers: list[int]) -> UInt8Array | None:
        keyframes = [self.keyframes[k] for k in numbers]
        return moving_pixels(shot.levels, T_world_camera, [(k.free_space, k.T_world_camera) for k in keyframes])

    def _from_corners(self, shot: _Shot) -> Float64Array | None:
        """Return T_camera_world from the corners shared with the first local keyframe; None if there are too few."""
        keyframe = self.keyframes[self._local[0]]
        T_camera_keyframe = locate(shot.features.appearance, keyframe.appearance, shot.levels[0].camera)
        return None if T_camera_keyframe is None else T_camera_keyframe @ se3.inverse(keyframe.T_world_camera)

    def _search(self, shot: _Shot, time_s: float) -> PoseEstimate:
        """Search for a known place; after `MAX_LOST_FRAMES` without one, start a new submap."""
        self._lost += 1
        if not self._has_depth(shot) or len(shot.features.appearance.corners) < ENOUGH_CORNERS:
            return _lost(shot.index)
        place = self._atlas.recognise(shot.features, shot.small.camera, range(len(self.keyframes)), MAX_COMPARED_PLACES)
        if place is None:
            return self._begin(shot, time_s) if self._lost >= MAX_LOST_FRAMES else _lost(shot.index)
        keyframe = self.keyframes[place.keyframe]
        self._submap = keyframe.submap
        self._set_pose(keyframe.T_world_camera @ place.T_keyframe_camera, time_s)
        self._choose_local(shot)
        return self._estimate(shot.index, place.found, False, False)

    def _accept(self, shot: _Shot, found: Alignment, elapsed_s: float, time_s: float) -> PoseEstimate:
        """Accept a frame's pose; make the frame a keyframe, or do queued work."""
        motion = se3.log(found.T_camera_reference @ self._T_world_camera) / elapsed_s
        self._set_pose(se3.inverse(found.T_camera_reference), time_s)
        self._motion = motion
        if shot.moving is not None:
            self.left_out.add(shot.moving)
        is_keyframe = self._atlas.view_distance(self._T_world_camera, self._submap) > NEW_VIEW and self._has_depth(shot)
        corrected = False
        if is_keyframe:
            shot = _without_moving(shot)
            number, overlapping = self._atlas.add(
                shot.index, self._T_world_camera, self._submap, shot.small, shot.features
            )
            self._align_to([number, *overlapping[: LOCAL - 1]])
        else:
            corrected = self._work(shot)
        return self._estimate(shot.index, found, is_keyframe, corrected)

    def _work(self, shot: _Shot) -> bool:
        """Do a part of the queued work; return whether keyframes have moved."""
        T_anchor_camera = self._T_anchor_camera()
        moved = self._atlas.work()
        if self._submap and shot.index % SEARCH_EVERY == 0:
            others = [k.number for k in self.keyframes if k.submap != self._submap]
            place = self._atlas.recognise(shot.features, shot.small.camera, others, MAX_COMPARED_PLACES)
            if place is not None:
                self._atlas.join_at(place, self._T_world_camera, self._submap)
                moved = True
        if moved:
            anchor = self.keyframes[self._local[0]]
            self._T_world_camera = se3.tidied(anchor.T_world_camera @ T_anchor_camera)
            self._submap = anchor.submap
            self._align_to([k for k in self._local if self.keyframes[k].submap == self._submap])
        elif shot.index % CHOOSE_EVERY == 0:
            self._choose_local(shot)
        return moved

    def _set_pose(self, T_world_camera: Float64Array, time_s: float) -> None:
        self._T_world_camera = T_world_camera
        self._motion = np.zeros(6)
        self._time_s = time_s
        self._lost = 0

    def _choose_local(self, shot: _Shot) -> None:
        chosen = self._atlas.overlapping(self._T_world_camera, shot.levels[OVERLAP_LEVEL], self._submap)[:LOCAL]
        if chosen and chosen != self._local:
            self._align_to(chosen)

    def _align_to(self, local: list[int]) -> None:
        self._local = local
        self._reference = self._atlas.reference(local)

    def _T_anchor_camera(self) -> Float64Array:
        return se3.inverse(self.keyframes[self._local[0]].T_world_camera) @ self._T_world_camera

    def _estimate(self, frame: int, found: Alignment, is_keyframe: bool, corrected: bool) -> PoseEstimate:
        anchor = self._local[0]
        T_anchor_camera = self._T_anchor_camera()
        self._anchors[frame] = anchor, T_anchor_camera
        covariance = found.covariance(float(np.linalg.norm(T_anchor_camera[:3, 3])))
        return PoseEstimate(
            frame, self._T_world_camera.copy(), covariance, anchor, is_keyframe, corrected, self._submap
        )


def _same(T: Float64Array, T_other: Float64Array) -> bool:
    """Return whether two poses are the same within `SAME_POSE_M` and `SAME_POSE_RAD`."""
    away = se3.log(T @ se3.inverse(T_other))
    return bool(np.linalg.norm(away[:3]) < SAME_POSE_M and np.linalg.norm(away[3:]) < SAME_POSE_RAD)


def _without_moving(shot: _Shot) -> _Shot:
    """Return a frame as a keyframe sees it: without readings of moving pixels."""
    if shot.moving is None:
        return shot
    small = keyframe_without(shot.small, shot.moving)
    return _Shot(shot.index, small, small.levels())


def _lost(frame: int) -> PoseEstimate:
    return PoseEstimate(frame, None, None, -1, False, False)
