"""What has the size of an object."""

from __future__ import annotations

import numpy as np

from cuboid.config import TrackerConfig
from cuboid.geometry.box import Box

# An object rises at least so many times the least size above what it stands on: flatter is the noise of a plane.
LEAST_HEIGHT = 0.6
# A box this thin, metres, is a sheet of noise.
SHEET_M = 0.008


def fits_object(box: Box, config: TrackerConfig) -> bool:
    """Tell whether a box has the size of an object, as configured."""
    shortest, middle, _ = np.sort(box.size)
    return bool(
        middle >= config.min_size_m
        and shortest >= SHEET_M
        and box.size[2] >= LEAST_HEIGHT * config.min_size_m
        and not too_large(box, config)
    )


def too_large(box: Box, config: TrackerConfig) -> bool:
    """Tell whether a box is larger than an object may be."""
    return bool(box.size.max() > config.max_size_m)
