"""Propagation of rectangles from one frame to another, by camera poses and depth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.se3 import inverse, transform
from cuboid.inputs.readers.recording import Recording

# Margin that is cut off each side of a rectangle before depth is read, as a fraction: other objects show near the
# sides.
MIDDLE = 0.25
# Minimum depth that a sensor measures, metres.
MIN_DEPTH_M = 0.05
# Minimum fraction of a rectangle inside the picture; below it the object has left the picture.
MIN_LEFT = 0.15

Rect = tuple[int, int, int, int]


def propagated(recording: Recording, source: int, target: int, rects: Sequence[Float64Array]) -> list[Rect | None]:
    """Return the expected positions of one frame's rectangles in another frame.

    The middle of a rectangle moves as the 3D point there does, and its size scales with the distance. If a pose or all
    depth is missing, a rectangle stays unchanged, and a person corrects it.

    Parameters
    ----------
    recording : Recording
    source, target : int
        Frames of the recording.
    rects : sequence of (4,) float64
        Rectangles in the source frame, pixels, ends exclusive.

    Returns
    -------
    list of (x0, y0, x1, y1) or None
        Rectangles clipped to the picture; None for objects that have left it.
    """
    try:
        T_world_target = recording.pose(target)
        frame = recording.read(source)
    except FrameError:
        T_world_target = None
    if T_world_target is None or frame.T_world_camera is None:
        return [_whole(rect) for rect in rects]
    T_target_source = inverse(T_world_target) @ frame.T_world_camera
    return [_propagated(rect, frame.depth_m, T_target_source, recording.intrinsics) for rect in rects]


def _propagated(
    rect: Float64Array, depth_m: Float32Array, T_target_source: Float64Array, intrinsics: Intrinsics
) -> Rect | None:
    K, z = intrinsics, _depth_of(rect, depth_m)
    if z is None:
        return _whole(rect)
    middle, half = (rect[:2] + rect[2:]) / 2.0, (rect[2:] - rect[:2]) / 2.0
    moved = transform(T_target_source, K.points(middle[0], middle[1], z))
    if moved[2] < MIN_DEPTH_M:
        return None
    center = K.pixels(moved)
    low, high = center - half * z / moved[2], center + half * z / moved[2]
    inside = np.clip((low, high), 0.0, (K.width, K.height))
    if np.prod(inside[1] - inside[0]) < MIN_LEFT * np.prod(high - low):
        return None
    return _whole(inside.ravel())


def _depth_of(rect: Float64Array, depth_m: Float32Array) -> float | None:
    """Return the median depth in the middle of a rectangle; None if there is no reading."""
    inset = MIDDLE * (rect[2:] - rect[:2])
    x0, y0, x1, y1 = np.round((*(rect[:2] + inset), *(rect[2:] - inset))).astype(int)
    part = depth_m[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)]
    measured = part[np.isfinite(part) & (part > MIN_DEPTH_M)]
    return float(np.median(measured)) if len(measured) else None


def _whole(rect: Float64Array) -> Rect | None:
    x0, y0, x1, y1 = (int(value) for value in np.round(rect))
    return (x0, y0, x1, y1) if x1 > x0 and y1 > y0 else None
