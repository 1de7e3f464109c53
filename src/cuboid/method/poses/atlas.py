"""The atlas: all keyframes, the motions measured between them, and the optimisation of their poses."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.state import Record
from cuboid.ground.geometry import se3
from cuboid.method.poses.alignment import Alignment, Reference, align, merge, pick
from cuboid.method.poses.graph import Edge, deviations, optimise, optimise_around
from cuboid.method.poses.keyframes import OVERLAP_LEVEL, Keyframe, median_depth_m, overlap, view_distances
from cuboid.method.poses.places import Appearance, locate, votes
from cuboid.method.poses.pyramid import Level, SmallImage

# Number of keyframes with the most similar views whose overlap is computed.
NEAR = 12
MIN_PLACE_OVERLAP = 0.3
# Largest number of edges of a new keyframe: to overlapping keyframes, and to keyframes of similar appearance.
NEIGHBOUR_EDGES, LOOP_EDGES = 4, 2
# Smallest fraction of a keyframe's strongest corners that match at a recognised place.
MIN_MATCHED_FRACTION = 0.12
# Alignments in both directions must agree within this: metres per metre of depth, and radians.
THERE_AND_BACK_M, THERE_AND_BACK_RAD = 0.015, 0.015
# An alignment without a motion prior must fit better than one with a prior.
RECOGNISED_INLIERS, RECOGNISED_CORRELATION = 0.7, 0.85
# The graph is optimised if a new edge deviates from the poses by this many standard deviations.
MIN_DEVIATION = 0.5
# Only this many keyframes around the new one move, unless its edges deviate by more: then a loop was closed.
MAX_LOCAL_KEYFRAMES, LOOP_DEVIATION = 40, 5.0


@dataclass(frozen=True, slots=True)
class FrameFeatures:
    """The data of a frame that the atlas uses.

    Attributes
    ----------
    levels : tuple of Level
    appearance : Appearance
    """

    levels: tuple[Level, ...]
    appearance: Appearance


@dataclass(frozen=True, slots=True)
class Place:
    """The pose of an image, found without an initial guess.

    Attributes
    ----------
    keyframe : int
        Number of the keyframe that shows the same place.
    T_keyframe_camera : (4, 4) float64
    found : Alignment
    """

    keyframe: int
    T_keyframe_camera: Float64Array
    found: Alignment


@dataclass(frozen=True, slots=True)
class AtlasState(Record):
    """State of an `Atlas`.

    Attributes
    ----------
    keyframes : dict of int to Keyframe
        The keyframes by number.
    edges : tuple of Edge
        Measured motions between keyframes.
    loops : int
        Number of places recognised by appearance.
    joined : bool
        Whether submaps were joined since the last optimisation of the graph.
    work : tuple of (int, int, bool)
        Pairs of keyframes with an edge to measure; True if only their appearance is similar.
    """

    keyframes: dict[int, Keyframe]
    edges: tuple[Edge, ...]
    loops: int
    joined: bool
    work: tuple[tuple[int, int, bool], ...]


class Atlas:
    """Keyframes and the graph between them.

    Attributes
    ----------
    keyframes : list of Keyframe
    edges : list of Edge
    loops : int
        Number of recognised places: edges between keyframes found by appearance.
    """

    NOT_SAVED: frozenset[str] = frozenset()

    def __init__(self) -> None:
        self.keyframes: list[Keyframe] = []
        self.edges: list[Edge] = []
        self.loops = 0
        self._joined = False  # whether submaps were joined since the last optimisation of the graph
        self._work: deque[tuple[int, int, bool]] = deque()

    def state(self) -> AtlasState:
        """Return the current state; it shares the keyframes, so copy their attributes before the next update."""
        keyframes = {keyframe.number: keyframe for keyframe in self.keyframes}
        return AtlasState(keyframes, tuple(self.edges), self.loops, self._joined, tuple(self._work))

    @classmethod
    def from_state(cls, state: AtlasState) -> Atlas:
        """Return an atlas that continues from a state."""
        atlas = cls()
        atlas.keyframes, atlas.edges = list(state.keyframes.values()), list(state.edges)
        atlas.loops, atlas._joined, atlas._work = state.loops, state.joined, deque(state.work)
        return atlas

    def add(
        self, frame: int, T_world_camera: Float64Array, submap: int, small: SmallImage, features: FrameFeatures
    ) -> tuple[int, list[int]]:
        """Add a keyframe with a pose (4, 4), and queue the measurement of its edges.

        Returns
        -------
        int
            Number of the keyframe.
        list of int
            The keyframes that it overlaps, largest overlap first.
        """
        added = self._keyframe(frame, T_world_camera, submap, small, features)
        overlapping = self.overlapping(T_world_camera, features.levels[OVERLAP_LEVEL], submap)
        self._work.extend((k, added.number, False) for k in overlapping[:NEIGHBOUR_EDGES])
        others = [k for k in self.keyframes if k.number not in overlapping]
        scores = votes(features.appearance, [k.appearance for k in others])
        likely = [i for i in np.argsort(-scores, kind="stable")[:LOOP_EDGES] if scores[i] > MIN_MATCHED_FRACTION]
        self._work.extend((others[i].number, added.number, True) for i in likely)
        self.keyframes.append(added)
        return added.number, overlapping

    def add_given(
        self, frame: int, T_world_camera: Float64Array, submap: int, small: SmallImage, features: FrameFeatures
    ) -> int:
        """Add a keyframe with a given pose (4, 4), which no measurement changes, and return its number."""
        added = self._keyframe(frame, T_world_camera, submap, small, features)
        added.given = True
        self.keyframes.append(added)
        return added.number

    def _keyframe(
        self, frame: int, T_world_camera: Float64Array, submap: int, small: SmallImage, features: FrameFeatures
    ) -> Keyframe:
        """Return the next keyframe."""
        reference, number = pick(features.levels), len(self.keyframes)
        depth_m, appearance = median_depth_m(reference), features.appearance
        return Keyframe(number, frame, T_world_camera, small, depth_m, appearance, submap, _reference=reference)

    def overlapping(self, T_world_camera: Float64Array, level: Level, submap: int) -> list[int]:
        """Return the keyframes that overlap an image at a pose (4, 4), largest overlap first."""
        numbers, distance = self._view_distances(T_world_camera, submap)
        near = [self.keyframes[numbers[i]] for i in np.argsort(distance, kind="stable")[:NEAR]]
        scores = [(-overlap(k.reference, k.T_world_camera, T_world_camera, level), k.number) for k in near]
        return [number for score, number in sorted(scores) if -score > MIN_PLACE_OVERLAP]

    def view_distance(self, T_world_camera: Float64Array, submap: int) -> float:
        """Return the distance of a view (4, 4) to that of the most similar keyframe; see `view_distances`."""
        return float(self._view_distances(T_world_camera, submap)[1].min(initial=np.inf))

    def _view_distances(self, T_world_camera: Float64Array, submap: int) -> tuple[list[int], Float64Array]:
        """Return the keyframes of a submap, and the distance of a view to each."""
        members = [k for k in self.keyframes if k.submap == submap]
        poses = np.array([k.T_world_camera for k in members]).reshape(-1, 4, 4)
        return [k.number for k in members], view_distances(
            T_world_camera, poses, np.array([k.depth_m for k in members])
        )

    def reference(self, numbers: list[int]) -> Reference:
        """Return the points of keyframes in the world, as the reference to which a frame is aligned."""
        used = [self.keyframes[k] for k in numbers]
        return merge([k.reference for k in used], [k.T_world_camera for k in used])

    def work(self) -> bool:
        """Do one queued task; return whether poses of keyframes have changed."""
        if not self._work:
            return False
        a, b, loop = self._work.popleft()
        if loop:
            self._add_loop_edge(a, b)
        else:
            first, second = self.keyframes[a], self.keyframes[b]
            self._add_edge(a, b, se3.inverse(second.T_world_camera) @ first.T_world_camera)
        return not self._work and self._optimise()

    def recognise(self, features: FrameFeatures, camera: Intrinsics, among: Iterable[int], tries: int) -> Place | None:
        """Relocalise an image by its appearance among some keyframes; None if it shows no place of theirs."""
        candidates = [self.keyframes[k] for k in among]
        scores = votes(features.appearance, [k.appearance for k in candidates])
        image_reference: Reference | None = None
        for i in np.argsort(-scores, kind="stable")[:tries]:
            keyframe = candidates[i]
            T = locate(features.appearance, keyframe.appearance, camera)
            if T is None:
                continue
            forward = align(keyframe.reference, features.levels, T, coarsest=2)
            if not _is_recognised(forward):
                continue
            image_reference = image_reference or pick(features.levels)
            back = align(image_reference, keyframe.small.levels(), se3.inverse(forward.T_camera_reference), coarsest=1)
            if _is_recognised(back) and _agree(forward, back, keyframe.depth_m):
                return Place(keyframe.number, se3.inverse(forward.T_camera_reference), forward)
        return None

    def join_at(self, place: Place, T_world_camera: Float64Array, submap: int) -> None:
        """Join a submap with that of a place where its camera is now, with a pose (4, 4) in it; the older stays."""
        keyframe = self.keyframes[place.keyframe]
        T_other_submap = keyframe.T_world_camera @ place.T_keyframe_camera @ se3.inverse(T_world_camera)
        if keyframe.submap < submap:
            self.join(submap, keyframe.submap, T_other_submap)
        else:
            self.join(keyframe.submap, submap, se3.inverse(T_other_submap))

    def _add_loop_edge(self, a: int, b: int) -> None:
        """Add an edge between two keyframes of similar appearance if they show the same place; merge submaps."""
        first, second = self.keyframes[a], self.keyframes[b]
        T = locate(second.appearance, first.appearance, second.small.camera)
        if T is None or not self._add_edge(a, b, T, strict=True):
            return
        self.loops += 1
        old, new = (first, second) if first.submap <= second.submap else (second, first)
        if old.submap != new.submap:
            edge = next(edge for edge in reversed(self.edges) if edge.a == old.number)
            self.join(new.submap, old.submap, old.T_world_camera @ edge.T_a_b @ se3.inverse(new.T_world_camera))

    def join(self, submap: int, to: int, T_to_submap: Float64Array) -> None:
        """Merge a submap into another one by a transform (4, 4), and queue the measurement of edges between them."""
        moved = [k for k in self.keyframes if k.submap == submap]
        for keyframe in moved:
            keyframe.T_world_camera = se3.tidied(T_to_submap @ keyframe.T_world_camera)
        for keyframe in moved:  # they also overlap each other, but these edges exist already
            level = keyframe.small.levels()[OVERLAP_LEVEL]
            overlapping = [] if keyframe.given else self.overlapping(keyframe.T_world_camera, level, to)
            self._work.extend((k, keyframe.number, False) for k in overlapping[:NEIGHBOUR_EDGES])
            self._joined = self._joined or bool(overlapping)
        for keyframe in moved:
            keyframe.submap = to

    def _add_edge(self, a: int, b: int, T_b_a: Float64Array, strict: bool = False) -> bool:
        """Measure the motion between two keyframes in both directions; add the edges if both agree."""
        first, second = self.keyframes[a], self.keyframes[b]
        coarsest = 2 if strict else 1
        forward = align(first.reference, second.small.levels(), T_b_a, coarsest=coarsest)
        if not (forward.reliable and (not strict or _is_recognised(forward))):
            return False
        back = align(second.reference, first.small.levels(), se3.inverse(forward.T_camera_reference), coarsest=1)
        if not (back.reliable and (not strict or _is_recognised(back))) or not _agree(forward, back, first.depth_m):
            return False
        for i, j, found in ((a, b, forward), (b, a, back)):
            T_i_j = se3.inverse(found.T_camera_reference)
            covariance = found.covariance(float(np.linalg.norm(T_i_j[:3, 3])))
            self.edges.append(Edge(i, j, T_i_j, np.asarray(np.linalg.inv(covariance), np.float64)))
        return True

    def _optimise(self) -> bool:
        """Optimise the pose graph if the last keyframe disagrees with its edges, or if submaps were joined."""
        poses = [k.T_world_camera for k in self.keyframes]
        last = len(poses) - 1
        edges = self.edges if self._joined else [e for e in self.edges if last in (e.a, e.b)]
        new = deviations(edges, poses).max(initial=0.0)
        if new < MIN_DEVIATION:
            return False
        everywhere = new > LOOP_DEVIATION or len(poses) <= MAX_LOCAL_KEYFRAMES or self._joined
        self._joined = False
        fixed = {0, *(k.number for k in self.keyframes if k.given)}
        if everywhere:
            found = optimise(poses, self.edges, fixed)
        else:
            found = optimise_around(poses, self.edges, last, MAX_LOCAL_KEYFRAMES, fixed)
        for keyframe, T in zip(self.keyframes, found, strict=True):
            keyframe.T_world_camera = T
        return True


def _is_recognised(found: Alignment) -> bool:
    return found.reliable and found.inliers > RECOGNISED_INLIERS and found.correlation > RECOGNISED_CORRELATION


def _agree(forward: Alignment, back: Alignment, depth_m: float) -> bool:
    """Return whether the motions in both directions cancel."""
    loop = se3.log(forward.T_camera_reference @ back.T_camera_reference)
    return bool(
        np.linalg.norm(loop[:3]) < THERE_AND_BACK_M * max(depth_m, 1.0)
        and np.linalg.norm(loop[3:]) < THERE_AND_BACK_RAD
    )
