"""Boxes in the image of a camera: edges and faces are clipped to the view, projected, and divided in front and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.box import EDGES, Box
from cuboid.ground.geometry.se3 import inverse, transform

# Near plane of drawings, metres: nearer than the shortest depth that any RGB-D camera measures.
NEAR_PLANE_M = 0.05

# Drawings extend beyond the image by this many pixels: room for the ends of thick lines.
MARGIN_PX = 16.0

# Corners of the faces in order around them: -x, +x, -y, +y, -z, +z.
FACES = ((0, 2, 6, 4), (1, 3, 7, 5), (0, 1, 5, 4), (2, 3, 7, 6), (0, 1, 3, 2), (4, 5, 7, 6))
FACES_OF_EDGE = tuple(tuple(f for f, corners in enumerate(FACES) if a in corners and b in corners) for a, b in EDGES)
TOP = 5

Corners = npt.NDArray[np.intp]
_EDGE_ENDS: Corners = np.array(EDGES)
_FACE_ENDS: Corners = np.array(FACES)


@dataclass(frozen=True, slots=True)
class Wireframe:
    """A box in an image, clipped to the view.

    Attributes
    ----------
    front : (N, 2, 2) float64
        End points, pixels, of the edges that the box itself does not hide.
    back : (M, 2, 2) float64
        End points, pixels, of the edges behind the box.
    faces : tuple of (number, (K, 2) float64)
        The faces that look towards the camera: number in `FACES`, outline in pixels.
    depth_m : float
        Of the box's centre along the optical axis.
    """

    front: Float64Array
    back: Float64Array
    faces: tuple[tuple[int, Float64Array], ...]
    depth_m: float

    def rect_xyxy(self, intrinsics: Intrinsics) -> Float64Array | None:
        """Return its rectangle in the image, pixels, (4,); None if no part of it is in the image."""
        ends = np.concatenate((self.front, self.back)).reshape(-1, 2)
        if len(ends) == 0:
            return None
        low = np.maximum(ends.min(axis=0), 0.0)
        high = np.minimum(ends.max(axis=0), (intrinsics.width - 1.0, intrinsics.height - 1.0))
        return np.concatenate((low, high)) if (low < high).all() else None


def wireframes(boxes: Sequence[Box], T_world_camera: Float64Array, intrinsics: Intrinsics) -> list[Wireframe]:
    """Return the wireframes of boxes in the image of a camera.

    A face looks towards the camera if the camera lies on its outer side. An edge is in front if one of its two faces
    looks towards the camera. From inside a box all edges are in front.

    Parameters
    ----------
    boxes : sequence of Box
        In the world, metres.
    T_world_camera : (4, 4) float64
    intrinsics : Intrinsics

    Returns
    -------
    list of Wireframe
        One for each box.
    """
    if not boxes:
        return []
    planes = _view_planes(intrinsics)
    corners = transform(inverse(T_world_camera), np.array([box.corners() for box in boxes]).reshape(-1, 3))
    margins = (corners @ planes[:, :3].T + planes[:, 3]).reshape(len(boxes), -1)
    whole = margins.min(axis=1) >= 0
    with np.errstate(divide="ignore", invalid="ignore"):  # only results of boxes entirely in view are used
        pixels = intrinsics.pixels(corners).reshape(-1, 8, 2)
    corners = corners.reshape(-1, 8, 3)
    facing = [_facing(box, T_world_camera[:3, 3]) for box in boxes]
    return [
        _of_whole(corners[i], pixels[i], facing[i]) if whole[i] else _cut(corners[i], facing[i], planes, intrinsics)
        for i in range(len(boxes))
    ]


def _of_whole(corners: Float64Array, pixels: Float64Array, facing: tuple[bool, ...]) -> Wireframe:
    """Return the wireframe of a box that lies entirely in the view."""
    front, back = _edges(facing)
    faces = tuple((f, pixels[_FACE_ENDS[f]]) for f in range(6) if facing[f])
    return Wireframe(pixels[front], pixels[back], faces, float(corners[:, 2].mean()))


def _cut(corners: Float64Array, facing: tuple[bool, ...], planes: Float64Array, intrinsics: Intrinsics) -> Wireframe:
    """Return the wireframe of a box, clipped by the planes of the view."""
    front, back = (clip_segments(corners[ends], planes) for ends in _edges(facing))
    outlines = [(f, clip_polygon(corners[_FACE_ENDS[f]], planes)) for f in range(6) if facing[f]]
    return Wireframe(
        front=intrinsics.pixels(front),
        back=intrinsics.pixels(back),
        faces=tuple((f, intrinsics.pixels(outline)) for f, outline in outlines if len(outline)),
        depth_m=float(corners[:, 2].mean()),
    )


@cache
def _edges(facing: tuple[bool, ...]) -> tuple[Corners, Corners]:
    """Return the corners (N, 2) of the edges in front and of those behind; `facing`: faces towards the camera."""
    inside = not any(facing)
    is_front = np.array([inside or facing[f] or facing[g] for f, g in FACES_OF_EDGE])
    return _EDGE_ENDS[is_front], _EDGE_ENDS[~is_front]


def visible_rect(box: Box, T_world_camera: Float64Array, intrinsics: Intrinsics) -> Float64Array | None:
    """Return the rectangle around the part of a box inside the image; other objects are assumed to hide nothing.

    The box is first clipped to the view. Its corners alone would give a too large rectangle if some of them lie far
    outside the image, and no rectangle if some lie behind the camera.

    Returns
    -------
    (4,) float64 or None
        Pixels, ends exclusive; None if no part of the box is in the image.
    """
    corners = transform(inverse(T_world_camera), box.corners())
    planes = _view_planes(intrinsics, margin_px=0.0)
    kept = np.concatenate([clip_polygon(corners[face], planes) for face in _FACE_ENDS])
    if len(kept) == 0:
        return None
    pixels = intrinsics.pixels(kept)
    size = intrinsics.width, intrinsics.height
    rect = np.concatenate((np.clip(pixels.min(axis=0), 0, size), np.clip(pixels.max(axis=0), 0, size)))
    return rect if (rect[2:] > rect[:2]).all() else None


def may_be_in_view(boxes: Sequence[Box], T_world_camera: Float64Array, intrinsics: Intrinsics) -> npt.NDArray[np.bool_]:
    """Return for each box whether its bounding sphere reaches into the view; fast, for maps of many objects.

    Returns
    -------
    (N,) bool
        False only if no part of the box is in view.
    """
    if not boxes:
        return np.zeros(0, np.bool_)
    planes = _view_planes(intrinsics)
    planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    centers = transform(inverse(T_world_camera), np.array([box.center for box in boxes]))
    radius_m = np.linalg.norm(np.array([box.size for box in boxes]), axis=1) / 2.0
    reach = centers @ planes[:, :3].T + planes[:, 3] + radius_m[:, None]
    near: npt.NDArray[np.bool_] = (reach >= 0).all(axis=1)
    return near


def clip_segments(ends: Float64Array, planes: Float64Array) -> Float64Array:
    """Return the parts of segments that lie inside all planes (Y.-D. Liang and B. Barsky, 1984).

    Parameters
    ----------
    ends : (N, 2, 3) float64
        Both ends of each segment.
    planes : (P, 4) float64
        n, d; inside is n.p + d >= 0.

    Returns
    -------
    (M, 2, 3) float64
        M <= N; segments entirely outside are omitted.
    """
    distance = ends @ planes[:, :3].T + planes[:, 3]
    d0, d1 = distance[:, 0], distance[:, 1]
    slope = d1 - d0
    with np.errstate(divide="ignore", invalid="ignore"):
        at = -d0 / slope
    entry = np.where(slope > 0, at, -np.inf).max(axis=1, initial=0.0)
    leave = np.where(slope < 0, at, np.inf).min(axis=1, initial=1.0)
    outside = ((slope == 0) & (d0 < 0)).any(axis=1)
    kept = (entry < leave) & ~outside
    start, direction = ends[kept, :1], ends[kept, 1:] - ends[kept, :1]
    fractions = np.stack((entry[kept], leave[kept]), axis=1)[:, :, None]
    parts: Float64Array = start + fractions * direction
    return parts


def clip_polygon(outline: Float64Array, planes: Float64Array) -> Float64Array:
    """Return the part of a convex polygon inside all planes (I. Sutherland and G. Hodgman, 1974).

    Parameters
    ----------
    outline : (N, 3) float64
        Corners in order.
    planes : (P, 4) float64
        n, d; inside is n.p + d >= 0.

    Returns
    -------
    (M, 3) float64
        Corners in order; empty if no part is inside.
    """
    for plane in planes:
        distance = outline @ plane[:3] + plane[3]
        kept: list[Float64Array] = []
        for i in range(len(outline)):
            a, b, da, db = outline[i - 1], outline[i], distance[i - 1], distance[i]
            if (da >= 0) != (db >= 0):
                kept.append(a + (b - a) * (da / (da - db)))
            if db >= 0:
                kept.append(b)
        outline = np.array(kept).reshape(-1, 3)
    return outline


def _facing(box: Box, camera: Float64Array) -> tuple[bool, ...]:
    """Return for each of `FACES` whether the camera's centre (3,) in the world lies on its outer side."""
    camera_in_box = (camera - box.center) @ box.rotation
    (x, y, z), (a, b, c) = camera_in_box.tolist(), (box.size / 2.0).tolist()
    return (-x > a, x > a, -y > b, y > b, -z > c, z > c)


def _view_planes(intrinsics: Intrinsics, margin_px: float = MARGIN_PX) -> Float64Array:
    """Return the near plane and the four sides of the view, (5, 4), in the camera frame."""
    K = intrinsics
    left, top = -(K.cx + margin_px) / K.fx, -(K.cy + margin_px) / K.fy
    right, bottom = (K.width + margin_px - K.cx) / K.fx, (K.height + margin_px - K.cy) / K.fy
    return np.array(
        [
            [0.0, 0.0, 1.0, -NEAR_PLANE_M],
            [1.0, 0.0, -left, 0.0],
            [-1.0, 0.0, right, 0.0],
            [0.0, 1.0, -top, 0.0],
            [0.0, -1.0, bottom, 0.0],
        ]
    )
