"""Limits on the size of objects."""

from __future__ import annotations

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.geometry.box import Box


def fits_object(box: Box, config: TrackerConfig) -> bool:
    """Return whether a box has the size of an object, as configured."""
    sizes = box.size.tolist()  # Python numbers are faster than NumPy for three values
    shortest, middle, _ = sorted(sizes)
    return bool(
        middle >= config.min_size_m
        # A thinner object may be noise, and so may one that rises by less than the noise of its plane and its own.
        and shortest >= config.min_height_m
        and sizes[2] >= 2.0 * config.min_height_m
        and not too_large(box, config)
    )


def too_large(box: Box, config: TrackerConfig) -> bool:
    """Return whether a box is larger than an object may be."""
    return bool(max(box.size.tolist()) > config.max_size_m)
