"""Wrong poses or moving objects: whether another motion between two frames explains more than the given one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.tolerances import JUMP_M, JUMP_SIGMAS
from cuboid.ground.geometry.se3 import transform
from cuboid.method.poses.alignment import Reference, align
from cuboid.method.poses.keyframes import pixels_of
from cuboid.method.poses.pyramid import Level

# Finest level of the image pyramid: the motion is found and judged there.
FINEST = 1
# Poses are wrong if another motion of the whole image leaves less than this fraction of the points that disagree. If a
# hand moves, the best motion leaves .9 and more; if poses are wrong by 3 to 26 cm, it leaves .1 to .4.
UNEXPLAINED = 0.5
# Two intensities agree if they differ by at most this number of gray levels: light changes as the camera moves.
MAX_INTENSITY_DIFFERENCE = 24


def true_motion(
    earlier: Reference,
    levels: Sequence[Level],
    T_claimed: Float64Array,
    T_start: Float64Array,
    noise_per_m: float,
) -> Float64Array | None:
    """Return T_view_earlier (4, 4) if the claimed one is wrong; None if it is right, or the frames do not show it.

    Parameters
    ----------
    earlier : Reference
        Points of the earlier frame.
    levels : sequence of Level
        The later frame, the view, finest first.
    T_claimed : (4, 4) float64
        T_view_earlier by the poses.
    T_start : (4, 4) float64
        Start of the search: T_view_earlier of the frame before the view.
    noise_per_m : float
        Standard deviation of depth is this times z squared.
    """
    found = align(earlier, levels, T_start, finest=FINEST)
    if not found.reliable:
        return None
    claimed, left = (
        _disagreeing(earlier, levels[FINEST], T, found.shade[0], noise_per_m)
        for T in (T_claimed, found.T_camera_reference)
    )
    return found.T_camera_reference if left < UNEXPLAINED * claimed else None


def _disagreeing(
    earlier: Reference, level: Level, T_view_earlier: Float64Array, shade: Float64Array, noise_per_m: float
) -> float:
    """Return the fraction of points in view with a reading of another depth or intensity."""
    old_level = earlier.levels[FINEST]
    points = transform(T_view_earlier, old_level.points)
    shown, u, v = pixels_of(points, level)
    intensity, _, _, depth_m = level.image[v, u].T
    read, z = depth_m > 0, points[shown, 2]
    elsewhere = np.abs(depth_m - z) > JUMP_M + JUMP_SIGMAS * noise_per_m * z * z
    unlike = np.abs(intensity - (shade[0] * old_level.intensity[shown] + shade[1])) > MAX_INTENSITY_DIFFERENCE
    return int(np.count_nonzero(read & (elsewhere | unlike))) / max(1, int(np.count_nonzero(read)))
