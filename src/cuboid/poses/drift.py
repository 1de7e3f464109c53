"""Given poses that drift: frames are held to what was seen from there before.

Odometry (visual-inertial trackers, wheels, a phone's) is true from frame to frame and errs over a long way. Whoever
trusts it sees a thing twice when the camera comes back. So frames are aligned to keyframes of the same places, the
oldest first. As long as the given poses explain what frames show, they are taken as they are, to the last bit. Once
alignments explained clearly more several times in a row, and no fault of the camera explains that, the poses have
proved to drift. From then on each frame is aligned, and an alignment is taken where it explains at least as much as the
correction so far. Where the given poses explain clearly more of the places that were seen before the proof, the
correction is taken back, for good: what misled once would mislead again.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from cuboid.core.frame import Float64Array, Frame, Intrinsics
from cuboid.core.tolerances import DRIFT_M, DRIFT_RAD, MIN_READINGS
from cuboid.geometry.se3 import inverse, moved_beyond, tidied
from cuboid.poses.alignment import Alignment, Prior, Reference, align, pick
from cuboid.poses.comparison import COMPARED_LEVEL, MIN_GAIN, Explained, as_good, clearly_better, explained
from cuboid.poses.keyframes import NEW_VIEW, OVERLAP_LEVEL, median_depth_m, overlap, view_distances
from cuboid.poses.pyramid import Level, build_levels, shrink
from cuboid.poses.single_cause import MotionPair, SingleCause, single_cause

# Given poses misfit where an alignment leaves at most this fraction unexplained of what they do.
UNEXPLAINED_FRACTION = 0.5
# This many misfits in turn prove that poses drift, or that corrected ones are wrong: fewer may be chance.
MISFITS_THAT_PROVE = 3
# Motions that a fault of the camera must explain, the latest.
MAX_PAIRS = 64
# A frame is compared with a keyframe of whose points it shows more than this fraction.
MIN_OVERLAP = 0.5
# Keyframes that are remembered: 100 kB each. The one that was used longest ago goes.
MAX_KEYFRAMES = 256
# Views from directions farther apart than this have little in common, radians.
FAR_VIEW = 0.7
# The search starts at this level, of 80 pixels: between two comparisons poses err by less than one of them. While the
# poses have not proved to drift it ends at 160 pixels, which takes a third of the time: that is true to millimetres.
COARSEST, ENOUGH = 2, 1


@dataclass(slots=True)
class _Keyframe:
    """A frame that later ones are aligned to: its pose as given, and as corrected."""

    given: Float64Array
    corrected: Float64Array
    reference: Reference
    depth_m: float
    used: int
    proven: bool  # it was remembered after the proof


class DriftCorrection:
    """Corrects the given poses of a recording where they have proved to drift.

    `Tracker(poses="corrected")` uses it.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of every frame.

    Attributes
    ----------
    proven_at : int or None
        Index of the frame at which the poses proved to drift; None again once the correction is taken back.
    taken_back_at : int or None
        Index of the frame at which the correction was taken back.
    cause : SingleCause or None
        The fault of the camera that explains why the given poses misfit, where they do and have not proved to drift.
    most_m : float
        Largest distance of a corrected camera from where the given poses had it, metres.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._intrinsics = intrinsics
        self._keyframes: list[_Keyframe] = []
        self._T_corrected_given: Float64Array = np.eye(4)
        self._compared: Float64Array | None = None
        self._comparisons = self._misfits = 0
        self._pairs: deque[MotionPair] = deque(maxlen=MAX_PAIRS)
        self.proven_at: int | None = None
        self.taken_back_at: int | None = None
        self.cause: SingleCause | None = None
        self.most_m = 0.0

    def correct(self, frame: Frame, given: Float64Array) -> Float64Array:
        """Return where a frame was taken, T_world_camera (4, 4).

        Parameters
        ----------
        frame : Frame
        given : (4, 4) float64
            T_world_camera as the recording has it.
        """
        camera = self._intrinsics
        if self.taken_back_at is not None:
            return given
        if frame.depth_m.shape == (camera.height, camera.width) and self._is_new_viewpoint(given):
            self._compare(frame, given)
        if self.proven_at is None:
            return given
        corrected = tidied(self._T_corrected_given @ given)
        self.most_m = max(self.most_m, float(np.linalg.norm(corrected[:3, 3] - given[:3, 3])))
        return corrected

    def _is_new_viewpoint(self, given: Float64Array) -> bool:
        """Tell whether the camera has moved by as much as poses may err since a frame was compared last.

        The second comparison comes after half of that: so, mostly, it is not those frames that are compared of which
        the tracker takes in the most. Where poses have proved to drift each frame is.
        """
        if self.proven_at is not None:
            return True
        part = 0.5 if self._comparisons == 1 else 1.0
        if self._compared is not None and not moved_beyond(self._compared, given, part * DRIFT_M, part * DRIFT_RAD):
            return False
        self._compared = given
        return True

    def _compare(self, frame: Frame, given: Float64Array) -> None:
        """Align a frame to the oldest keyframe that shows the same, and let it be one where none has its view."""
        self._comparisons += 1
        levels = build_levels(*shrink(frame, self._intrinsics))
        corrected = tidied(self._T_corrected_given @ given)
        is_new_view = self._views([k.corrected for k in self._keyframes], corrected).min(initial=np.inf) > NEW_VIEW
        keyframe = self._oldest([k.corrected for k in self._keyframes], corrected, levels[OVERLAP_LEVEL])
        if keyframe is not None:
            expected = inverse(corrected) @ keyframe.corrected
            prior = Prior(expected, np.diag([DRIFT_M**-2.0] * 3 + [DRIFT_RAD**-2.0] * 3))
            finest = ENOUGH if self.proven_at is None else 0
            found = align(keyframe.reference, levels, expected, prior, coarsest=COARSEST, finest=finest)
            if found.reliable:
                corrected = self._judged(frame.index, keyframe, levels[COMPARED_LEVEL], (given, corrected), found)
                self._T_corrected_given = tidied(corrected @ inverse(given))
        if self.proven_at is not None:
            self._doubt(frame.index, levels, given, corrected)
        if is_new_view:
            self._remember(levels, given, corrected)

    def _judged(
        self,
        index: int,
        keyframe: _Keyframe,
        level: Level,
        T_world_cameras: tuple[Float64Array, Float64Array],
        found: Alignment,
    ) -> Float64Array:
        """Return the corrected pose of a frame, by what the given, the corrected and the found one explain of it."""
        given, corrected = T_world_cameras
        T_camera_reference = inverse(corrected) @ keyframe.corrected
        by_corrected, by_found = (
            explained(keyframe.reference, level, T, found) for T in (T_camera_reference, found.T_camera_reference)
        )
        if as_good(by_found, by_corrected):
            T_camera_reference = found.T_camera_reference
        if self.proven_at is None:
            as_given = inverse(given) @ keyframe.given
            self._pairs.append(MotionPair(as_given, found.T_camera_reference, keyframe.depth_m))
            self._count_misfit(_is_misfit(explained(keyframe.reference, level, as_given, found), by_found))
            self._prove(index)
        return tidied(keyframe.corrected @ inverse(T_camera_reference))

    def _count_misfit(self, misfit: bool) -> None:
        self._misfits = self._misfits + 1 if misfit else 0

    def _prove(self, index: int) -> None:
        """Begin to correct, where misfits prove that poses drift and no fault of the camera explains them."""
        if self._misfits < MISFITS_THAT_PROVE:
            return
        self.cause = single_cause(self._pairs)
        if self.cause is None:
            self.proven_at, self._misfits = index, 0

    def _doubt(self, index: int, levels: tuple[Level, ...], given: Float64Array, corrected: Float64Array) -> None:
        """Take the correction back, where the given poses explain more of the places that were seen before it."""
        keyframe = self._oldest([k.given for k in self._keyframes], given, levels[OVERLAP_LEVEL])
        if keyframe is None or keyframe.proven:
            return
        by_given, by_corrected = (
            explained(keyframe.reference, levels[COMPARED_LEVEL], T)
            for T in (inverse(given) @ keyframe.given, inverse(corrected) @ keyframe.corrected)
        )
        self._count_misfit(clearly_better(by_given, by_corrected))
        if self._misfits >= MISFITS_THAT_PROVE:
            self.proven_at, self.taken_back_at, self.most_m = None, index, 0.0

    def _views(self, T_world_keyframes: list[Float64Array], T_world_camera: Float64Array) -> Float64Array:
        """Return the distance of a view to that of each keyframe, as an angle."""
        depth_m = np.array([keyframe.depth_m for keyframe in self._keyframes])
        return view_distances(T_world_camera, np.array(T_world_keyframes).reshape(-1, 4, 4), depth_m)

    def _oldest(
        self, T_world_keyframes: list[Float64Array], T_world_camera: Float64Array, level: Level
    ) -> _Keyframe | None:
        """Return the oldest keyframe, by poses of all, of whose points an image from a pose shows most."""
        for k in np.flatnonzero(self._views(T_world_keyframes, T_world_camera) < FAR_VIEW).tolist():
            keyframe = self._keyframes[k]
            if overlap(keyframe.reference, T_world_keyframes[k], T_world_camera, level) > MIN_OVERLAP:
                keyframe.used = self._comparisons
                return keyframe
        return None

    def _remember(self, levels: tuple[Level, ...], given: Float64Array, corrected: Float64Array) -> None:
        """Let a frame be a keyframe, where it has points to align to."""
        reference = pick(levels)
        if len(reference.levels[OVERLAP_LEVEL].points) < MIN_READINGS:
            return
        if len(self._keyframes) == MAX_KEYFRAMES:
            self._keyframes.pop(min(range(MAX_KEYFRAMES), key=lambda k: self._keyframes[k].used))
        depth_m, proven = median_depth_m(reference), self.proven_at is not None
        self._keyframes.append(_Keyframe(given, corrected, reference, depth_m, self._comparisons, proven))


def _is_misfit(by_given: Explained, by_found: Explained) -> bool:
    """Tell whether an alignment explains most of what the given pose leaves unexplained, and loses next to nothing."""
    before, left = 1.0 - by_given.fraction, 1.0 - by_found.fraction
    better = left <= UNEXPLAINED_FRACTION * before and before - left >= MIN_GAIN
    return better and clearly_better(by_found, by_given)
