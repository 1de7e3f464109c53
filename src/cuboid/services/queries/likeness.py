"""Similarity of objects: the colors of their points, and the distribution of distances between the points."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.palette import linear_rgb, oklab

# The basic color terms of English (B. Berlin and P. Kay, "Basic Color Terms", 1969), each with a few
# typical colors, RGB.
WORDS: dict[str, tuple[tuple[int, int, int], ...]] = {
    "black": ((20, 20, 20), (45, 45, 45)),
    "grey": ((90, 90, 90), (128, 128, 128), (165, 165, 165)),
    "white": ((210, 210, 210), (250, 250, 250)),
    "red": ((200, 30, 30), (130, 20, 25), (220, 80, 70)),
    "orange": ((240, 130, 20), (220, 100, 40)),
    "yellow": ((240, 220, 40), (210, 180, 60), (245, 235, 140)),
    "green": ((40, 160, 60), (20, 90, 40), (130, 190, 110), (100, 110, 40)),
    "blue": ((30, 80, 200), (20, 40, 110), (110, 160, 220), (40, 170, 190)),
    "purple": ((120, 50, 160), (80, 40, 100), (170, 130, 200)),
    "pink": ((240, 130, 170), (250, 190, 200), (210, 60, 130)),
    "brown": ((110, 70, 40), (80, 55, 35), (160, 115, 75)),
}
COLOR_WORDS = tuple(WORDS)
WITHOUT_HUE = ("black", "grey", "white")
# A color near a word without hue still has one if its chroma in Oklab exceeds LEAST_CHROMA + CHROMA_PER_LIGHTNESS times
# its lightness: dark things of any hue are near black. The first part is the noise of three levels of a byte in dark
# pixels, the second a cast of the light that people see as grey.
LEAST_CHROMA, CHROMA_PER_LIGHTNESS = 0.02, 0.06
# Difference of lightness (0 to 1) that counts as much as one radian of hue, for the word of such a color.
LIGHTNESS_PER_RAD = 0.5
# Minimum fraction of an object's points that have a color for the color to be one of the object's: at most three are.
COLORED = 0.3

# The distribution of distances between points (R. Osada et al., "Shape distributions", 2002), as fractions of the
# diagonal of the box: 16 bins distinguish a ball from a plate, and a few hundred pairs fill them.
SHAPE_BINS, SHAPE_PAIRS = 16, 2048
DIGITS = 3
# Largest number of points used for colors; more points do not change the result.
MAX_COLOR_POINTS = 2000
# Linear RGB of each value of a byte.
_LINEAR = linear_rgb(np.arange(256) / 255.0)


def color_fractions(rgb: UInt8Array) -> Float32Array:
    """Return for each color word the fraction of colors (N, 3) with this word, (11,), in the order of `COLOR_WORDS`.

    The word is that of the nearest typical color in Oklab; a color near black, grey or white that has a hue gets the
    word of its hue.
    """
    if not len(rgb):
        return np.zeros(len(COLOR_WORDS), np.float32)
    typical, owner = _typical()
    some = rgb[:: -(-len(rgb) // MAX_COLOR_POINTS)]
    lab = oklab(_LINEAR[some])
    apart = (typical**2).sum(axis=1) - 2.0 * lab @ typical.T  # without |lab|^2, common to all words
    words = owner[apart.argmin(axis=1)]
    chroma = np.hypot(lab[:, 1], lab[:, 2])
    hued = (words < len(WITHOUT_HUE)) & (chroma > LEAST_CHROMA + CHROMA_PER_LIGHTNESS * lab[:, 0])
    words[hued] = _word_by_hue(lab[hued])
    counts = np.bincount(words, minlength=len(WORDS))
    return np.round(counts / len(some), DIGITS).astype(np.float32)


def _word_by_hue(lab: Float64Array) -> npt.NDArray[np.int64]:
    """Return the index of the word, one with a hue, whose hue and lightness are nearest to colors in Oklab (N, 3)."""
    typical, owner = _typical()
    typical, owner = typical[owner >= len(WITHOUT_HUE)], owner[owner >= len(WITHOUT_HUE)]
    turn = np.arctan2(lab[:, None, 2], lab[:, None, 1]) - np.arctan2(typical[:, 2], typical[:, 1])
    turn = np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi)
    lighter = (lab[:, None, 0] - typical[:, 0]) / LIGHTNESS_PER_RAD
    return np.asarray(owner[np.hypot(turn, lighter).argmin(axis=1)])


def colors_of(fractions: Float32Array) -> tuple[str, ...]:
    """Return the color words of an object, the most frequent first; one at least, unless there are no points."""
    order = np.argsort(-fractions, kind="stable")
    first = [k for k in order[:1].tolist() if fractions[k] > 0]
    return tuple(COLOR_WORDS[k] for k in [*first, *(k for k in order[1:].tolist() if fractions[k] >= COLORED)])


def color_word(fractions: Float32Array) -> str | None:
    """Return the color word with the largest fraction; None without points."""
    return COLOR_WORDS[int(fractions.argmax())] if fractions.any() else None


def shape_distribution(xyz: Float32Array, size_lwh: Float64Array) -> Float32Array:
    """Return the distribution of distances between points (N, 3), (16,): fractions of pairs by distance / diagonal."""
    if len(xyz) < 2:
        return np.zeros(SHAPE_BINS, np.float32)
    a, b = np.random.default_rng(0).integers(0, len(xyz), (2, SHAPE_PAIRS))
    apart = np.linalg.norm((xyz[a] - xyz[b]).astype(np.float64), axis=1) / max(float(np.linalg.norm(size_lwh)), 1e-6)
    counts = np.bincount(np.minimum((apart * SHAPE_BINS).astype(int), SHAPE_BINS - 1), minlength=SHAPE_BINS)
    return np.round(counts / SHAPE_PAIRS, DIGITS).astype(np.float32)


@cache
def _typical() -> tuple[Float64Array, npt.NDArray[np.int64]]:
    """Return the typical colors in Oklab, and the color word of each."""
    colors = np.array([color for colors in WORDS.values() for color in colors], np.uint8)
    return oklab(_LINEAR[colors]), np.repeat(np.arange(len(WORDS)), [len(colors) for colors in WORDS.values()])
