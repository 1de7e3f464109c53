"""Timed poses, and the pose between two of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.geometry import se3

# Maximum gap (seconds) between two poses for interpolation: a hand-held camera's
# acceleration of 2 m/s^2 makes that wrong by a t^2 / 8 = 2.5 mm, the noise of depth at 1.3 m.
MAX_INTERPOLATED_S = 0.1
# Elsewhere the nearest pose is used if it is within this time (seconds): at 0.25 m/s, TUM fr1/xyz's mean, 5 mm.
NEAREST_POSE_S = 0.02


class PoseStream:
    """Poses at increasing times.

    Parameters
    ----------
    name : str
        Of their source, for messages.
    times_s : (N,) float64
    T_world_camera : sequence of (4, 4) float64
    largest_gap_s : float
        Maximum gap between two poses for interpolation.
    """

    def __init__(
        self,
        name: str,
        times_s: Float64Array,
        T_world_camera: Sequence[Float64Array],
        largest_gap_s: float = MAX_INTERPOLATED_S,
    ) -> None:
        self._name, self._times_s, self._poses, self._largest_gap_s = name, times_s, T_world_camera, largest_gap_s

    def at(self, time_s: float) -> Float64Array:
        """Return T_world_camera (4, 4) at a time.

        The pose is interpolated between neighbours at most `largest_gap_s` apart, else it is the nearest one within
        `NEAREST_POSE_S`.

        Raises
        ------
        FrameError
            If no pose is near enough in time.
        """
        after = int(np.searchsorted(self._times_s, time_s))
        last = len(self._times_s) - 1
        if 0 < after <= last and self._times_s[after] - self._times_s[after - 1] <= self._largest_gap_s:
            t0, t1 = self._times_s[after - 1], self._times_s[after]
            return se3.interpolate(self._pose(after - 1), self._pose(after), float((time_s - t0) / (t1 - t0)))
        near = min((max(after - 1, 0), min(after, last)), key=lambda k: abs(self._times_s[k] - time_s))
        away_s = abs(float(self._times_s[near]) - time_s)
        if away_s > NEAREST_POSE_S:
            raise FrameError(
                f"no camera pose at {time_s:.3f} s: the nearest in {self._name} is {away_s:.3f} s away "
                f"(at most {NEAREST_POSE_S:g} s, or between two at most {self._largest_gap_s:g} s apart)"
            )
        return self._pose(near)

    def _pose(self, k: int) -> Float64Array:
        return self._poses[k]
