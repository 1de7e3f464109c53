"""Dimensions drawn into a picture as in an engineering drawing: lines with arrows along edges, numbers beside them."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.palette import color_of
from cuboid.ground.geometry.box import EDGES, Box
from cuboid.ground.geometry.se3 import inverse, transform
from cuboid.results.files.measures import UNITS, Measure
from cuboid.results.views.tags import unit_of
from cuboid.results.views.text import Color, ink, put_text

# Sizes in pixels for an image 640 pixels wide: distance of a line of dimension from its edge, extension beyond it,
# length of an arrow, height of the numbers, and shortest line beside which a number stands.
OFFSET_PX, BEYOND_PX, ARROW_PX, TEXT_PX, SHORTEST_PX = 14.0, 4.0, 7.0, 14, 10.0
LINE, HALO = (245, 246, 248), (14, 16, 20)


def draw_dimensions(
    color: UInt8Array, measures: Iterable[Measure], T_world_camera: Float64Array, intrinsics: Intrinsics, unit: str
) -> UInt8Array:
    """Return a picture with the edges of boxes, and with the length of an edge along each of their axes.

    Parameters
    ----------
    color : (H, W, 3) uint8
        RGB.
    measures : iterable of Measure
    T_world_camera : (4, 4) float64
    intrinsics : Intrinsics
    unit : str
        One of `UNITS`.
    """
    picture = color.copy()
    scale = unit_of(picture.shape[1])
    T_camera_world = inverse(T_world_camera)
    for one in measures:
        corners = transform(T_camera_world, one.item.box.corners())
        if corners[:, 2].min() <= 0.0:
            continue
        pixels = intrinsics.pixels(corners)
        for a, b in EDGES:
            _line(picture, pixels[a], pixels[b], color_of(one.item.label), scale)
        _dimensions(picture, one.item.box, corners, pixels, scale, unit)
    return picture


def _dimensions(
    picture: UInt8Array, box: Box, corners: Float64Array, pixels: Float64Array, scale: float, unit: str
) -> None:
    metres, digits = UNITS[unit]
    middle = pixels.mean(0)
    for axis in range(3):
        text = f"{box.size[axis] / metres:.{digits}f}"
        a, b = _outer_edge(axis, corners, pixels, middle)
        along = pixels[b] - pixels[a]
        length = float(np.linalg.norm(along))
        if length < SHORTEST_PX * scale:  # seen along this axis: the number alone, in the middle of the box
            _number(picture, f"{'LWH'[axis]} {text} {unit}", middle, scale)
            continue
        across = np.array([-along[1], along[0]]) / length
        if across @ ((pixels[a] + pixels[b]) / 2.0 - middle) < 0.0:
            across = -across
        start, end = (pixels[k] + OFFSET_PX * scale * across for k in (a, b))
        for k in (a, b):
            _line(picture, pixels[k], pixels[k] + (OFFSET_PX + BEYOND_PX) * scale * across, LINE, scale)
        _line(picture, start, end, LINE, scale)
        for tip, towards in ((start, along / length), (end, -along / length)):
            _arrow(picture, tip, towards, scale)
        _number(picture, f"{text} {unit}", (start + end) / 2.0 + TEXT_PX * scale * across, scale)


def _outer_edge(axis: int, corners: Float64Array, pixels: Float64Array, middle: Float64Array) -> tuple[int, int]:
    """Return the edge along an axis on the outline of the box: far from its middle and near the camera."""
    edges = [(a, b) for a, b in EDGES if a ^ b == 1 << axis]
    away = [float(np.linalg.norm((pixels[a] + pixels[b]) / 2.0 - middle)) for a, b in edges]
    depth = [float(corners[[a, b], 2].mean()) for a, b in edges]
    far, near = max(away), min(depth)
    return edges[max(range(4), key=lambda k: away[k] / max(far, 1e-9) - (depth[k] - near) / near)]


def _line(picture: UInt8Array, start: Float64Array, end: Float64Array, color: Color, scale: float) -> None:
    ends = [tuple(int(value) for value in np.rint(16.0 * point)) for point in (start, end)]
    thick = max(1, round(scale))
    cv2.line(picture, ends[0], ends[1], HALO, thick + 2, cv2.LINE_AA, 4)
    cv2.line(picture, ends[0], ends[1], color, thick, cv2.LINE_AA, 4)


def _arrow(picture: UInt8Array, tip: Float64Array, towards: Float64Array, scale: float) -> None:
    back = tip + ARROW_PX * scale * towards
    side = 0.35 * ARROW_PX * scale * np.array([-towards[1], towards[0]])
    cv2.fillConvexPoly(picture, np.rint(16.0 * np.array([tip, back + side, back - side])).astype(int), LINE, 16, 4)


def _number(picture: UInt8Array, text: str, at: Float64Array, scale: float) -> None:
    size = max(8, round(TEXT_PX * scale))
    height, width = ink(text, size).shape
    left, top = round(float(at[0]) - width / 2.0), round(float(at[1]) - height / 2.0)
    left, top = (
        max(0, min(value, room)) for value, room in ((left, picture.shape[1] - width), (top, picture.shape[0] - height))
    )
    picture[top : top + height, left : left + width] //= 3
    put_text(picture, text, left, top, size, LINE)
