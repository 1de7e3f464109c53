"""The atlas: all keyframes, the motions measured between them, and the work that makes them agree."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from cuboid.frame import Float64Array, Intrinsics
from cuboid.geometry import se3
from cuboid.poses.alignment import Alignment, Reference, align, merge, pick
from cuboid.poses.graph import Edge, deviations, optimise, optimise_around
from cuboid.poses.keyframes import OVERLAP_LEVEL, Keyframe, apart, median_depth_m, overlap
from cuboid.poses.places import Appearance, locate, votes
from cuboid.poses.pyramid import Level, SmallImage

# Keyframes whose overlap is looked at: those with the most similar views.
NEAR = 12
LEAST_OVERLAP = 0.3
# A new keyframe is tied to so many others that overlap it, and to so many that look like it.
TIES, LOOPS = 4, 2
# Least share of a keyframe's clearest corners that a place known again has in common with it.
LEAST_VOTES = 0.12
# Alignments there and back agree within this: metres per metre of depth, and radians.
THERE_AND_BACK_M, THERE_AND_BACK_RAD = 0.015, 0.015
# An alignment that nothing led up to must hold better than one that follows a motion.
KNOWN_AGAIN_AGREEING, KNOWN_AGAIN_LIKENESS = 0.7, 0.85
# The graph is optimised when a new edge is so many deviations from the poses.
WORTH_IT = 0.5
# Only so many keyframes around the new one move, unless its edges are farther from the poses: a loop was closed.
AROUND, BENT = 40, 5.0


@dataclass(frozen=True, slots=True)
class View:
    """What the atlas takes in of a frame.

    Attributes
    ----------
    levels : tuple of Level
    appearance : Appearance
    """

    levels: tuple[Level, ...]
    appearance: Appearance


@dataclass(frozen=True, slots=True)
class Place:
    """Where an image was taken, found without knowing where to look.

    Attributes
    ----------
    keyframe : int
        Number of the keyframe that shows the same.
    T_keyframe_camera : (4, 4) float64
    found : Alignment
    """

    keyframe: int
    T_keyframe_camera: Float64Array
    found: Alignment


class Atlas:
    """Keyframes and the graph between them.

    Attributes
    ----------
    keyframes : list of Keyframe
    edges : list of Edge
    loops : int
        Places known again: pairs of keyframes tied because they look alike.
    """

    def __init__(self) -> None:
        self.keyframes: list[Keyframe] = []
        self.edges: list[Edge] = []
        self.loops = 0
        self._joined = False  # whether submaps have met since the graph was optimised last
        self._work: deque[tuple[int, int, bool]] = deque()

    def add(
        self, frame: int, T_world_camera: Float64Array, submap: int, small: SmallImage, view: View
    ) -> tuple[int, list[int]]:
        """Take in a keyframe, and note the work of tying it to others.

        Returns
        -------
        int
            Its number.
        list of int
            The keyframes that it overlaps, most first.
        """
        number = len(self.keyframes)
        reference = pick(view.levels)
        overlapping = self.overlapping(T_world_camera, view.levels[OVERLAP_LEVEL], submap)
        self._work.extend((k, number, False) for k in overlapping[:TIES])
        known = [k for k in self.keyframes if k.number not in overlapping]
        shares = votes(view.appearance, [k.appearance for k in known])
        likely = [i for i in np.argsort(-shares, kind="stable")[:LOOPS] if shares[i] > LEAST_VOTES]
        self._work.extend((known[i].number, number, True) for i in likely)
        self.keyframes.append(
            Keyframe(
                number, frame, T_world_camera, small, median_depth_m(reference), view.appearance, submap,
                _reference=reference,
            )
        )  # fmt: skip
        return number, overlapping

    def add_given(self, frame: int, T_world_camera: Float64Array, submap: int, small: SmallImage, view: View) -> int:
        """Take in a keyframe whose pose is given: no measurement moves it. Returns its number."""
        number, reference = len(self.keyframes), pick(view.levels)
        self.keyframes.append(
            Keyframe(
                number, frame, T_world_camera, small, median_depth_m(reference), view.appearance, submap, given=True,
                _reference=reference,
            )
        )  # fmt: skip
        return number

    def overlapping(self, T_world_camera: Float64Array, level: Level, submap: int) -> list[int]:
        """Return the keyframes that show much of what an image from a pose shows, most first."""
        numbers, distance = self._apart(T_world_camera, submap)
        near = [self.keyframes[numbers[i]] for i in np.argsort(distance, kind="stable")[:NEAR]]
        shares = [(-overlap(k.reference, k.T_world_camera, T_world_camera, level), k.number) for k in near]
        return [number for share, number in sorted(shares) if -share > LEAST_OVERLAP]

    def view_apart(self, T_world_camera: Float64Array, submap: int) -> float:
        """Return how different a view is from that of the most similar keyframe; see `apart`."""
        return float(self._apart(T_world_camera, submap)[1].min(initial=np.inf))

    def _apart(self, T_world_camera: Float64Array, submap: int) -> tuple[list[int], Float64Array]:
        """Return the keyframes of a submap, and how different a view is from each."""
        mine = [k for k in self.keyframes if k.submap == submap]
        poses = np.array([k.T_world_camera for k in mine]).reshape(-1, 4, 4)
        return [k.number for k in mine], apart(T_world_camera, poses, np.array([k.depth_m for k in mine]))

    def reference(self, numbers: list[int]) -> Reference:
        """Return the points of keyframes in the world, what a frame is aligned to."""
        used = [self.keyframes[k] for k in numbers]
        return merge([k.reference for k in used], [k.T_world_camera for k in used])

    def work(self) -> bool:
        """Do a part of the work noted; tell whether poses of keyframes have changed."""
        if not self._work:
            return False
        a, b, loop = self._work.popleft()
        if loop:
            self._tie_alike(a, b)
        else:
            one, two = self.keyframes[a], self.keyframes[b]
            self._tie(a, b, se3.inverse(two.T_world_camera) @ one.T_world_camera)
        return not self._work and self._settle()

    def recognise(self, view: View, camera: Intrinsics, among: Iterable[int], tries: int) -> Place | None:
        """Find out where an image was taken from what it looks like; None where it shows no place of some keyframes."""
        known = [self.keyframes[k] for k in among]
        shares = votes(view.appearance, [k.appearance for k in known])
        pinhole = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        own: Reference | None = None
        for i in np.argsort(-shares, kind="stable")[:tries]:
            keyframe = known[i]
            T = locate(view.appearance, keyframe.appearance, pinhole)
            if T is None:
                continue
            there = align(keyframe.reference, view.levels, T, coarsest=2)
            if not _known_again(there):
                continue
            own = own or pick(view.levels)
            back = align(own, keyframe.small.levels(), se3.inverse(there.T_camera_reference), coarsest=1)
            if _known_again(back) and _agree(there, back, keyframe.depth_m):
                return Place(keyframe.number, se3.inverse(there.T_camera_reference), there)
        return None

    def join_at(self, place: Place, T_world_camera: Float64Array, submap: int) -> None:
        """Make one of a submap and that of a place where its camera, at a pose of its own, now is; the older stays."""
        known = self.keyframes[place.keyframe]
        T_known_submap = known.T_world_camera @ place.T_keyframe_camera @ se3.inverse(T_world_camera)
        if known.submap < submap:
            self.join(submap, known.submap, T_known_submap)
        else:
            self.join(known.submap, submap, se3.inverse(T_known_submap))

    def _tie_alike(self, a: int, b: int) -> None:
        """Tie two keyframes that look alike, where they show the same place; of two submaps one is made."""
        one, two = self.keyframes[a], self.keyframes[b]
        camera = two.small.camera
        T = locate(two.appearance, one.appearance, np.array([camera.fx, camera.fy, camera.cx, camera.cy]))
        if T is None or not self._tie(a, b, T, strict=True):
            return
        self.loops += 1
        old, new = (one, two) if one.submap <= two.submap else (two, one)
        if old.submap != new.submap:
            edge = next(edge for edge in reversed(self.edges) if edge.a == old.number)
            self.join(new.submap, old.submap, old.T_world_camera @ edge.T_a_b @ se3.inverse(new.T_world_camera))

    def join(self, submap: int, to: int, T_to_submap: Float64Array) -> None:
        """Make a submap part of another one, and note the work of tying both together."""
        carried = [k for k in self.keyframes if k.submap == submap]
        for keyframe in carried:
            keyframe.T_world_camera = se3.tidied(T_to_submap @ keyframe.T_world_camera)
        for keyframe in carried:  # they overlap each other too, but are tied already
            level = keyframe.small.levels()[OVERLAP_LEVEL]
            overlapping = [] if keyframe.given else self.overlapping(keyframe.T_world_camera, level, to)
            self._work.extend((k, keyframe.number, False) for k in overlapping[:TIES])
            self._joined = self._joined or bool(overlapping)
        for keyframe in carried:
            keyframe.submap = to

    def _tie(self, a: int, b: int, T_b_a: Float64Array, strict: bool = False) -> bool:
        """Measure the motion between two keyframes in both directions; keep it where both agree."""
        one, two = self.keyframes[a], self.keyframes[b]
        coarsest = 2 if strict else 1
        there = align(one.reference, two.small.levels(), T_b_a, coarsest=coarsest)
        if not (there.holds and (not strict or _known_again(there))):
            return False
        back = align(two.reference, one.small.levels(), se3.inverse(there.T_camera_reference), coarsest=1)
        if not (back.holds and (not strict or _known_again(back))) or not _agree(there, back, one.depth_m):
            return False
        for i, j, found in ((a, b, there), (b, a, back)):
            T_i_j = se3.inverse(found.T_camera_reference)
            doubt = found.covariance(float(np.linalg.norm(T_i_j[:3, 3])))
            self.edges.append(Edge(i, j, T_i_j, np.asarray(np.linalg.inv(doubt), np.float64)))
        return True

    def _settle(self) -> bool:
        """Let the keyframes' poses agree with what was measured of the last one, or where submaps have met."""
        poses = [k.T_world_camera for k in self.keyframes]
        last = len(poses) - 1
        edges = self.edges if self._joined else [e for e in self.edges if last in (e.a, e.b)]
        new = deviations(edges, poses).max(initial=0.0)
        if new < WORTH_IT:
            return False
        everywhere = new > BENT or len(poses) <= AROUND or self._joined
        self._joined = False
        fixed = {0, *(k.number for k in self.keyframes if k.given)}
        if everywhere:
            found = optimise(poses, self.edges, fixed)
        else:
            found = optimise_around(poses, self.edges, last, AROUND, fixed)
        for keyframe, T in zip(self.keyframes, found, strict=True):
            keyframe.T_world_camera = T
        return True


def _known_again(found: Alignment) -> bool:
    return found.holds and found.agreeing > KNOWN_AGAIN_AGREEING and found.likeness > KNOWN_AGAIN_LIKENESS


def _agree(there: Alignment, back: Alignment, depth_m: float) -> bool:
    """Tell whether the motions there and back cancel."""
    loop = se3.log(there.T_camera_reference @ back.T_camera_reference)
    return bool(
        np.linalg.norm(loop[:3]) < THERE_AND_BACK_M * max(depth_m, 1.0)
        and np.linalg.norm(loop[3:]) < THERE_AND_BACK_RAD
    )
