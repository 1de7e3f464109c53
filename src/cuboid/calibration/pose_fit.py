"""Whether given camera poses explain the depth of the frames, or another reading of them explains it better."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cuboid.core.errors import FrameError
from cuboid.core.frame import Float32Array, Float64Array, Frame, Intrinsics
from cuboid.geometry.se3 import inverse, transform
from cuboid.readers.pose_convention import converted

# Frames whose depth is carried to later ones, evenly over the run, and how many used frames later these are.
STARTS, GAPS = 6, (5, 10, 20)
# This many pixels along each row are compared.
COLUMNS = 80
# Two depths agree if they differ by this fraction at most.
AGREE = 0.025
# A pair tells of a hypothesis if this many pixels of one frame fall on readings of the other; this many pairs must.
MIN_PIXELS, MIN_PAIRS = 200, 4
# Factors of the depth that are tried.
DEPTH_FACTORS = (0.1, 0.2, 0.5, 2.0, 5.0, 10.0)
# Conventions of the poses that are tried, the simple ones first: of two that explain as much the first is named.
POSE_CONVENTIONS = (
    ("inverse",), ("opengl",), ("inverse", "opengl"), ("mm",), ("cm",), ("wxyz",), ("xyzw",), ("mm", "inverse"),
    ("mm", "opengl"), ("cm", "inverse"), ("cm", "opengl"), ("wxyz", "inverse"), ("wxyz", "opengl"),
    ("xyzw", "inverse"), ("xyzw", "opengl"), ("wxyz", "mm"), ("xyzw", "mm"),
)  # fmt: skip
# Poses are tried this many used frames earlier and later.
MAX_SHIFT = 5
_SHIFTS = tuple(shift for shift in range(-MAX_SHIFT, MAX_SHIFT + 1) if shift)
# A convention explains as much as one that comes before it where it explains no more than this fraction more.
AS_MUCH = 0.02
# A step between two frames that follow each other is a jump where it is this many times the median step, and longer
# than this, metres: no camera that is carried covers it within a tenth of a second.
JUMP_STEPS, JUMP_M = 20.0, 0.5


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
        By the given poses; None where these leave too few pixels in view of both frames.
    still : float
        By a camera that never moves.
    moves : bool
        Whether the given poses differ from each other.
    convention : tuple of str
        The convention, of `POSE_CONVENTIONS`, in which the poses agree best.
    converted : float
        The fraction with it.
    shift : int
        The number of used frames by which poses agree best with earlier (negative: later) frames, none excluded.
    shifted : float
        The fraction with it.
    depth_factor : float
        The factor of the depth, of `DEPTH_FACTORS`, with which the given poses agree best.
    scaled : float
        The fraction with this factor.
    jump : Jump or None
        The largest one.
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
    """Return how well given poses explain the depth of the frames; None where too few pairs of frames tell.

    Parameters
    ----------
    read : callable
        Gives a frame by its number; raises FrameError where it cannot be used.
    intrinsics : Intrinsics
        Of its frames.
    T_world_camera : mapping of int to (4, 4) float64
        Given poses of the frames that were used.
    """
    frames = sorted(T_world_camera)
    if len(frames) <= GAPS[0]:
        return None
    poses = [T_world_camera[frame] for frame in frames]
    starts = sorted({int(k) for k in np.linspace(0, len(frames) - 1 - GAPS[0], STARTS)})
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
    """Return the motion T_b_a of the camera by each hypothesis: given, still, conventions, shifts, depth factors."""
    given = inverse(poses[b]) @ poses[a]
    motions: list[Float64Array | None] = [given, np.eye(4)]
    motions += [inverse(converted(poses[b], names)) @ converted(poses[a], names) for names in POSE_CONVENTIONS]
    for shift in _SHIFTS:
        there = a + shift >= 0 and b + shift < len(poses)
        motions.append(inverse(poses[b + shift]) @ poses[a + shift] if there else None)
    for factor in DEPTH_FACTORS:  # depth times a factor is the translation divided by it, all in units of the depth
        scaled = given.copy()
        scaled[:3, 3] /= factor
        motions.append(scaled)
    return motions


def _jump(
    read: Callable[[int], Frame], intrinsics: Intrinsics, frames: list[int], poses: list[Float64Array]
) -> Jump | None:
    """Return the largest step of the given poses where it is a jump: the frames look as if the camera had not moved."""
    steps = np.array([np.linalg.norm(b[:3, 3] - a[:3, 3]) for a, b in pairwise(poses)])
    largest = int(np.argmax(steps))
    if steps[largest] < max(JUMP_STEPS * float(np.median(steps)), JUMP_M):
        return None
    try:
        points, depth_m = _points(read(frames[largest]), intrinsics), read(frames[largest + 1]).depth_m
    except FrameError:
        return None
    moved = transform(inverse(poses[largest + 1]) @ poses[largest], points)
    by_given, by_still = (_agreement(seen, depth_m, intrinsics) or 0.0 for seen in (moved, points))
    return Jump(frames[largest + 1], float(steps[largest])) if by_still > max(2.0 * by_given, 0.5) else None


def _median(fractions: list[float | None]) -> float | None:
    """Return the median of the fractions of pairs; None where too few pairs have one."""
    known = [fraction for fraction in fractions if fraction is not None]
    return float(np.median(known)) if len(known) >= MIN_PAIRS else None


def _points(frame: Frame, K: Intrinsics) -> Float64Array:
    """Return points of a frame in its camera, (N, 3) metres."""
    step = max(1, K.width // COLUMNS)
    z = frame.depth_m[::step, ::step].astype(np.float64)
    rows, columns = np.indices(z.shape) * step
    xyz = np.stack([(columns - K.cx) / K.fx * z, (rows - K.cy) / K.fy * z, z], axis=-1)
    return np.asarray(xyz[z > 0], np.float64)


def _agreement(points: Float64Array, depth_m: Float32Array, K: Intrinsics) -> float | None:
    """Return the fraction of points, in the camera of a depth image, that lie where the image has its readings."""
    ahead = points[points[:, 2] > 0]
    columns = np.rint(K.fx * ahead[:, 0] / ahead[:, 2] + K.cx)
    rows = np.rint(K.fy * ahead[:, 1] / ahead[:, 2] + K.cy)
    inside = (columns >= 0) & (columns < K.width) & (rows >= 0) & (rows < K.height)
    read_m = depth_m[rows[inside].astype(np.intp), columns[inside].astype(np.intp)]
    z = ahead[inside, 2][read_m > 0]
    if len(z) < MIN_PIXELS:
        return None
    read_m = read_m[read_m > 0]
    return float((np.abs(read_m - z) < AGREE * z).mean())
