"""The poses of a camera from what it sees: one frame in, where it was taken out."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from cuboid.frame import Float64Array, Frame, Intrinsics
from cuboid.geometry import se3
from cuboid.poses.alignment import Alignment, Prior, Reference, align, merge, pick
from cuboid.poses.graph import Edge, deviations, optimise
from cuboid.poses.keyframes import OVERLAP_LEVEL, Keyframe, median_depth_m, nearest, overlap
from cuboid.poses.pyramid import Level, build_levels, keep, shrink

# A frame becomes a keyframe when its view differs by this much from those of all keyframes, radians.
NEW_VIEW = 0.17
# A frame is aligned to so many keyframes at once: those that overlap it most.
LOCAL = 4
LEAST_OVERLAP = 0.3
# A motion is expected to go on; it may change by this much a frame: metres, radians.
PRIOR = np.diag([0.03**-2] * 3 + [np.radians(3.0) ** -2] * 3)
# An alignment holds when the readings lie on the surfaces, and the intensities are alike.
LEAST_AGREEING, LEAST_LIKENESS = 0.6, 0.6
# What an alignment of two keyframes leaves in doubt beside its own noise: metres for each metre of depth, radians.
EDGE_M, EDGE_RAD = 0.002, 0.0015
# Alignments count neighbouring pixels, whose errors are alike, as independent: so many are worth one.
ALIKE = 50.0
# A keyframe is tied to so many others.
TIES = 4
# The poses of the keyframes are found anew when a new measurement is this many deviations from them.
WORTH_IT = 0.3


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """Where a frame was taken.

    Attributes
    ----------
    frame : int
    T_world_camera : (4, 4) float64 or None
        In the world of the first frame's camera; None while lost.
    covariance : (6, 6) float64 or None
        Of a motion (translation, rotation) of the camera in its own frame, metres and radians.
    keyframe : int
        Number of the keyframe that the frame is anchored at, -1 while lost.
    is_keyframe : bool
    corrected : bool
        Whether poses of keyframes have changed with this frame.
    """

    frame: int
    T_world_camera: Float64Array | None
    covariance: Float64Array | None
    keyframe: int
    is_keyframe: bool
    corrected: bool


class PoseEstimator:
    """Estimates the poses of a stream of RGB-D frames.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of every frame.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self.intrinsics = intrinsics
        self.keyframes: list[Keyframe] = []
        self.edges: list[Edge] = []
        self._anchors: dict[int, tuple[int, Float64Array]] = {}
        self._T_world_camera = np.eye(4)
        self._motion = np.zeros(6)
        self._last_frame = -1
        self._local: list[int] = []
        self._reference: Reference | None = None
        self._queue: deque[tuple[int, int]] = deque()
        self.debug: dict = {}

    def update(self, frame: Frame) -> PoseEstimate:
        small = shrink(frame, self.intrinsics)
        levels = build_levels(*small)
        if not self.keyframes:
            self._add_keyframe(frame.index, np.eye(4), small, levels)
            self._last_frame = frame.index
            return PoseEstimate(frame.index, np.eye(4), np.zeros((6, 6)), 0, True, False)
        steps = frame.index - self._last_frame
        T_expected = se3.exp(self._motion * steps) @ se3.inverse(self._T_world_camera)
        found = align(self._reference, levels, T_expected, Prior(T_expected, PRIOR / steps))
        self.debug = dict(a=found.agreeing, l=found.likeness, v=found.in_view, n=len(self._local))
        if found.agreeing < LEAST_AGREEING or found.likeness < LEAST_LIKENESS:
            return PoseEstimate(frame.index, None, None, -1, False, False)
        T_world_camera = se3.inverse(found.T_camera_reference)
        self._motion = se3.log(found.T_camera_reference @ self._T_world_camera) / steps
        self._T_world_camera = T_world_camera
        self._last_frame = frame.index
        is_keyframe = nearest(self.keyframes, T_world_camera) > NEW_VIEW
        corrected = False
        if is_keyframe:
            self._add_keyframe(frame.index, T_world_camera, small, levels)
        elif self._queue:
            self._tie(*self._queue.popleft())
            if not self._queue:
                corrected = self._settle()
        if not is_keyframe and frame.index % 5 == 0:
            self._choose_local(levels)
        anchor = self._local[0]
        self._anchors[frame.index] = anchor, se3.inverse(self.keyframes[anchor].T_world_camera) @ self._T_world_camera
        return PoseEstimate(frame.index, self._T_world_camera, covariance(found, 0), anchor, is_keyframe, corrected)

    def _add_keyframe(self, index, T_world_camera, small, levels) -> None:
        number = len(self.keyframes)
        reference = pick(levels)
        new = Keyframe(number, index, T_world_camera, keep(*small), reference, median_depth_m(reference))
        shares = self._overlaps(T_world_camera, levels)
        self.keyframes.append(new)
        for k in shares[:TIES]:
            self._queue.append((k, number))
        self._use([number, *shares[: LOCAL - 1]])
        self._anchors[index] = number, np.eye(4)

    def _overlaps(self, T_world_camera, levels) -> list[int]:
        shares = [overlap(k, T_world_camera, levels[OVERLAP_LEVEL]) for k in self.keyframes]
        order = np.argsort(-np.array(shares), kind="stable")
        return [int(k) for k in order if shares[k] > LEAST_OVERLAP]

    def _choose_local(self, levels) -> None:
        chosen = self._overlaps(self._T_world_camera, levels)[:LOCAL]
        if chosen and chosen != self._local:
            self._use(chosen)

    def _use(self, local: list[int]) -> None:
        self._local = local
        used = [self.keyframes[k] for k in local]
        self._reference = merge([k.reference for k in used], [k.T_world_camera for k in used])

    def _tie(self, a: int, b: int) -> None:
        one, two = self.keyframes[a], self.keyframes[b]
        T = se3.inverse(two.T_world_camera) @ one.T_world_camera
        there = align(one.reference, two.small.levels(), T, coarsest=1)
        back = align(two.reference, one.small.levels(), se3.inverse(T), coarsest=1)
        apart = se3.log(there.T_camera_reference @ back.T_camera_reference)
        for i, j, found in ((a, b, there), (b, a, back)):
            if found.agreeing < LEAST_AGREEING or found.likeness < LEAST_LIKENESS:
                continue
            if np.linalg.norm(apart[:3]) > 0.03 or np.linalg.norm(apart[3:]) > 0.03:
                continue
            information = np.linalg.inv(covariance(found, self.keyframes[i].depth_m))
            self.edges.append(Edge(i, j, se3.inverse(found.T_camera_reference), information))

    def _settle(self) -> bool:
        poses = [k.T_world_camera for k in self.keyframes]
        new = [e for e in self.edges if max(e.a, e.b) == len(self.keyframes) - 1]
        if not any(deviations(e, poses) > WORTH_IT for e in new):
            return False
        anchor = self._local[0]
        T_anchor_camera = se3.inverse(poses[anchor]) @ self._T_world_camera
        for k, T in zip(self.keyframes, optimise(poses, self.edges), strict=True):
            k.T_world_camera = T
        self._T_world_camera = self.keyframes[anchor].T_world_camera @ T_anchor_camera
        self._use(self._local)
        return True

    def trajectory(self) -> dict[int, Float64Array]:
        return {i: self.keyframes[k].T_world_camera @ T for i, (k, T) in self._anchors.items()}


def covariance(found: Alignment, depth_m: float) -> Float64Array:
    noise = np.linalg.inv(found.information + 1e-3 * np.eye(6)) * ALIKE
    floor = np.diag([(EDGE_M * depth_m) ** 2] * 3 + [EDGE_RAD**2] * 3)
    return noise + floor
