"""How much of each known object a frame sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.frame import Float64Array
from cuboid.objects.entry import MapObject
from cuboid.working import WorkingImage

# Points of an object that are looked up in a frame; more tell no more.
LOOKED_UP = 400
# A reading agrees with a point when it is within this, metres, or three standard deviations: pose error included.
AGREE_M = 0.03
# An object is seen when this share of its near side is, and so many of its points.
SEEN_SHARE, SEEN_POINTS = 0.1, 6


@dataclass(frozen=True, slots=True)
class View:
    """An object in a frame.

    Attributes
    ----------
    visible : float
        Share of its near side that is seen, 0..1.
    rect_xyxy : (4,) float64
        Rectangle of the whole object, hidden parts included, in pixels of the full image, clipped to it.
    seen : bool
    """

    visible: float
    rect_xyxy: Float64Array
    seen: bool


def in_view(boxes: Float64Array, image: WorkingImage, T_camera_world: Float64Array) -> npt.NDArray[np.int64]:
    """Return which boxes (N, 15), see `pack`, reach into the picture with their bounding spheres, ascending.

    A row of NaN is in no picture.
    """
    x, y, z = (boxes[:, :3] @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]).T
    radius = 0.5 * np.sqrt((boxes[:, 3:6] ** 2).sum(1))
    c = image.camera
    near = np.maximum(z, 0.05)
    reach_u, reach_v = radius / near * c.fx, radius / near * c.fy
    u, v = x / near * c.fx + c.cx, y / near * c.fy + c.cy
    inside = (z > 0.05) & (u + reach_u > 0) & (u - reach_u < c.width) & (v + reach_v > 0) & (v - reach_v < c.height)
    return np.flatnonzero(inside)


def look(
    objects: Sequence[MapObject],
    image: WorkingImage,
    pixel_owner: npt.NDArray[np.int32],
    T_camera_world: Float64Array,
    noise_per_m: float,
) -> list[View]:
    """Tell for each object how much of it this frame sees.

    A point counts as seen when the reading at its pixel agrees with it. One behind a reading of its own object is
    on the far side and counts not at all; one behind anything else is hidden. Of the points outside the picture or
    without a reading, half count as hidden: half of an object faces away.

    Parameters
    ----------
    pixel_owner : (h, w) int32
        Number of the object that each working pixel belongs to, 0 none.
    """
    if not objects:
        return []
    picks = [o.points[:: max(1, len(o.points) // LOOKED_UP)] for o in objects]
    which = np.repeat(np.arange(len(picks)), [len(p) for p in picks])
    points = np.concatenate(picks).astype(np.float64) @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]
    c = image.camera
    z = np.maximum(points[:, 2], 0.05)
    u, v = points[:, 0] / z * c.fx + c.cx, points[:, 1] / z * c.fy + c.cy
    ui, vi = np.rint(u).astype(np.int64), np.rint(v).astype(np.int64)
    inside = (points[:, 2] > 0.05) & (ui >= 0) & (vi >= 0) & (ui < c.width) & (vi < c.height)
    ui, vi = np.where(inside, ui, 0), np.where(inside, vi, 0)
    reading = np.where(inside, image.depth_m[vi, ui], 0.0)
    agree = np.maximum(AGREE_M, 3 * noise_per_m * z * z)
    numbers = np.array([o.number for o in objects])[which]
    seen = (reading > 0) & (np.abs(reading - z) <= agree)
    behind_own = (reading > 0) & (reading < z - agree) & (pixel_owner[vi, ui] == numbers)
    unknown = reading <= 0
    n = len(objects)
    seen_n = np.bincount(which[seen], minlength=n)
    unknown_n = np.bincount(which[unknown], minlength=n)
    hidden_n = np.bincount(which[~seen & ~behind_own & ~unknown], minlength=n)
    visible = seen_n / np.maximum(1.0, seen_n + hidden_n + 0.5 * unknown_n)
    front = points[:, 2] > 0.05
    return [
        View(
            visible=float(visible[k]),
            rect_xyxy=_rectangle(u[(which == k) & front], v[(which == k) & front], image),
            seen=bool(visible[k] >= SEEN_SHARE and seen_n[k] >= SEEN_POINTS),
        )
        for k in range(n)
    ]


def _rectangle(u: Float64Array, v: Float64Array, image: WorkingImage) -> Float64Array:
    if len(u) == 0:
        return np.zeros(4)
    (x, y), s = image.phase, image.step
    width, height = image.camera.width * s, image.camera.height * s
    x0, x1 = np.clip([u.min() * s + x, u.max() * s + x + s], 0, width)
    y0, y1 = np.clip([v.min() * s + y, v.max() * s + y + s], 0, height)
    return np.array([x0, y0, x1, y1])
