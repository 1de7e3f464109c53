"""A table with two things on it, cast ray by ray: furniture whose box is known."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cuboid.ground.core.frame import Frame
from made_scenes import CAMERA, frame_of, look_at, upright, write_plain

LENGTH_M, WIDTH_M, HEIGHT_M = 1.1, 0.7, 0.6
THICK_M, LEG_M = 0.04, 0.06
FLOOR = upright((0.0, 0.0), (5.0, 5.0, 0.1), z=-0.1)
TOP = upright((0.0, 0.0), (LENGTH_M, WIDTH_M, THICK_M), z=HEIGHT_M - THICK_M)
LEGS = tuple(
    upright((a * (LENGTH_M - LEG_M) / 2, b * (WIDTH_M - LEG_M) / 2), (LEG_M, LEG_M, HEIGHT_M - THICK_M))
    for a in (-1, 1)
    for b in (-1, 1)
)
THINGS = (
    upright((-0.3, 0.05), (0.2, 0.14, 0.16), 0.3, z=HEIGHT_M),
    upright((0.25, -0.1), (0.12, 0.12, 0.22), 0.8, z=HEIGHT_M),
)
# The box of the table, (3,) each: where its middle is, and its sides in order of size.
CENTER_M, SIDES_M = np.array([0.0, 0.0, HEIGHT_M / 2]), np.array([HEIGHT_M, WIDTH_M, LENGTH_M])


def table_frames(count: int = 24, first_angle: float = 0.0) -> Iterator[Frame]:
    """Iterate over frames of a camera that goes once round the table."""
    for k in range(count):
        angle = first_angle + 2 * np.pi * k / count
        eye = (1.7 * np.cos(angle), 1.7 * np.sin(angle), 1.25)
        yield frame_of((FLOOR, TOP, *LEGS, *THINGS), look_at(eye, (0.0, 0.0, 0.35)), k)


def write_table(path: Path, count: int = 24, first_angle: float = 0.0) -> Path:
    """Write the frames as a recording in the plain layout."""
    return write_plain(path, CAMERA, table_frames(count, first_angle))
