"""The color of a label: the same in every image, and distinguishable for color-blind people."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array

# Color of points and boxes without a label.
UNLABELLED = (170, 170, 170)

# Number of different colors; labels beyond it repeat them.
COLORS = 256
# B. Ottosson, "A perceptual color space for image processing" (2020): linear RGB to cones, cones to Oklab.
CONES_RGB = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
OKLAB_CONES = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


def color_of(label: int) -> tuple[int, int, int]:
    """Return the color of a label as red, green, blue, 0..255.

    Parameters
    ----------
    label : int
        1, 2, ...; 0 means no label and gives grey.
    """
    if label == 0:
        return UNLABELLED
    return _palette()[(label - 1) % COLORS]


def hex_of(label: int) -> str:
    """Return the color of a label as ``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*color_of(label))


def ink_on(color: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return the text color for a background `color`: near black or white, whichever has more contrast.

    Contrast is defined by the W3C accessibility guidelines (WCAG 2): black wins above a luminance of 0.179.
    """
    luminance = linear_rgb(np.array(color) / 255.0) @ (0.2126, 0.7152, 0.0722)
    return (16, 18, 22) if luminance > 0.179 else (255, 255, 255)


@cache
def _palette() -> tuple[tuple[int, int, int], ...]:
    """Return the colors of all labels, which `benchmarks/palette.py` chose."""
    codes = json.loads(Path(__file__).with_name("palette.json").read_text(encoding="utf-8"))
    return tuple((red, green, blue) for red, green, blue in map(bytes.fromhex, codes))


def linear_rgb(encoded: Float64Array) -> Float64Array:
    """Return linear RGB of sRGB (IEC 61966-2-1), (N, 3) or any shape, both 0..1."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def oklab(linear: Float64Array) -> Float64Array:
    """Return Oklab (N, 3) of linear RGB (N, 3)."""
    lab: Float64Array = np.cbrt(np.clip(linear, 0.0, 1.0) @ CONES_RGB.T) @ OKLAB_CONES.T
    return lab
