"""The last sighting of an object: where the camera was, and what the frames after it show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime

import numpy as np
from numpy.linalg import norm

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.services.queries.answers import Seen, Vector

# Times from this one on (2001) are calendar times; the times of cameras that start at zero stay below it for 30 years.
CALENDAR_S = 1.0e9


def seen_from(
    frame: int,
    box: Box,
    *,
    recording: int | None = None,
    time_s: float | None = None,
    camera: str | None = None,
    T_world_camera: Float64Array | None = None,
) -> Seen:
    """Return a sighting of a box (in the world); time and pose are those of the frame, if they are known."""
    time = None if time_s is None else calendar_time(time_s)
    if T_world_camera is None:
        return Seen(frame, recording, time, camera)
    place = T_world_camera[:3, 3]
    return Seen(frame, recording, time, camera, vector(place), round(float(norm(place - box.center)), 3))


def frames_that_show(
    box: Box, poses: Mapping[int, Float64Array], after: int, intrinsics: Intrinsics, far_m: float
) -> list[int]:
    """Return the frames after a given one whose picture has the place of a whole box, nearer than the depth limit.

    Parameters
    ----------
    box : Box
        In the world.
    poses : mapping of int to (4, 4) float64
        T_world_camera by frame.
    after : int
    intrinsics : Intrinsics
    far_m : float
        Largest depth that the run used, metres.
    """
    frames = [frame for frame in poses if frame > after]
    if not frames:
        return []
    T = np.stack([poses[frame] for frame in frames])
    # corners in the camera: the rotation of a camera pose is inverted by its transpose
    xyz = np.einsum("nji,nkj->nki", T[:, :3, :3], box.corners()[None] - T[:, None, :3, 3])
    depth = xyz[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = intrinsics.fx * xyz[..., 0] / depth + intrinsics.cx
        v = intrinsics.fy * xyz[..., 1] / depth + intrinsics.cy
    inside = (depth > 0) & (depth <= far_m) & (u >= 0) & (v >= 0) & (u < intrinsics.width) & (v < intrinsics.height)
    return [frames[k] for k in np.flatnonzero(inside.all(axis=1))]


def calendar_time(seconds: float) -> str | None:
    """Return a time as ISO 8601, UTC; None if it is not a calendar time."""
    if seconds < CALENDAR_S:
        return None
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")


def vector(values: Float64Array | Iterable[float]) -> Vector:
    """Return three numbers, rounded to a micrometre."""
    x, y, z = (round(float(value), 6) for value in values)
    return x, y, z
