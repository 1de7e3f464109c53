"""Whether given camera poses explain the depth of the frames, or explain it better inverted or at another scale."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cuboid.core.errors import FrameError
from cuboid.core.frame import Float32Array, Float64Array, Frame, Intrinsics
from cuboid.geometry.se3 import inverse, transform

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


@dataclass(frozen=True, slots=True)
class PoseFit:
    """Fractions of the pixels whose depth agrees in two frames, median over pairs of frames.

    Attributes
    ----------
    given : float or None
        By the given poses; None where these leave too few pixels in view of both frames.
    inverted : float
        By their inverses: world to camera taken for camera to world.
    still : float
        By a camera that never moves.
    depth_factor : float
        The factor of the depth, of `DEPTH_FACTORS`, with which the given poses agree best.
    scaled : float
        The fraction with this factor.
    """

    given: float | None
    inverted: float
    still: float
    depth_factor: float
    scaled: float


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
    starts = sorted({int(k) for k in np.linspace(0, len(frames) - 1 - GAPS[0], STARTS)})
    rows = []
    for start in starts:
        try:
            points = _points(read(frames[start]), intrinsics)
        except FrameError:
            continue
        for later in (frames[start + gap] for gap in GAPS if start + gap < len(frames)):
            try:
                depth_m = read(later).depth_m
            except FrameError:
                continue
            rows.append(_agreements(points, depth_m, intrinsics, T_world_camera[frames[start]], T_world_camera[later]))
    if not rows:
        return None
    given, inverted, still, *scaled = (_median(list(column)) for column in zip(*rows, strict=True))
    if given is None and not any(scaled):
        return None
    factors = [factor or 0.0 for factor in scaled]
    best = int(np.argmax(factors))
    return PoseFit(given, inverted or 0.0, still or 0.0, DEPTH_FACTORS[best], factors[best])


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


def _agreements(
    points: Float64Array, depth_m: Float32Array, K: Intrinsics, T_world_a: Float64Array, T_world_b: Float64Array
) -> list[float | None]:
    """Return the fraction of agreeing pixels by each hypothesis on the motion, None where too few pixels tell."""
    T_b_a, T_inverted = inverse(T_world_b) @ T_world_a, T_world_b @ inverse(T_world_a)
    hypotheses = [T_b_a, T_inverted, np.eye(4)]
    for factor in DEPTH_FACTORS:  # depth times a factor is the translation divided by it, all in units of the depth
        scaled = T_b_a.copy()
        scaled[:3, 3] /= factor
        hypotheses.append(scaled)
    return [_agreement(transform(T, points), depth_m, K) for T in hypotheses]


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
