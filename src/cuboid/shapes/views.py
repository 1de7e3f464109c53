"""A view of an object: the part of a frame that shows it; which frames to take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cuboid.core.frame import Float32Array, Float64Array, Frame, Intrinsics, UInt8Array
from cuboid.core.tolerances import NEAREST_M
from cuboid.geometry import se3
from cuboid.geometry.box import Box
from cuboid.geometry.overlap import iou_matrix, pack

# What is fused reaches this far beyond the box, metres: boxes err by a voxel of the map, and a mesh ends in the open.
MARGIN_M = 0.01
# Pixels around them: for the normals at their rim.
RIM_PIXELS = 6
# A view shows at least this fraction of the object's near side: less is a view of what hides it.
MIN_VISIBLE = 0.3
# Views fused: their noise is averaged to a seventh, and more add time alone.
MAX_VIEWS = 48


@dataclass(frozen=True, slots=True, eq=False)
class ObjectView:
    """The part of a frame that shows an object.

    Attributes
    ----------
    depth_m : (h, w) float32
        Metres, 0 none.
    color : (h, w, 3) uint8
        RGB.
    camera : Intrinsics
        Of this part.
    T_world_camera : (4, 4) float64
    """

    depth_m: Float32Array
    color: UInt8Array
    camera: Intrinsics
    T_world_camera: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A frame that saw an object.

    Attributes
    ----------
    frame : int
    box : Box
        The object's box after that frame.
    visible : float
        Fraction of its near side that is seen, 0..1.
    T_world_camera : (4, 4) float64
    """

    frame: int
    box: Box
    visible: float
    T_world_camera: Float64Array


def view_of(frame: Frame, camera: Intrinsics, T_world_camera: Float64Array, box: Box) -> ObjectView | None:
    """Return the part of a frame that shows a box with its margin; None where it shows none of it."""
    rectangle = window(box, camera, T_world_camera)
    if rectangle is None:
        return None
    x0, y0, x1, y1 = rectangle
    part = replace(camera, cx=camera.cx - x0, cy=camera.cy - y0, width=x1 - x0, height=y1 - y0)
    return ObjectView(frame.depth_m[y0:y1, x0:x1].copy(), frame.color[y0:y1, x0:x1].copy(), part, T_world_camera)


def window(box: Box, camera: Intrinsics, T_world_camera: Float64Array) -> tuple[int, int, int, int] | None:
    """Return the pixels x0, y0, x1, y1 (ends exclusive) of an image that a box with its margin covers, or None."""
    grown = replace(box, size=box.size + 2 * MARGIN_M)
    corners = se3.transform(se3.inverse(T_world_camera), grown.corners())
    if (corners[:, 2] < NEAREST_M).any():
        return None
    u = camera.fx * corners[:, 0] / corners[:, 2] + camera.cx
    v = camera.fy * corners[:, 1] / corners[:, 2] + camera.cy
    x0, y0 = (max(0, int(np.floor(side.min())) - RIM_PIXELS) for side in (u, v))
    x1 = min(camera.width, int(np.ceil(u.max())) + 1 + RIM_PIXELS)
    y1 = min(camera.height, int(np.ceil(v.max())) + 1 + RIM_PIXELS)
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None


def chosen(candidates: Sequence[Candidate], box: Box, most: int | None = None) -> list[Candidate]:
    """Return the frames to fuse, in their order: since the object stands where it is, from as many sides as there are.

    The first is the best view, each next one the farthest in direction from all before, weighed by how much it shows.

    Parameters
    ----------
    candidates : sequence of Candidate
        By frame.
    box : Box
        Where the object stands at last.
    most : int, optional
        Frames wanted; `MAX_VIEWS` unless given.
    """
    most = most or MAX_VIEWS
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
    """Return those after the last frame at which the object stood where its box now has no part."""
    if not candidates:
        return []
    common = iou_matrix(pack([one.box for one in candidates]), pack([box]))[:, 0]
    elsewhere = np.flatnonzero(common <= 0)
    return list(candidates[int(elsewhere[-1]) + 1 if len(elsewhere) else 0 :])
