"""A view of an object, which is the part of a frame that shows it, and the selection of frames to fuse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.tolerances import NEAREST_M
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou_matrix, pack

Number = TypeVar("Number", Float32Array, Float64Array)
Pixels = npt.NDArray[np.int64]

# Margin of the fused volume around the box, metres: boxes have errors of a voxel, and a mesh must end in free space.
MARGIN_M = 0.01
# Margin of a view, pixels: the normals at the border of the object need it.
RIM_PIXELS = 6
# Minimum visible fraction of the object's near side in a view: a view with less mainly shows the occluder.
MIN_VISIBLE = 0.3
# Maximum number of fused views: 48 views reduce the noise to a seventh, and more views only add time.
MAX_FUSED_VIEWS = 48


@dataclass(frozen=True, slots=True, eq=False)
class ObjectView:
    """The part of a frame that shows an object.

    Attributes
    ----------
    depth_m : (h, w) float32
        Depth, metres; 0 for no reading.
    color : (h, w, 3) uint8
        RGB.
    camera : Intrinsics
        Intrinsics of this part of the image.
    T_world_camera : (4, 4) float64
    """

    depth_m: Float32Array
    color: UInt8Array
    camera: Intrinsics
    T_world_camera: Float64Array


def pixels_of(camera: Intrinsics, x: Number, y: Number, z: Number) -> tuple[Pixels, Pixels, npt.NDArray[np.bool_]]:
    """Project points; return the nearest pixels u and v, and a mask of the points within the image.

    Parameters
    ----------
    camera : Intrinsics
    x, y, z : array of float32 or float64
        Coordinates in the camera frame, metres, all of one shape; the computation has their precision.
    """
    number = z.dtype.type
    deep = np.maximum(z, number(NEAREST_M))
    u = np.rint(number(camera.fx) * x / deep + number(camera.cx)).astype(np.int64)
    v = np.rint(number(camera.fy) * y / deep + number(camera.cy)).astype(np.int64)
    return u, v, (z > NEAREST_M) & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A frame that shows an object.

    Attributes
    ----------
    frame : int
    box : Box
        The object's box after that frame.
    visible : float
        Visible fraction of the object's near side, 0..1.
    T_world_camera : (4, 4) float64
    """

    frame: int
    box: Box
    visible: float
    T_world_camera: Float64Array


def view_of(frame: Frame, camera: Intrinsics, T_world_camera: Float64Array, box: Box) -> ObjectView | None:
    """Return the part of a frame that shows a box with its margin; None if the box is not in view."""
    rectangle = window(box, camera, T_world_camera)
    if rectangle is None:
        return None
    x0, y0, x1, y1 = rectangle
    part = replace(camera, cx=camera.cx - x0, cy=camera.cy - y0, width=x1 - x0, height=y1 - y0)
    return ObjectView(frame.depth_m[y0:y1, x0:x1].copy(), frame.color[y0:y1, x0:x1].copy(), part, T_world_camera)


def window(box: Box, camera: Intrinsics, T_world_camera: Float64Array) -> tuple[int, int, int, int] | None:
    """Return the rectangle x0, y0, x1, y1 (ends exclusive) that a box with its margin covers in an image, or None."""
    grown = replace(box, size=box.size + 2 * MARGIN_M)
    corners = se3.transform(se3.inverse(T_world_camera), grown.corners())
    if (corners[:, 2] < NEAREST_M).any():
        return None
    u, v = camera.pixels(corners).T
    x0, y0 = (max(0, int(np.floor(side.min())) - RIM_PIXELS) for side in (u, v))
    x1 = min(camera.width, int(np.ceil(u.max())) + 1 + RIM_PIXELS)
    y1 = min(camera.height, int(np.ceil(v.max())) + 1 + RIM_PIXELS)
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None


def chosen(candidates: Sequence[Candidate], box: Box, most: int | None = None) -> list[Candidate]:
    """Select the frames to fuse, in order: frames after the object's last move, from many different sides.

    The first selected frame is the best view. Each further frame maximises the angle to the selected frames, weighted
    by its quality.

    Parameters
    ----------
    candidates : sequence of Candidate
        Candidates in the order of their frames.
    box : Box
        Final box of the object.
    most : int, optional
        Maximum number of frames; default `MAX_FUSED_VIEWS`.
    """
    most = most or MAX_FUSED_VIEWS
    here = [one for one in _since_it_stands(candidates, box) if one.visible >= MIN_VISIBLE]
    if len(here) <= most:
        return here
    towards = np.array([one.T_world_camera[:3, 3] - box.center for one in here])
    distance_m = np.linalg.norm(towards, axis=1)
    towards /= distance_m[:, None]
    # Noise grows with the square of the distance.
    quality = np.array([one.visible for one in here]) * (distance_m.min() / distance_m) ** 2
    taken = [int(np.argmax(quality))]
    apart = np.full(len(here), np.inf)
    for _ in range(most - 1):
        apart = np.minimum(apart, 1.0 - towards @ towards[taken[-1]])
        apart[taken] = 0.0
        taken.append(int(np.argmax(apart * quality)))
    return [here[k] for k in sorted(set(taken))]


def _since_it_stands(candidates: Sequence[Candidate], box: Box) -> list[Candidate]:
    """Return the candidates after the last one whose box does not overlap the final box."""
    if not candidates:
        return []
    common = iou_matrix(pack([one.box for one in candidates]), pack([box]))[:, 0]
    elsewhere = np.flatnonzero(common <= 0)
    return list(candidates[int(elsewhere[-1]) + 1 if len(elsewhere) else 0 :])
