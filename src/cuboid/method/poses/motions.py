"""Motions between frames of a recording, found from the images: what the clock of given poses is compared with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.ground.geometry.se3 import inverse
from cuboid.method.poses.alignment import Alignment, Reference, align, pick
from cuboid.method.poses.comparison import COMPARED_LEVEL, explained
from cuboid.method.poses.keyframes import OVERLAP_LEVEL, median_depth_m
from cuboid.method.poses.pyramid import PYRAMID_LEVELS, Level, build_levels, shrink

# Maximum number of places in time at which three frames are compared, two alignments each: 3 s of work at most.
MAX_COMPARED_TIMES = 48
# Smallest distance of two places, seconds: their frames differ.
APART_S = 0.25
# Times between two of the three frames, seconds: the velocity of a hand changes within a tenth to a third of a second.
STEPS_S = (0.1, 0.2, 0.3)
# Largest motion between two of them, radians and metres: frames beyond that share too little.
MAX_TURN_RAD, MAX_SHIFT_M = 0.25, 0.3
# Distance of the scene for the choice of frames, metres: a rotation displaces it by this distance per radian.
TYPICAL_DEPTH_M = 1.5
# An alignment with a better fit than this is not repeated from another start.
SURE_FIT = 0.8
# A velocity is the mean over this time before and after a frame, seconds.
VELOCITY_S = 0.07


@dataclass(frozen=True, slots=True)
class FoundMotion:
    """The motion of the camera between two frames, from their images.

    Attributes
    ----------
    first_s, second_s : float
        Times of the frames, seconds.
    T_second_first : (4, 4) float64
        Motion of the camera.
    depth_m : float
        Median depth of the first frame.
    place : int
        Number of the place in time: motions of one place share a frame.
    by_given, by_found : float
        Fraction of the points of the first frame that the second one shows alike, in depth and intensity, with the
        given motion and with this one.
    """

    first_s: float
    second_s: float
    T_second_first: Float64Array
    depth_m: float
    place: int
    by_given: float
    by_found: float


def telling_frames(
    times_s: Float64Array, T_world_camera: Float64Array, *, places: int = MAX_COMPARED_TIMES
) -> list[tuple[int, int, int]]:
    """Return three frames of each place in time between which the velocity changes most: they tell the clock.

    Parameters
    ----------
    times_s : (N,) float64
        Increasing.
    T_world_camera : (N, 4, 4) float64
        The given poses of the frames.
    places : int
        Maximum number of places.

    Returns
    -------
    list of (int, int, int)
        Positions in the arrays, by time.
    """
    velocity = _velocities(times_s, T_world_camera)
    rotations = Rotation.from_matrix(T_world_camera[:, :3, :3])
    score = np.zeros(len(times_s))
    partner = np.zeros((len(times_s), 2), np.int64)
    for step_s in STEPS_S:
        middle = np.arange(len(times_s))
        before, after = (np.searchsorted(times_s, times_s + s * step_s).clip(0, len(times_s) - 1) for s in (-1, 1))
        usable = np.ones(len(times_s), bool)
        change = np.zeros(len(times_s))
        for a, b in ((before, middle), (middle, after)):
            usable &= np.abs(times_s[b] - times_s[a] - step_s) < 0.3 * step_s
            usable &= (rotations[a].inv() * rotations[b]).magnitude() < MAX_TURN_RAD
            usable &= np.linalg.norm(T_world_camera[b, :3, 3] - T_world_camera[a, :3, 3], axis=1) < MAX_SHIFT_M
            change += ((velocity[b] - velocity[a]) ** 2).sum(1)
        better = usable & (change > score)
        score[better], partner[better] = change[better], np.column_stack([before, after])[better]
    return _best_of_places(score, partner, times_s, places)


def _best_of_places(
    score: Float64Array, partner: npt.NDArray[np.int64], times_s: Float64Array, places: int
) -> list[tuple[int, int, int]]:
    """Return the frames with the highest score of each part of the time, at most `places`."""
    part_s = max(APART_S, 0.5 * float(times_s[-1] - times_s[0]) / places)
    part = np.floor((times_s - times_s[0]) / part_s).astype(np.int64)
    members = [np.flatnonzero(part == one) for one in np.unique(part)]
    best = np.array([of_part[score[of_part].argmax()] for of_part in members])
    best = best[np.argsort(-score[best], kind="stable")][:places]
    return sorted((int(partner[k, 0]), int(k), int(partner[k, 1])) for k in best if score[k] > 0)


def _velocities(times_s: Float64Array, T_world_camera: Float64Array) -> Float64Array:
    """Return translation and rotation of the camera per second (N, 6), in metres at `TYPICAL_DEPTH_M`."""
    last = len(times_s) - 1
    a, b = (np.searchsorted(times_s, times_s + s * VELOCITY_S).clip(0, last) for s in (-1, 1))
    elapsed_s = np.maximum(times_s[b] - times_s[a], 1e-3)[:, None]
    R_world = Rotation.from_matrix(T_world_camera[:, :3, :3])
    turn = (R_world[b] * R_world[a].inv()).as_rotvec()
    shift = T_world_camera[b, :3, 3] - T_world_camera[a, :3, 3]
    return np.asarray(np.concatenate([shift, TYPICAL_DEPTH_M * turn], axis=1) / elapsed_s)


def found_motions(
    levels_of: Callable[[int], tuple[Level, ...] | None],
    frames: Sequence[int],
    times_s: Float64Array,
    T_world_camera: Float64Array,
    triples: Sequence[tuple[int, int, int]],
) -> list[FoundMotion]:
    """Align the frames of each place; alignments that are not reliable are left out.

    Parameters
    ----------
    levels_of : callable
        Returns the image of a frame by its index, as `levels_of_frames` does.
    frames : sequence of int
        Indices (N) of the frames.
    times_s : (N,) float64
    T_world_camera : (N, 4, 4) float64
    triples : sequence of (int, int, int)
        From `telling_frames`.
    """
    found = []
    for place, triple in enumerate(triples):
        shown = [levels_of(frames[k]) for k in triple]
        for (a, first), (b, second) in pairwise(zip(triple, shown, strict=True)):
            if first is None or second is None:
                continue
            T_given = inverse(T_world_camera[b]) @ T_world_camera[a]
            motion = _motion(pick(first), second, T_given)
            if motion is not None:
                found.append(FoundMotion(float(times_s[a]), float(times_s[b]), *motion[:2], place, *motion[2:]))
    return found


def levels_of_frames(read: Callable[[int], Frame], intrinsics: Intrinsics) -> Callable[[int], tuple[Level, ...] | None]:
    """Return a function from the index of a frame to its image in all sizes, None if the frame cannot be used."""

    def levels_of(index: int) -> tuple[Level, ...] | None:
        try:
            return build_levels(*shrink(read(index), intrinsics))
        except FrameError:
            return None

    return levels_of


def _motion(
    reference: Reference, levels: Sequence[Level], T_given: Float64Array
) -> tuple[Float64Array, float, float, float] | None:
    """Return motion, depth of the reference and the fractions explained by the given and by this motion, or None."""
    if len(reference.levels[OVERLAP_LEVEL].points) < MIN_READINGS:
        return None
    found = _aligned(reference, levels, T_given)
    if found is None:
        return None
    level, T_found = levels[COMPARED_LEVEL], found.T_camera_reference
    by_given, by_found = (explained(reference, level, T, found).fraction_alike for T in (T_given, T_found))
    return T_found, median_depth_m(reference), by_given, by_found


def _aligned(reference: Reference, levels: Sequence[Level], T_expected: Float64Array) -> Alignment | None:
    """Return the better alignment from the given motion and from none; None if neither is reliable."""
    best = None
    for T_start in (T_expected, np.eye(4)):
        found = align(reference, levels, T_start, coarsest=PYRAMID_LEVELS - 1)
        if found.reliable and (best is None or found.fit > best.fit):
            best = found
        if best is not None and best.fit > SURE_FIT:
            break
    return best
