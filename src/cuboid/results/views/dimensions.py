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
from cuboid.results.views.drawing import DARK, WHITE, draw_frame
from cuboid.results.views.tags import TAG_PX, unit_of
from cuboid.results.views.text import ink, put_text

# Sizes in pixels for an image 640 pixels wide: distance of a line of dimension from its edge, extension beyond it,
# length of an arrow, height of the numbers, and shortest line beside which a number stands.
OFFSET_PX, BEYOND_PX, ARROW_PX, TEXT_PX, SHORTEST_PX = 14.0, 4.0, 7.0, 14, 10.0
# Largest number of moves of a number, each by its height.
MOVES = 4
Rect = tuple[int, int, int, int]


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
    boxes = [one.item.box for one in measures]
    picture = draw_frame(color, T_world_camera, intrinsics, [one.item for one in measures], (), None, tinted=False)
    scale = unit_of(picture.shape[1])
    T_camera_world = inverse(T_world_camera)
    numbers: list[_Number] = []
    tags: list[Rect] = []
    for box in boxes:
        corners = transform(T_camera_world, box.corners())
        if corners[:, 2].min() > 0.0:
            pixels = intrinsics.pixels(corners)
            numbers += _dimensions(picture, box, corners, pixels, scale, unit)
            middle, top = float(pixels[:, 0].mean()), float(pixels[:, 1].min())
            tags.append((round(middle - TAG_PX), round(top - 2.0 * TAG_PX * scale), round(middle + TAG_PX), round(top)))
    _put_numbers(picture, numbers, tags, scale)
    return picture


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
    """Write numbers; one that would cover a tag or another number is moved away from its box, by its height each."""
    size = max(8, round(TEXT_PX * scale))
    taken = list(tags)
    for one in numbers:
        height, width = ink(one.text, size).shape
        free = [picture.shape[1] - width, picture.shape[0] - height]
        places = [
            np.clip(one.at - (width / 2.0, height / 2.0) + k * height * one.away, 0, free).round().astype(int).tolist()
            for k in range(MOVES + 1)
        ]
        rects = [(left, top, left + width, top + height) for left, top in places]
        uncovered = (rect for rect in rects if not any(_cover(rect, other) for other in taken))
        left, top, right, bottom = next(uncovered, rects[0])
        taken.append((left, top, right, bottom))
        picture[top:bottom, left:right] //= 3
        put_text(picture, one.text, left, top, size, WHITE)


def _cover(one: Rect, other: Rect) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
