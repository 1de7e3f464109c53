"""Up in the camera from an accelerometer: at rest it measures the reaction to gravity, which points up."""

from __future__ import annotations

from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.inputs.readers.bag import Bag

# Measurements within this time of a frame are averaged: over half a second, a velocity change of 0.1 m/s causes a tilt
# of 1 degree.
WINDOW_NS = 250_000_000
# Gravity, and maximum deviation of a measurement while the camera hardly accelerates, m/s^2.
GRAVITY, MAX_OFF = 9.81, 1.5


class Gravity:
    """An accelerometer whose measurements are in a bag.

    Parameters
    ----------
    bag : Bag
    topic : str
        Topic of ``sensor_msgs/Imu``.
    R_color_imu : (3, 3) float64
        Rotation from the accelerometer's axes to the color camera's.
    """

    def __init__(self, bag: Bag, topic: str, R_color_imu: Float64Array) -> None:
        self._bag, self._topic, self._R_color_imu = bag, topic, R_color_imu

    def up_at(self, time_ns: int) -> Float64Array:
        """Return up (opposite to gravity), (3,), in the color camera at the log time of a frame.

        Raises
        ------
        FrameError
            There are no measurements at that time, or the camera was shaken.
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
    """Tell whether a message contains an acceleration, not only angular velocities."""
    return bool(abs(float(np.linalg.norm(acceleration(message))) - GRAVITY) <= 2 * MAX_OFF)


def acceleration(message: Any) -> Float64Array:
    """Return the acceleration (3,) of a message, m/s^2."""
    one = message.linear_acceleration
    return np.array((one.x, one.y, one.z), np.float64)
