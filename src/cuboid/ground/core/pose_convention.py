"""Conversion of camera poses to our convention (T_world_camera in metres, x right, y down, z forward)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.geometry.se3 import compose, inverse, quat_wxyz_from_rotation

# From a camera with y down and z forward to one with y up and z backward.
T_OPENCV_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def _inverse(T: Float64Array) -> Float64Array:
    return inverse(T)


def _opengl(T: Float64Array) -> Float64Array:
    return np.asarray(T @ T_OPENCV_OPENGL, np.float64)


def _wxyz(T: Float64Array) -> Float64Array:
    w, x, y, z = quat_wxyz_from_rotation(T[:3, :3])  # the file's numbers x y z w are w x y z
    return compose((x, y, z, w), T[:3, 3])


def _xyzw(T: Float64Array) -> Float64Array:
    w, x, y, z = quat_wxyz_from_rotation(T[:3, :3])  # the file's numbers w x y z are x y z w
    return compose((z, w, x, y), T[:3, 3])


def _scaled(metres: float) -> Callable[[Float64Array], Float64Array]:
    def convert(T: Float64Array) -> Float64Array:
        return np.block([[T[:3, :3], metres * T[:3, 3:]], [T[3:]]])

    return convert


# Conventions of a recording's poses, with their conversions, in the order of application. `wxyz` and `xyzw` are the
# order of quaternions in the file, if it differs from the format's.
CONVENTIONS: dict[str, Callable[[Float64Array], Float64Array]] = {
    "wxyz": _wxyz,
    "xyzw": _xyzw,
    "mm": _scaled(0.001),
    "cm": _scaled(0.01),
    "inverse": _inverse,
    "opengl": _opengl,
}

# Description of each convention for the user.
MEANT = {
    "inverse": "inverted (world to camera)",
    "opengl": "those of a camera with y up and z backward",
    "mm": "in millimetres",
    "cm": "in centimetres",
    "wxyz": "quaternions with w first",
    "xyzw": "quaternions with w last",
}
# Conventions of poses that are tried, simple ones first: of two that explain equally much, the first one is reported.
POSE_CONVENTIONS = (
    ("inverse",),
    ("opengl",),
    ("inverse", "opengl"),
    ("mm",),
    ("cm",),
    ("wxyz",),
    ("xyzw",),
    ("mm", "inverse"),
    ("mm", "opengl"),
    ("cm", "inverse"),
    ("cm", "opengl"),
    ("wxyz", "inverse"),
    ("wxyz", "opengl"),
    ("xyzw", "inverse"),
    ("xyzw", "opengl"),
    ("wxyz", "mm"),
    ("xyzw", "mm"),
)


def convention_names(text: str) -> tuple[str, ...]:
    """Return the names of conventions in a text such as "inverse,mm", in the order in which they are applied.

    Raises
    ------
    InputError
        A name is not in `CONVENTIONS`, or two exclude each other.
    """
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in CONVENTIONS:
            raise InputError(f"a pose convention is one of {', '.join(CONVENTIONS)}, or several, got {shown(name)}")
    for one, other in (("wxyz", "xyzw"), ("mm", "cm")):
        if one in names and other in names:
            raise InputError(f"poses are {one} or {other}, not both: {shown(text)}")
    return tuple(name for name in CONVENTIONS if name in names)


def converted(T: Float64Array, names: tuple[str, ...]) -> Float64Array:
    """Return T_world_camera (4, 4) of a pose that was read in the named conventions."""
    for name in names:
        T = CONVENTIONS[name](T)
    return T


def advised(names: tuple[str, ...], fits: str) -> str:
    """Return the warning that given poses are in the named conventions; `fits` says how well they fit then."""
    meant = " and ".join(MEANT[name] for name in names)
    return (
        f"the given poses are {meant}: with this convention, {fits}; run again with --pose-convention {','.join(names)}"
    )
