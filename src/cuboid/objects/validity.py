"""What counts as an object."""

from __future__ import annotations

import numpy as np

from cuboid.config import TrackerConfig
from cuboid.frame import Float64Array
from cuboid.geometry.box import Box

# What floats higher than this above its plane does not rest on it, metres: below that a plane's noise floor and an
# object's own belly hide its foot. The far wall of a bowl, seen over its rim, floats higher.
FLOAT_M = 0.035
# An object rises at least so many times the least size above what it stands on: flatter is the noise of a plane.
LEAST_HEIGHT = 0.9
# A box this thin, metres, is a sheet of noise.
SHEET_M = 0.008


def is_object(box: Box, config: TrackerConfig) -> bool:
    """Tell whether a box has the size of an object, as configured."""
    shortest, middle, longest = np.sort(box.size)
    return bool(
        middle >= config.min_size_m
        and longest <= config.max_size_m
        and shortest >= SHEET_M
        and box.size[2] >= LEAST_HEIGHT * config.min_size_m
    )


def rests(box: Box, plane: tuple[Float64Array, float] | None) -> bool:
    """Tell whether a box stands on its plane (normal, offset), or stands on nothing known."""
    if plane is None:
        return True
    normal, offset = plane
    return bool(float(normal @ box.center) + offset - box.size[2] / 2 <= FLOAT_M)
