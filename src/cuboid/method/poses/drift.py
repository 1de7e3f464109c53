"""Correction of given poses that drift: frames are aligned to earlier frames of the same place.

Odometry (visual-inertial trackers, wheels, phones) is accurate from frame to frame, but its error grows along the path:
when the camera comes back, the map would contain each object twice. So frames are aligned to keyframes of the same
place, the oldest first; pixels that move are left out. As long as the given poses explain the frames, they stay
unchanged, to the last bit. If alignments explain clearly more several times in a row, and no fault of the setup
explains this, the drift is proven. From then on each frame is aligned, and an alignment is used if it explains at least
as much as the current correction. If the given poses explain clearly more of the places that were seen before the
proof, the correction is withdrawn for the rest of the recording: the same cause would mislead it again.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.tolerances import DRIFT_M, DRIFT_RAD, MIN_READINGS
from cuboid.ground.geometry.se3 import inverse, moved_beyond, tidied
from cuboid.method.poses.alignment import Alignment, Prior, Reference, align, pick
from cuboid.method.poses.comparison import COMPARED_LEVEL, MIN_GAIN, Explained, as_good, clearly_better, explained
from cuboid.method.poses.keyframes import NEW_VIEW, OVERLAP_LEVEL, median_depth_m, overlap, view_distances
from cuboid.method.poses.moving import FreeSpace, LeftOut, free_space, levels_without, moving_pixels
from cuboid.method.poses.pyramid import Level, build_levels, shrink
from cuboid.method.poses.single_cause import MotionPair, SingleCause, single_cause

# A given pose misfits if an alignment leaves at most this fraction of the points unexplained that the pose leaves.
UNEXPLAINED_FRACTION = 0.5
# This number of misfits in a row proves that poses drift, or that corrected ones are wrong: fewer may be chance.
MISFITS_THAT_PROVE = 3
# Number of the latest motions that a fault of the setup must explain.
MAX_PAIRS = 64
# A frame is compared with a keyframe if it shows more than this fraction of the keyframe's points.
MIN_KEYFRAME_OVERLAP = 0.5
# Maximum number of stored keyframes, 100 kB each; the least recently used one is dropped.
MAX_KEYFRAMES = 256
# Views farther apart than this have little in common, radians.
FAR_VIEW = 0.7
# Coarsest level of the search, 80 pixels wide: between two comparisons the error of the poses is less than one of its
# pixels. Before drift is proven the search ends at 160 pixels, accurate to millimetres, in a third of the time.
COARSEST_LEVEL, UNPROVEN_FINEST_LEVEL = 2, 1


@dataclass(slots=True)
class _Keyframe:
    """A frame to which later ones are aligned, with its given and its corrected pose."""

    given: Float64Array
    corrected: Float64Array
    reference: Reference
    free_space: FreeSpace
    depth_m: float
    used: int
    proven: bool  # it was stored after the proof


class DriftCorrection:
    """Corrects the given poses of a recording once their drift is proven.

    `Tracker(poses="corrected")` uses it.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of every frame.

    Attributes
    ----------
    proven_at : int or None
        Index of the frame at which drift was proven; None again after the correction was withdrawn.
    withdrawn_at : int or None
        Index of the frame at which the correction was withdrawn.
    cause : SingleCause or None
        The fault of the setup that explains why the given poses misfit; None if they do not, or if they drift.
    max_shift_m : float
        Largest distance between a corrected and a given position of the camera, metres.
    left_out : LeftOut
        The moving pixels that were left out of comparisons.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._intrinsics = intrinsics
        self._keyframes: list[_Keyframe] = []
        self._T_corrected_given: Float64Array = np.eye(4)
        self._compared: Float64Array | None = None
        self._comparisons = self._misfits = 0
        self._pairs: deque[MotionPair] = deque(maxlen=MAX_PAIRS)
        self.proven_at: int | None = None
        self.withdrawn_at: int | None = None
        self.cause: SingleCause | None = None
        self.max_shift_m = 0.0
        self.left_out = LeftOut()

    def correct(self, frame: Frame, given: Float64Array) -> Float64Array:
        """Return the corrected pose of a frame, T_world_camera (4, 4).

        Parameters
        ----------
        frame : Frame
        given : (4, 4) float64
            T_world_camera of the recording.
        """
        camera = self._intrinsics
        if self.withdrawn_at is not None:
            return given
        if frame.depth_m.shape == (camera.height, camera.width) and self._is_new_viewpoint(given):
            self._compare(frame, given)
        if self.proven_at is None:
            return given
        corrected = tidied(self._T_corrected_given @ given)
        self.max_shift_m = max(self.max_shift_m, float(np.linalg.norm(corrected[:3, 3] - given[:3, 3])))
        return corrected

    def _is_new_viewpoint(self, given: Float64Array) -> bool:
        """Return whether the camera has moved by the error of poses since the last comparison.

        The second comparison follows after half of this motion: most comparisons then are not in the frames in which
        the tracker has the most work. After the proof of drift each frame is compared.
        """
        if self.proven_at is not None:
            return True
        part = 0.5 if self._comparisons == 1 else 1.0
        if self._compared is not None and not moved_beyond(self._compared, given, part * DRIFT_M, part * DRIFT_RAD):
            return False
        self._compared = given
        return True

    def _compare(self, frame: Frame, given: Float64Array) -> None:
        """Align a frame to the oldest keyframe of the same place; store it as a keyframe if its view is new."""
        self._comparisons += 1
        levels = build_levels(*shrink(frame, self._intrinsics))
        corrected = tidied(self._T_corrected_given @ given)
        is_new_view = self._views([k.corrected for k in self._keyframes], corrected).min(initial=np.inf) > NEW_VIEW
        keyframe = self._oldest([k.corrected for k in self._keyframes], corrected, levels[OVERLAP_LEVEL])
        if keyframe is not None:
            expected = inverse(corrected) @ keyframe.corrected
            prior = Prior(expected, np.diag([DRIFT_M**-2.0] * 3 + [DRIFT_RAD**-2.0] * 3))
            finest = UNPROVEN_FINEST_LEVEL if self.proven_at is None else 0
            found = align(keyframe.reference, levels, expected, prior, coarsest=COARSEST_LEVEL, finest=finest)
            moving = _moving_pixels(keyframe, levels, (expected, found.T_camera_reference))
            if moving is not None:
                self.left_out.add(moving)
                levels = levels_without(levels, moving)
                found = align(keyframe.reference, levels, expected, prior, coarsest=COARSEST_LEVEL, finest=finest)
            if found.reliable:
                corrected = self._judged(frame.index, keyframe, levels[COMPARED_LEVEL], (given, corrected), found)
                self._T_corrected_given = tidied(corrected @ inverse(given))
        if self.proven_at is not None:
            self._check_correction(frame.index, levels, given, corrected)
        if is_new_view:
            self._store_keyframe(levels, given, corrected)

    def _judged(
        self,
        index: int,
        keyframe: _Keyframe,
        level: Level,
        T_world_cameras: tuple[Float64Array, Float64Array],
        found: Alignment,
    ) -> Float64Array:
        """Return the corrected pose of a frame: the found or the corrected one, whichever explains more of it."""
        given, corrected = T_world_cameras
        T_camera_reference = inverse(corrected) @ keyframe.corrected
        by_corrected, by_found = (
            explained(keyframe.reference, level, T, found) for T in (T_camera_reference, found.T_camera_reference)
        )
        if as_good(by_found, by_corrected):
            T_camera_reference = found.T_camera_reference
        if self.proven_at is None:
            as_given = inverse(given) @ keyframe.given
            self._pairs.append(MotionPair(given, keyframe.given, found.T_camera_reference, keyframe.depth_m))
            self._count_misfit(_is_misfit(explained(keyframe.reference, level, as_given, found), by_found))
            self._prove(index)
        return tidied(keyframe.corrected @ inverse(T_camera_reference))

    def _count_misfit(self, misfit: bool) -> None:
        self._misfits = self._misfits + 1 if misfit else 0

    def _prove(self, index: int) -> None:
        """Begin to correct if misfits prove that poses drift, and no fault of the setup explains them."""
        if self._misfits < MISFITS_THAT_PROVE:
            return
        self.cause = single_cause(self._pairs)
        if self.cause is None:
            self.proven_at, self._misfits = index, 0

    def _check_correction(
        self, index: int, levels: tuple[Level, ...], given: Float64Array, corrected: Float64Array
    ) -> None:
        """Withdraw the correction if the given poses explain more of the places that were seen before it."""
        keyframe = self._oldest([k.given for k in self._keyframes], given, levels[OVERLAP_LEVEL])
        if keyframe is None or keyframe.proven:
            return
        by_given, by_corrected = (
            explained(keyframe.reference, levels[COMPARED_LEVEL], T)
            for T in (inverse(given) @ keyframe.given, inverse(corrected) @ keyframe.corrected)
        )
        self._count_misfit(clearly_better(by_given, by_corrected))
        if self._misfits >= MISFITS_THAT_PROVE:
            self.proven_at, self.withdrawn_at, self.max_shift_m = None, index, 0.0

    def _views(self, T_world_keyframes: list[Float64Array], T_world_camera: Float64Array) -> Float64Array:
        """Return the distance of a view to that of each keyframe, as an angle."""
        depth_m = np.array([keyframe.depth_m for keyframe in self._keyframes])
        return view_distances(T_world_camera, np.array(T_world_keyframes).reshape(-1, 4, 4), depth_m)

    def _oldest(
        self, T_world_keyframes: list[Float64Array], T_world_camera: Float64Array, level: Level
    ) -> _Keyframe | None:
        """Return the oldest keyframe, given poses of all, most of whose points an image from a pose shows."""
        for k in np.flatnonzero(self._views(T_world_keyframes, T_world_camera) < FAR_VIEW).tolist():
            keyframe = self._keyframes[k]
            if overlap(keyframe.reference, T_world_keyframes[k], T_world_camera, level) > MIN_KEYFRAME_OVERLAP:
                keyframe.used = self._comparisons
                return keyframe
        return None

    def _store_keyframe(self, levels: tuple[Level, ...], given: Float64Array, corrected: Float64Array) -> None:
        """Store a frame as a keyframe if it has enough points to align to."""
        reference = pick(levels)
        if len(reference.levels[OVERLAP_LEVEL].points) < MIN_READINGS:
            return
        if len(self._keyframes) == MAX_KEYFRAMES:
            self._keyframes.pop(min(range(MAX_KEYFRAMES), key=lambda k: self._keyframes[k].used))
        depth_m, proven = median_depth_m(reference), self.proven_at is not None
        self._keyframes.append(
            _Keyframe(given, corrected, reference, free_space(levels), depth_m, self._comparisons, proven)
        )


def _moving_pixels(
    keyframe: _Keyframe, levels: tuple[Level, ...], T_camera_references: tuple[Float64Array, ...]
) -> UInt8Array | None:
    """Return which pixels of an image move by all of several poses (h, w), as one may be wrong; None if none does."""
    marks = None
    for T in T_camera_references:
        moving = moving_pixels(levels, keyframe.corrected @ inverse(T), [(keyframe.free_space, keyframe.corrected)])
        if moving is None:
            return None
        marks = moving if marks is None else marks & moving
    return marks if marks is not None and marks.any() else None


def _is_misfit(by_given: Explained, by_found: Explained) -> bool:
    """Return whether an alignment explains most points that the given pose does not, and loses almost none."""
    before, left = 1.0 - by_given.fraction, 1.0 - by_found.fraction
    better = left <= UNEXPLAINED_FRACTION * before and before - left >= MIN_GAIN
    return better and clearly_better(by_found, by_given)
