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
# A color agrees with a point's when no channel is farther off than this, of 255: noise, exposure, texture finer than
# a voxel.
ALIKE = 30
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


def in_view(
    boxes: Float64Array, image: WorkingImage, T_camera_world: Float64Array, far_m: float
) -> npt.NDArray[np.int64]:
    """Return which boxes (N, 15), see `pack`, reach into the picture, and so near, with their spheres, ascending.

    A row of NaN is in no picture.
    """
    x, y, z = (boxes[:, :3] @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]).T
    radius = 0.5 * np.sqrt((boxes[:, 3:6] ** 2).sum(1))
    c = image.camera
    near = np.maximum(z, 0.05)
    reach_u, reach_v = radius / near * c.fx, radius / near * c.fy
    u, v = x / near * c.fx + c.cx, y / near * c.fy + c.cy
    inside = (
        (z > 0.05)
        & (z - radius < far_m)
        & (u + reach_u > 0)
        & (u - reach_u < c.width)
        & (v + reach_v > 0)
        & (v - reach_v < c.height)
    )
    return np.flatnonzero(inside)


def look(
    objects: Sequence[MapObject],
    image: WorkingImage,
    pixel_owner: npt.NDArray[np.int32],
    T_camera_world: Float64Array,
    noise_per_m: float,
) -> list[View]:
    """Tell for each object how much of it this frame sees.

    A point counts as seen when the reading at its pixel agrees with it; where there is none (in the shadow of what
    stands before it, on what is dark or shines), when the color does. One behind a reading of its own object is
    on the far side and counts not at all; one behind anything else is hidden. Of the points outside the picture or
    without a reading, half count as hidden: half of an object faces away.

    Parameters
    ----------
    pixel_owner : (h, w) int32
        Number of the object that each working pixel belongs to, 0 none.
    """
    if not objects:
        return []
    steps = [max(1, len(o.points) // LOOKED_UP) for o in objects]
    picks = [o.points[::step] for o, step in zip(objects, steps, strict=True)]
    colors = np.concatenate([o.colors[::step] for o, step in zip(objects, steps, strict=True)])
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
    numbers = np.repeat([o.number for o in objects], [len(p) for p in picks])
    seen = (reading > 0) & (np.abs(reading - z) <= agree)
    blind = np.flatnonzero(inside & (reading <= 0))
    seen[blind] = np.abs(image.color[vi[blind], ui[blind]].astype(np.int16) - colors[blind]).max(1) <= ALIKE
    behind_own = (reading > 0) & (reading < z - agree) & (pixel_owner[vi, ui] == numbers)
    unknown = (reading <= 0) & ~seen
    n = len(objects)
    seen_n = np.bincount(which[seen], minlength=n)
    unknown_n = np.bincount(which[unknown], minlength=n)
    hidden_n = np.bincount(which[~seen & ~behind_own & ~unknown], minlength=n)
    visible = seen_n / np.maximum(1.0, seen_n + hidden_n + 0.5 * unknown_n)
    seen_enough = (visible >= SEEN_SHARE) & (seen_n >= SEEN_POINTS)
    rectangles = _rectangles(np.column_stack([u, v]), points[:, 2] > 0.05, [len(p) for p in picks], image)
    return [View(float(visible[k]), rectangles[k], bool(seen_enough[k])) for k in range(n)]


def _rectangles(
    pixels: Float64Array, front: npt.NDArray[np.bool_], sizes: Sequence[int], image: WorkingImage
) -> Float64Array:
    """Return the rectangle (n, 4) of each run of pixels (N, 2) that lies in front of the camera, zeros where none."""
    starts = np.cumsum([0, *sizes[:-1]])
    low = np.minimum.reduceat(np.where(front[:, None], pixels, np.inf), starts)
    high = np.maximum.reduceat(np.where(front[:, None], pixels, -np.inf), starts)
    none = ~np.logical_or.reduceat(front, starts)
    full = np.array([image.camera.width, image.camera.height]) * image.step
    corner = np.array(image.phase)
    first = np.clip(low * image.step + corner, 0, full)
    last = np.clip(high * image.step + corner + image.step, 0, full)
    rectangles = np.column_stack([first, last])
    rectangles[none] = 0.0
    return rectangles
