"""Dimensions drawn into a picture as in an engineering drawing: lines with arrows along edges, numbers beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.box import EDGES, Box
from cuboid.ground.geometry.se3 import inverse, transform
from cuboid.results.files.measures import UNITS, Measure
from cuboid.results.views.drawing import DARK, WHITE, draw_boxes
from cuboid.results.views.tags import Rect, overlap, unit_of
from cuboid.results.views.text import ink, put_text

# Sizes in pixels for an image 640 pixels wide: distance of a line of dimension from its edge, extension beyond it,
# length of an arrow, height of the numbers, and shortest line beside which a number stands.
OFFSET_PX, BEYOND_PX, ARROW_PX, TEXT_PX, SHORTEST_PX = 14.0, 4.0, 7.0, 14, 10.0
# A number is moved by its height at most so many times: farther away, a reader takes it for that of another line. Four
# moves clear a tag and two numbers.
MOVES = 4


def draw_dimensions(
    color: UInt8Array, measures: Sequence[Measure], T_world_camera: Float64Array, intrinsics: Intrinsics, unit: str
) -> UInt8Array:
    """Return a picture with boxes and their labels, and with the length of an edge along each of their axes.

    Parameters
    ----------
    color : (H, W, 3) uint8
        RGB.
    measures : sequence of Measure
    T_world_camera : (4, 4) float64
    intrinsics : Intrinsics
    unit : str
        One of `UNITS`.
    """
    items = [one.item for one in measures]
    picture, tags = draw_boxes(color, T_world_camera, intrinsics, items)
    add_dimensions(picture, [item.box for item in items], T_world_camera, intrinsics, unit, tags)
    return picture


def add_dimensions(
    picture: UInt8Array,
    boxes: Sequence[Box],
    T_world_camera: Float64Array,
    intrinsics: Intrinsics,
    unit: str,
    tags: Sequence[Rect],
) -> None:
    """Draw the lengths of boxes into a picture, along an edge of each axis.

    Parameters
    ----------
    picture : (H, W, 3) uint8
        RGB; changed.
    boxes : sequence of Box
    T_world_camera : (4, 4) float64
    intrinsics : Intrinsics
    unit : str
        One of `UNITS`.
    tags : sequence of (left, top, right, bottom)
        Places that numbers avoid, pixels.
    """
    scale = unit_of(picture.shape[1])
    T_camera_world = inverse(T_world_camera)
    numbers: list[_Number] = []
    for box in boxes:
        corners = transform(T_camera_world, box.corners())
        if corners[:, 2].min() > 0.0:
            pixels = intrinsics.pixels(corners)
            numbers += _dimensions(picture, box, corners, pixels, scale, unit)
    _put_numbers(picture, numbers, tags, scale)


@dataclass(frozen=True, slots=True)
class _Number:
    """A number beside a line.

    Attributes
    ----------
    text : str
    at : (2,) float64
        Its middle, pixels.
    away : (2,) float64
        Unit vector away from the box: a number that would cover another one moves there.
    """

    text: str
    at: Float64Array
    away: Float64Array


def _dimensions(
    picture: UInt8Array, box: Box, corners: Float64Array, pixels: Float64Array, scale: float, unit: str
) -> list[_Number]:
    """Draw the lines of a box, and return its numbers."""
    numbers = []
    metres, digits = UNITS[unit]
    middle = pixels.mean(0)
    for axis in range(3):
        text = f"{box.size[axis] / metres:.{digits}f}"
        a, b = _outer_edge(axis, corners, pixels, middle)
        along = pixels[b] - pixels[a]
        length = float(np.linalg.norm(along))
        if length < SHORTEST_PX * scale:  # seen along this axis: the number alone, in the middle of the box
            numbers.append(_Number(f"{'LWH'[axis]} {text} {unit}", middle, np.array([0.0, 1.0])))
            continue
        across = np.array([-along[1], along[0]]) / length
        if across @ ((pixels[a] + pixels[b]) / 2.0 - middle) < 0.0:
            across = -across
        start, end = (pixels[k] + OFFSET_PX * scale * across for k in (a, b))
        for k in (a, b):
            _line(picture, pixels[k], pixels[k] + (OFFSET_PX + BEYOND_PX) * scale * across, scale)
        _line(picture, start, end, scale)
        for tip, towards in ((start, along / length), (end, -along / length)):
            _arrow(picture, tip, towards, scale)
        numbers.append(_Number(f"{text} {unit}", (start + end) / 2.0 + TEXT_PX * scale * across, across))
    return numbers


def _outer_edge(axis: int, corners: Float64Array, pixels: Float64Array, middle: Float64Array) -> tuple[int, int]:
    """Return the edge along an axis on the outline of the box: far from its middle and near the camera."""
    edges = [(a, b) for a, b in EDGES if a ^ b == 1 << axis]
    away = [float(np.linalg.norm((pixels[a] + pixels[b]) / 2.0 - middle)) for a, b in edges]
    depth = [float(corners[[a, b], 2].mean()) for a, b in edges]
    far, near = max(away), min(depth)
    return edges[max(range(4), key=lambda k: away[k] / max(far, 1e-9) - (depth[k] - near) / near)]


def _line(picture: UInt8Array, start: Float64Array, end: Float64Array, scale: float) -> None:
    ends = [tuple(int(value) for value in np.rint(16.0 * point)) for point in (start, end)]
    thick = max(1, round(scale))
    cv2.line(picture, ends[0], ends[1], DARK, thick + 2, cv2.LINE_AA, 4)
    cv2.line(picture, ends[0], ends[1], WHITE, thick, cv2.LINE_AA, 4)


def _arrow(picture: UInt8Array, tip: Float64Array, towards: Float64Array, scale: float) -> None:
    back = tip + ARROW_PX * scale * towards
    side = 0.35 * ARROW_PX * scale * np.array([-towards[1], towards[0]])
    cv2.fillConvexPoly(picture, np.rint(16.0 * np.array([tip, back + side, back - side])).astype(int), WHITE, 16, 4)


def _put_numbers(picture: UInt8Array, numbers: Sequence[_Number], tags: Sequence[Rect], scale: float) -> None:
    """Write numbers beside their lines, where they cover neither tags nor each other if there is room."""
    size = max(8, round(TEXT_PX * scale))
    height, width = picture.shape[:2]
    taken = list(tags)
    for one in numbers:
        high, wide = ink(one.text, size).shape
        left, top, right, bottom = place_number((wide, high), one.at, one.away, taken, (width, height))
        taken.append((left, top, right, bottom))
        picture[top:bottom, left:right] //= 3
        put_text(picture, one.text, left, top, size, WHITE)


def place_number(
    size_px: tuple[int, int], at: Float64Array, away: Float64Array, taken: Sequence[Rect], free: tuple[int, int]
) -> Rect:
    """Return the place of a number: the first that covers nothing, else the one that covers the fewest rectangles.

    Parameters
    ----------
    size_px : (int, int)
        Width and height of the number.
    at : (2,) float64
        Its wanted middle, pixels.
    away : (2,) float64
        Unit vector along which it may be moved, at most `MOVES` times by its height.
    taken : sequence of (left, top, right, bottom)
        Places of tags and of other numbers.
    free : (int, int)
        Width and height of the picture.
    """
    inside = np.subtract(free, size_px)
    places = [np.clip(at - np.divide(size_px, 2.0) + k * size_px[1] * away, 0, inside) for k in range(MOVES + 1)]
    corners = [np.round(place).astype(int).tolist() for place in places]
    rects: list[Rect] = [(left, top, left + size_px[0], top + size_px[1]) for left, top in corners]
    return min(rects, key=lambda rect: sum(overlap(rect, other) for other in taken))
