"""Check whether given camera poses explain the frames' depth, or whether another convention explains it better."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.pose_convention import POSE_CONVENTIONS, converted
from cuboid.ground.geometry.se3 import inverse, transform

# Number of frames, evenly over the run, whose depth is transformed to later frames; distances to these, in used frames.
START_FRAMES, GAPS = 6, (5, 10, 20)
# Number of compared pixels along each row.
ROW_SAMPLES = 80
# Maximum relative difference of two depths that agree.
AGREE = 0.025
# Minimum number of pixels that fall on readings of the other frame for a pair to count; minimum number of pairs.
MIN_COMMON_PIXELS, MIN_FRAME_PAIRS = 200, 4
# Factors of the depth that are tried.
DEPTH_FACTORS = (0.1, 0.2, 0.5, 2.0, 5.0, 10.0)
# Maximum shift of poses, in used frames, earlier and later.
MAX_SHIFT = 5
_SHIFTS = tuple(shift for shift in range(-MAX_SHIFT, MAX_SHIFT + 1) if shift)
# A convention must explain more pixels than an earlier one by at least this fraction.
AS_MUCH = 0.02
# A step between consecutive frames is a jump if it is at least JUMP_STEPS times the median step and at least
# CAMERA_JUMP_M metres: a carried camera does not cover that within a tenth of a second.
JUMP_STEPS, CAMERA_JUMP_M = 20.0, 0.5


@dataclass(frozen=True, slots=True)
class Jump:
    """A step of the given poses that the frames do not show.

    Attributes
    ----------
    frame : int
        The frame after it.
    step_m : float
    """

    frame: int
    step_m: float


@dataclass(frozen=True, slots=True)
class PoseFit:
    """Fractions of the pixels whose depth agrees in two frames, median over pairs of frames.

    Attributes
    ----------
    given : float or None
        Fraction with the given poses; None if too few pixels are in view of both frames.
    still : float
        Fraction with a static camera.
    moves : bool
        Whether the given poses differ from each other.
    convention : tuple of str
        The convention in `POSE_CONVENTIONS` with the best agreement.
    converted : float
        Fraction with this convention.
    shift : int
        The non-zero shift, in used frames, with the best agreement: poses belong to earlier (negative: later) frames.
    shifted : float
        Fraction with this shift.
    depth_factor : float
        The depth factor in `DEPTH_FACTORS` with the best agreement, with the given poses.
    scaled : float
        Fraction with this factor.
    jump : Jump or None
        The largest jump.
    """

    given: float | None
    still: float
    moves: bool
    convention: tuple[str, ...]
    converted: float
    shift: int
    shifted: float
    depth_factor: float
    scaled: float
    jump: Jump | None


def pose_fit(
    read: Callable[[int], Frame], intrinsics: Intrinsics, T_world_camera: Mapping[int, Float64Array]
) -> PoseFit | None:
    """Return how well given poses explain the frames' depth; None if too few pairs of frames are usable.

    Parameters
    ----------
    read : callable
        Returns a frame by its number; raises FrameError if it cannot be used.
    intrinsics : Intrinsics
        Intrinsics of the frames.
    T_world_camera : mapping of int to (4, 4) float64
        Given poses of the frames that were used.
    """
    frames = sorted(T_world_camera)
    if len(frames) <= GAPS[0]:
        return None
    poses = [T_world_camera[frame] for frame in frames]
    starts = sorted({int(k) for k in np.linspace(0, len(frames) - 1 - GAPS[0], START_FRAMES)})
    rows = []
    for start in starts:
        try:
            points = _points(read(frames[start]), intrinsics)
        except FrameError:
            continue
        for later in (start + gap for gap in GAPS if start + gap < len(frames)):
            try:
                depth_m = read(frames[later]).depth_m
            except FrameError:
                continue
            motions = _hypotheses(poses, start, later)
            rows.append([None if T is None else _agreement(transform(T, points), depth_m, intrinsics) for T in motions])
    if not rows:
        return None
    medians = [_median(list(column)) for column in zip(*rows, strict=True)]
    if medians[0] is None and not any(medians[2:]):
        return None
    given, still, fractions = medians[0], medians[1] or 0.0, [fraction or 0.0 for fraction in medians[2:]]
    conventions, shifts = len(POSE_CONVENTIONS), len(_SHIFTS)
    converted_by, shifted_by = fractions[:conventions], fractions[conventions : conventions + shifts]
    scaled_by = fractions[conventions + shifts :]
    best = next(k for k in range(conventions) if converted_by[k] >= max(converted_by) - AS_MUCH)
    shift, factor = int(np.argmax(shifted_by)), int(np.argmax(scaled_by))
    return PoseFit(
        given,
        still,
        any(not np.allclose(T, poses[0]) for T in poses),
        POSE_CONVENTIONS[best],
        converted_by[best],
        _SHIFTS[shift],
        shifted_by[shift],
        DEPTH_FACTORS[factor],
        scaled_by[factor],
        _jump(read, intrinsics, frames, poses),
    )


def _hypotheses(poses: list[Float64Array], a: int, b: int) -> list[Float64Array | None]:
    """Return the camera motion T_b_a for each hypothesis: given, static, conventions, shifts, depth factors."""
    given = inverse(poses[b]) @ poses[a]
    motions: list[Float64Array | None] = [given, np.eye(4)]
    motions += [inverse(converted(poses[b], names)) @ converted(poses[a], names) for names in POSE_CONVENTIONS]
    for shift in _SHIFTS:
        there = a + shift >= 0 and b + shift < len(poses)
        motions.append(inverse(poses[b + shift]) @ poses[a + shift] if there else None)
    for factor in DEPTH_FACTORS:  # scaled depth is equal to the inversely scaled translation
        scaled = given.copy()
        scaled[:3, 3] /= factor
        motions.append(scaled)
    return motions


def _jump(
    read: Callable[[int], Frame], intrinsics: Intrinsics, frames: list[int], poses: list[Float64Array]
) -> Jump | None:
    """Return the largest step of the given poses if it is a jump: the frames show no such motion."""
    steps = np.array([np.linalg.norm(b[:3, 3] - a[:3, 3]) for a, b in pairwise(poses)])
    largest = int(np.argmax(steps))
    if steps[largest] < max(JUMP_STEPS * float(np.median(steps)), CAMERA_JUMP_M):
        return None
    try:
        points, depth_m = _points(read(frames[largest]), intrinsics), read(frames[largest + 1]).depth_m
    except FrameError:
        return None
    moved = transform(inverse(poses[largest + 1]) @ poses[largest], points)
    by_given, by_still = (_agreement(seen, depth_m, intrinsics) or 0.0 for seen in (moved, points))
    return Jump(frames[largest + 1], float(steps[largest])) if by_still > max(2.0 * by_given, 0.5) else None


def _median(fractions: list[float | None]) -> float | None:
    """Return the median of the pairs' fractions; None if too few pairs have one."""
    values = [fraction for fraction in fractions if fraction is not None]
    return float(np.median(values)) if len(values) >= MIN_FRAME_PAIRS else None


def _points(frame: Frame, K: Intrinsics) -> Float64Array:
    """Return points of a frame in its camera, (N, 3) metres."""
    step = max(1, K.width // ROW_SAMPLES)
    z = frame.depth_m[::step, ::step]
    rows, columns = np.indices(z.shape) * step
    return K.points(columns, rows, z)[z > 0]


def _agreement(points: Float64Array, depth_m: Float32Array, K: Intrinsics) -> float | None:
    """Return the fraction of points, in a depth image's camera, that agree with its readings, or None."""
    ahead = points[points[:, 2] > 0]
    columns, rows = np.rint(K.pixels(ahead)).T
    inside = (columns >= 0) & (columns < K.width) & (rows >= 0) & (rows < K.height)
    read_m = depth_m[rows[inside].astype(np.intp), columns[inside].astype(np.intp)]
    z = ahead[inside, 2][read_m > 0]
    if len(z) < MIN_COMMON_PIXELS:
        return None
    read_m = read_m[read_m > 0]
    return float((np.abs(read_m - z) < AGREE * z).mean())
