"""The tag of a box: its text on a rounded plate, placed so that it covers no other tag."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.palette import ink_on
from cuboid.results.views.text import Color, ink, mixed

# Height in pixels of a tag's letters, in an image 640 pixels wide. With more than `MANY_TAGS` tags the letters are
# smaller, so that tags do not cover more of the picture; below the minimum height they are not legible.
TAG_PX = 14
MANY_TAGS = 12
MIN_TAG_PX = 10
# Tags may cover at most this fraction of a picture, since the picture matters more; the farthest objects get no tag.
MAX_COVERED = 0.12

# Background color of the tags of hidden objects.
GROUND = (24, 27, 33)

# Plates are drawn larger by this factor and then averaged, for smooth corners.
FINER = 4

TAGS_KEPT = 1024

# In a video a name that had no room is shown again after it has had room for this many frames, a third of a second.
STEADY_FRAMES = 10

Rect = tuple[int, int, int, int]


def unit_of(width_px: int) -> float:
    """Return the factor from sizes in an image 640 pixels wide to sizes in an image of another width.

    It is the square root of the ratio of widths: larger images are shown on larger screens, but the screen does not
    grow in proportion.
    """
    return max(1.0, math.sqrt(width_px / 640.0))


def tag_px(count: int) -> float:
    """Return the height of the letters for this number of tags, in an image 640 pixels wide."""
    return max(MIN_TAG_PX, TAG_PX * math.sqrt(MANY_TAGS / max(count, MANY_TAGS)))


class SteadyNames:
    """Names in the frames of a video: they do not flicker when the room for them changes."""

    def __init__(self) -> None:
        self._frames_with_room: dict[str, int] = {}

    def may_show(self, short: str, has_room: bool) -> bool:
        """Return whether a tag may show its name in the next frame.

        Parameters
        ----------
        short : str
            Text of the tag without the name.
        has_room : bool
            Whether there is room for the name in that frame.
        """
        before = self._frames_with_room.get(short, STEADY_FRAMES)
        self._frames_with_room[short] = before + 1 if has_room else 0
        return before >= STEADY_FRAMES


def place_tags(
    boxes: Sequence[tuple[tuple[str, ...], Float64Array]],
    size_px: int,
    free: tuple[int, int],
    steady: SteadyNames | None = None,
) -> list[tuple[str, Rect] | None]:
    """Return text and place of the tag of each box; no tag covers another, and a box without room for a tag has None.

    First each box gets its shortest text; then longer texts replace it if there is room at the same height.

    Parameters
    ----------
    boxes : sequence of (tuple of str, (4,) float64)
        Possible texts of the tag, the longest first, and rectangle of the box in pixels. Earlier boxes choose first.
    size_px : int
        Height of the letters.
    free : (int, int)
        Height and width of the area that tags may cover.
    steady : SteadyNames, optional
        State of the names in the video to which the picture belongs.
    """
    placed: dict[int, tuple[str, Rect]] = {}
    room = MAX_COVERED * free[0] * free[1]
    for i, (texts, rect_xyxy) in [*enumerate(boxes), *enumerate(boxes)]:
        placed_tag = placed.get(i)
        others = [place for k, (_, place) in placed.items() if k != i]
        for text in texts[-1:] if placed_tag is None else texts[:-1]:
            place = _free_place(text, size_px, rect_xyxy, others, free)
            wanted = 0 if place is None else _area(place) - (0 if placed_tag is None else _area(placed_tag[1]))
            # a longer text is not worth a place farther from the box
            moved = place is not None and placed_tag is not None and place[1] != placed_tag[1][1]
            if place is not None and wanted <= room and not moved:
                placed[i] = text, place
                room -= wanted
                break
    if steady is not None:
        for i, (text, place) in placed.items():
            short = boxes[i][0][-1]
            if not steady.may_show(short, text != short or len(boxes[i][0]) == 1):
                placed[i] = short, _centred(short, size_px, place)
    return [placed.get(i) for i in range(len(boxes))]


def _centred(text: str, size_px: int, rect: Rect) -> Rect:
    """Return the place of another text, centred on the place of a tag."""
    width = _size(text, size_px)[1]
    left = (rect[0] + rect[2] - width) // 2
    return left, rect[1], left + width, rect[3]


def _area(rect: Rect) -> int:
    return (rect[2] - rect[0]) * (rect[3] - rect[1])


def place_tag(text: str, size_px: int, rect_xyxy: Float64Array, taken: list[Rect], free: tuple[int, int]) -> Rect:
    """Return the place of the tag of a box: left, top, right, bottom in pixels.

    The tag is centred above the box if it fits there; otherwise higher, then inside the box, then below it.

    Parameters
    ----------
    text : str
    size_px : int
        Height of the letters.
    rect_xyxy : (4,) float64
        The box in the image, pixels.
    taken : list of (left, top, right, bottom)
        Places of other tags.
    free : (int, int)
        Height and width of the area that tags may cover.
    """
    place = _free_place(text, size_px, rect_xyxy, taken, free)
    return place if place is not None else _places(text, size_px, rect_xyxy, free)[0]


def put_tag(picture: UInt8Array, text: str, size_px: int, color: Color, outlined: bool, place: Rect) -> None:
    """Draw a tag on a picture (H, W, 3): a plate of `color`, or a dark plate with a border if `outlined`."""
    plate, cover = _tag(text, size_px, color, outlined)
    left, top = max(place[0], 0), max(place[1], 0)
    under = picture[top : top + plate.shape[0], left : left + plate.shape[1]]
    height, width = under.shape[:2]
    under[:] = mixed(under, cover[:height, :width], plate[:height, :width])


def _free_place(
    text: str, size_px: int, rect_xyxy: Float64Array, taken: list[Rect], free: tuple[int, int]
) -> Rect | None:
    """Return the best place of a tag that covers no other tag; None if there is no such place."""
    places = _places(text, size_px, rect_xyxy, free)
    return next((place for place in places if not any(overlap(place, taken_rect) for taken_rect in taken)), None)


def _places(text: str, size_px: int, rect_xyxy: Float64Array, free: tuple[int, int]) -> list[Rect]:
    """Return the possible places of a tag, the best place first."""
    height, width = _size(text, size_px)
    x0, y0, x1, y1 = rect_xyxy
    left = round(min(max((x0 + x1 - width) / 2, 1), max(free[1] - width - 1, 1)))
    gap, step = size_px // 3, height + 1
    above = [y0 - gap - height - i * step for i in range(3)]
    inside_or_below = [y0 + gap + i * step for i in range(3)] + [y1 + gap]
    tops = [round(top) for top in above + inside_or_below if 1 <= top <= free[0] - height - 1]
    # an image hardly higher than the tag has one place, at its upper edge
    return [(left, top, left + width, top + height) for top in tops or [1]]


def overlap(a: Rect, b: Rect) -> bool:
    """Return whether two rectangles share a pixel."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _size(text: str, size_px: int) -> tuple[int, int]:
    letters = ink(text, size_px)
    return letters.shape[0] + size_px // 7 * 2, letters.shape[1] + size_px // 2 * 2


@lru_cache(maxsize=TAGS_KEPT)
def _tag(text: str, size_px: int, color: Color, outlined: bool) -> tuple[UInt8Array, UInt8Array]:
    """Return the colors of a tag (h, w, 3) and the coverage of each pixel (h, w), 0..255."""
    height, width = _size(text, size_px)
    border = max(1, size_px // 8)
    outer = _rounded(height, width, 0, size_px // 3)
    inner = _rounded(height, width, border, size_px // 3 - border)
    letters = np.zeros((height, width), np.uint8)
    word = ink(text, size_px)
    top, left = (height - word.shape[0]) // 2, (width - word.shape[1]) // 2
    letters[top : top + word.shape[0], left : left + word.shape[1]] = word
    plate = mixed(np.full((height, width, 3), color, np.uint8), inner, GROUND if outlined else color)
    return mixed(plate, letters, color if outlined else ink_on(color)), outer


def _rounded(height: int, width: int, inset: int, radius: int) -> UInt8Array:
    """Return the coverage of a rounded rectangle with a margin of `inset` in an area (height, width)."""
    canvas = np.zeros((height * FINER, width * FINER), np.uint8)
    low, r = inset * FINER, max(radius, 1) * FINER
    high_x, high_y = width * FINER - 1 - low, height * FINER - 1 - low
    cv2.rectangle(canvas, (low + r, low), (high_x - r, high_y), (255,), cv2.FILLED)
    cv2.rectangle(canvas, (low, low + r), (high_x, high_y - r), (255,), cv2.FILLED)
    for x in (low + r, high_x - r):
        for y in (low + r, high_y - r):
            cv2.circle(canvas, (x, y), r, (255,), cv2.FILLED)
    return np.asarray(cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
