"""Given poses that drift: frames are held to what was seen from there before.

Odometry (visual-inertial trackers, wheels, a phone's) is true from frame to frame and errs over a long way. Whoever
trusts it sees a thing twice when the camera comes back. So frames are aligned to keyframes of the same places, the
oldest first. As long as the given poses explain what frames show, they are taken as they are, to the last bit. Once
alignment has explained far more of it several times in a row, the poses have proved to drift, and from then on each
frame is aligned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cuboid.core.frame import Float64Array, Frame, Intrinsics
from cuboid.core.tolerances import DRIFT_M, DRIFT_RAD, MIN_READINGS, SIGMAS
from cuboid.geometry.se3 import inverse, moved_beyond, tidied
from cuboid.poses.alignment import NOISE, Prior, Reference, align, pick
from cuboid.poses.kernels import align as kernel
from cuboid.poses.keyframes import NEW_VIEW, OVERLAP_LEVEL, median_depth_m, overlap, pixels_of, view_distances
from cuboid.poses.pyramid import Level, build_levels, shrink

# Given poses misfit where an alignment leaves at most this fraction unexplained of what they do.
UNEXPLAINED_FRACTION = 0.5
# This many misfits in turn prove that poses drift: fewer may be chance.
MISFITS_THAT_PROVE = 3
# A frame is compared with a keyframe of whose points it shows more than this fraction.
MIN_OVERLAP = 0.5
# Keyframes that are remembered: 100 kB each. The one that was used longest ago goes.
MAX_KEYFRAMES = 256
# Views from directions farther apart than this have little in common, radians.
FAR_VIEW = 0.7
# The search starts at this level, of 80 pixels: between two comparisons poses err by less than one of them. While the
# poses have not proved to drift it ends at 160 pixels, which takes a third of the time: that is true to millimetres.
COARSEST, ENOUGH = 2, 1
# An alignment explains more than the given poses do where it explains most of what they do not, and of all points this
# fraction: the edges of things alone have fewer.
MIN_GAIN = 0.03
# The part that a pose explains is measured at this level, of 160 pixels: a reading there is the mean of several. A
# reading that differs by more than this, metres, is hidden or lies on another surface, and is ignored.
TOLD_AT, OTHER_SURFACE_M = 1, 0.1


@dataclass(slots=True)
class _Keyframe:
    """A frame that later ones are aligned to: its pose as given, and as corrected."""

    given: Float64Array
    corrected: Float64Array
    reference: Reference
    depth_m: float
    used: int


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
        Index of the frame at which the poses proved to drift.
    most_m : float
        Largest distance of a corrected camera from where the given poses had it, metres.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._intrinsics = intrinsics
        self._keyframes: list[_Keyframe] = []
        self._T_corrected_given: Float64Array = np.eye(4)
        self._compared: Float64Array | None = None
        self._comparisons = self._misfits = 0
        self.proven_at: int | None = None
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
        views = view_distances(
            corrected,
            np.array([k.corrected for k in self._keyframes]).reshape(-1, 4, 4),
            np.array([k.depth_m for k in self._keyframes]),
        )
        keyframe = self._oldest(np.flatnonzero(views < FAR_VIEW).tolist(), corrected, levels[OVERLAP_LEVEL])
        if keyframe is not None:
            expected = inverse(corrected) @ keyframe.corrected
            prior = Prior(expected, np.diag([DRIFT_M**-2.0] * 3 + [DRIFT_RAD**-2.0] * 3))
            finest = ENOUGH if self.proven_at is None else 0
            found = align(keyframe.reference, levels, expected, prior, coarsest=COARSEST, finest=finest)
            if found.reliable:
                if self.proven_at is None:
                    as_given = inverse(given) @ keyframe.given
                    self._judge(frame.index, keyframe.reference, levels, as_given, found.T_camera_reference)
                corrected = tidied(keyframe.corrected @ inverse(found.T_camera_reference))
                self._T_corrected_given = tidied(corrected @ inverse(given))
        if views.min(initial=np.inf) > NEW_VIEW:
            self._remember(levels, given, corrected)

    def _judge(
        self, index: int, reference: Reference, levels: tuple[Level, ...], as_given: Float64Array, found: Float64Array
    ) -> None:
        """Take in whether an alignment explains most of what the given poses leave unexplained."""
        left, before = (1.0 - explained(reference, levels[TOLD_AT], T) for T in (found, as_given))
        misfit = left <= UNEXPLAINED_FRACTION * before and before - left >= MIN_GAIN
        self._misfits = self._misfits + 1 if misfit else 0
        if self._misfits >= MISFITS_THAT_PROVE:
            self.proven_at = index

    def _oldest(self, near: list[int], T_world_camera: Float64Array, level: Level) -> _Keyframe | None:
        """Return the oldest of some keyframes of whose points an image from a pose shows most."""
        for keyframe in [self._keyframes[k] for k in near]:
            if overlap(keyframe.reference, keyframe.corrected, T_world_camera, level) > MIN_OVERLAP:
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
        self._keyframes.append(_Keyframe(given, corrected, reference, median_depth_m(reference), self._comparisons))


def explained(reference: Reference, level: Level, T_camera_reference: Float64Array) -> float:
    """Return the fraction of a reference's points on whose surface an image has its reading there, 0..1.

    A reading lies on it within three deviations of the depth's noise.

    Parameters
    ----------
    reference : Reference
    level : Level
        The image in the size of `TOLD_AT`.
    T_camera_reference : (4, 4) float64
    """
    T, picked = T_camera_reference.astype(np.float32), reference.levels[TOLD_AT]
    points, normals = picked.points @ T[:3, :3].T + T[:3, 3], picked.normals @ T[:3, :3].T
    seen, u, v = pixels_of(points, level)
    depth_m = level.image[v, u, kernel.DEPTH]
    read, (fx, fy, cx, cy) = depth_m > 0, level.camera
    u, v, depth_m, points, normals = u[read], v[read], depth_m[read], points[seen][read], normals[seen][read]
    places = np.column_stack([(u - cx) / fx * depth_m, (v - cy) / fy * depth_m, depth_m])
    off_m = np.abs(((places - points) * normals).sum(1))
    here = off_m < OTHER_SURFACE_M
    if np.count_nonzero(here) < MIN_READINGS:
        return 0.0
    return float((off_m < SIGMAS * (NOISE[0] + NOISE[1] * depth_m**2))[here].mean())
