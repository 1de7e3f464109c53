"""Text on pictures: rendered once, cached, and drawn over pixels."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from cuboid.ground.arrays import UInt8Array

Color = tuple[int, int, int]

# Weight of the letters: 400 is regular, 700 bold.
WEIGHT = 600

# Number of cached texts: labels appear again in every frame, frame numbers do not.
WORDS_KEPT = 512


@lru_cache(maxsize=1)
def _font() -> cv2.FontFace:
    return cv2.FontFace("sans")


@lru_cache(maxsize=WORDS_KEPT)
def ink(text: str, size_px: int) -> UInt8Array:
    """Return the coverage of pixels by a line of text, (h, w) uint8; 255 is fully covered.

    Parameters
    ----------
    text : str
        One line.
    size_px : int
        Height of the font in pixels; all texts of the same size have the same height.
    """
    height = round(1.25 * size_px)
    canvas = np.zeros((height, (len(text) + 1) * size_px), np.uint8)
    end, _ = cv2.putText(canvas, text, (0, round(0.95 * size_px)), (255,), _font(), size_px, WEIGHT)
    cut: UInt8Array = np.ascontiguousarray(canvas[:, : max(end[0], 1)])
    cut.flags.writeable = False
    return cut


def put_text(picture: UInt8Array, text: str, left: int, top: int, size_px: int, color: Color) -> None:
    """Draw a line of text on a picture; the part outside the picture is cut off.

    Parameters
    ----------
    picture : (H, W, 3) uint8
        Changed in place.
    text : str
    left, top : int
        Upper left corner of the text in pixels.
    size_px : int
    color : tuple of int
    """
    letters = ink(text, size_px)
    top, left = max(top, 0), max(left, 0)
    under = picture[top : top + letters.shape[0], left : left + letters.shape[1]]
    under[:] = mixed(under, letters[: under.shape[0], : under.shape[1]], color)


def mixed(picture: UInt8Array, cover: UInt8Array, color: Color | UInt8Array) -> UInt8Array:
    """Return a picture (h, w, 3) blended with a color or with another picture.

    `cover` (h, w) is the weight of the color: at 0 the picture is unchanged, at 255 it is replaced.
    """
    fraction = cover[..., None].astype(np.uint16)
    both = (255 - fraction) * picture + fraction * np.asarray(color, np.uint16)
    return ((both + 127) // 255).astype(np.uint8)
