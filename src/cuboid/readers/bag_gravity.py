"""Where up is in a camera, from an accelerometer beside it: at rest it measures what holds it up against gravity."""

from __future__ import annotations

from typing import Any

import numpy as np

from cuboid.core.errors import FrameError
from cuboid.core.frame import Float64Array
from cuboid.readers.bag import Bag

# Measurements this far from a frame in time are averaged: half of a second makes a step of 0.1 m/s a tilt of 1 degree.
WINDOW_NS = 250_000_000
# Gravity, and how far from it a measurement may be while the camera hardly accelerates, m/s^2.
GRAVITY, MAX_OFF = 9.81, 1.5


class Gravity:
    """An accelerometer that was recorded in a bag.

    Parameters
    ----------
    bag : Bag
    topic : str
        Of ``sensor_msgs/Imu``.
    R_color_imu : (3, 3) float64
        Carries directions of the accelerometer to those of the color camera.
    """

    def __init__(self, bag: Bag, topic: str, R_color_imu: Float64Array) -> None:
        self._bag, self._topic, self._R_color_imu = bag, topic, R_color_imu

    def up_at(self, time_ns: int) -> Float64Array:
        """Return the direction away from the earth's pull (3,) in the color camera when a frame was logged.

        Raises
        ------
        FrameError
            If nothing was measured then, or the camera was being shaken.
        """
        messages = self._bag.between(self._topic, time_ns - WINDOW_NS, time_ns + WINDOW_NS)
        if not messages:
            raise FrameError(f"{self._topic} has no measurement within {WINDOW_NS * 1e-6:g} ms")
        mean = np.mean([acceleration(message) for message in messages], axis=0)
        size = float(np.linalg.norm(mean))
        if not abs(size - GRAVITY) <= MAX_OFF:
            raise FrameError(f"{self._topic} measures {size:.3g} m/s^2, which is not gravity alone")
        return np.asarray(self._R_color_imu @ mean / size, np.float64)


def measures_gravity(message: Any) -> bool:
    """Tell whether a message holds an acceleration, not rates of turn alone."""
    return bool(abs(float(np.linalg.norm(acceleration(message))) - GRAVITY) <= 2 * MAX_OFF)


def acceleration(message: Any) -> Float64Array:
    """Return the acceleration (3,) of a message, m/s^2."""
    one = message.linear_acceleration
    return np.array((one.x, one.y, one.z), np.float64)
