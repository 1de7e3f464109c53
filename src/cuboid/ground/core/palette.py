"""The color of a label: the same in every image, and distinguishable for color-blind people."""

from __future__ import annotations

from functools import cache

import numpy as np

from cuboid.ground.arrays import Float64Array

# The hues of M. Okabe and K. Ito, "Color Universal Design" (2002), without black, which cannot be seen in the
# dark halo of a line. The order makes the first few labels differ most.
OKABE_ITO = ("56B4E9", "E69F00", "009E73", "CC79A7", "F0E442", "0072B2", "D55E00")

# Color of points and boxes without a label.
UNLABELLED = (170, 170, 170)

# Number of different colors; labels beyond it repeat them.
COLORS = 256
# So many are computed for a run with few labels; all of them take a tenth of a second.
FIRST_COLORS = 32

# Color vision of people who lack one kind of cone: G. Machado, M. Oliveira and L. Fernandes, "A physiologically-
# based model for simulation of color vision deficiency" (2009), severity 1, on linear RGB.
PROTANOPIA = (
    (0.152286, 1.052583, -0.204868),
    (0.114503, 0.786281, 0.099216),
    (-0.003882, -0.048116, 1.051998),
)
DEUTERANOPIA = (
    (0.367322, 0.860646, -0.227968),
    (0.280085, 0.672501, 0.047413),
    (-0.011820, 0.042940, 0.968881),
)
TRITANOPIA = (
    (1.255528, -0.076749, -0.178779),
    (-0.078411, 0.930809, 0.147602),
    (0.004733, 0.691367, 0.303900),
)
# Distances for tritanopia count double, so they constrain the choice half as much: it is a hundred times rarer.
VISIONS = (
    (np.eye(3), 1.0),
    (np.array(PROTANOPIA), 1.0),
    (np.array(DEUTERANOPIA), 1.0),
    (np.array(TRITANOPIA), 2.0),
)

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

# Range of the generated colors, in Oklab: light enough to stand out from the dark halo, dark enough to differ from
# white, saturated enough to differ from unlabelled points.
LIGHTNESS = np.linspace(0.50, 0.91, 12)
CHROMA = np.linspace(0.06, 0.30, 9)
HUE_RAD = np.arange(60) * (2 * np.pi / 60)


def color_of(label: int) -> tuple[int, int, int]:
    """Return the color of a label as red, green, blue, 0..255.

    Parameters
    ----------
    label : int
        1, 2, ...; 0 means no label and gives grey.
    """
    if label == 0:
        return UNLABELLED
    number = (label - 1) % COLORS
    return _palette(COLORS if number >= FIRST_COLORS else FIRST_COLORS)[number]


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
def _palette(count: int) -> tuple[tuple[int, int, int], ...]:
    """Return so many colors: first the Okabe-Ito hues, then repeatedly the candidate that is farthest from all so far.

    The distance of two colors is their smallest distance in Oklab over all `VISIONS`.
    """
    okabe_ito = [tuple(int(code[i : i + 2], 16) for i in (0, 2, 4)) for code in OKABE_ITO]
    candidates = np.concatenate((np.array(okabe_ito), _candidates()))
    seen = [weight * oklab(linear_rgb(candidates / 255.0) @ M.T) for M, weight in VISIONS]
    distance = np.full(len(candidates), np.inf)
    chosen: list[int] = []
    for i in range(count):
        # Rounded, so that differences between machines in the last digit do not decide.
        nearest = i if i < len(okabe_ito) else int(np.argmax(distance.round(9)))
        chosen.append(nearest)
        for lab in seen:
            np.minimum(distance, np.linalg.norm(lab - lab[nearest], axis=1), out=distance)
    return tuple((int(r), int(g), int(b)) for r, g, b in candidates[chosen])


def _candidates() -> Float64Array:
    """Return the candidate colors, (N, 3), whole numbers 0..255."""
    L, C, h = (grid.ravel() for grid in np.meshgrid(LIGHTNESS, CHROMA, HUE_RAD, indexing="ij"))
    lab = np.column_stack((L, C * np.cos(h), C * np.sin(h)))
    cones = (lab @ np.linalg.inv(OKLAB_CONES).T) ** 3
    linear = cones @ np.linalg.inv(CONES_RGB).T
    shown = linear[((linear >= 0) & (linear <= 1)).all(axis=1)]
    encoded = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * np.maximum(shown, 0) ** (1 / 2.4) - 0.055)
    colors: Float64Array = np.round(255.0 * encoded)
    return colors


def linear_rgb(encoded: Float64Array) -> Float64Array:
    """Return linear RGB of sRGB (IEC 61966-2-1), (N, 3) or any shape, both 0..1."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def oklab(linear: Float64Array) -> Float64Array:
    """Return Oklab (N, 3) of linear RGB (N, 3)."""
    lab: Float64Array = np.cbrt(np.clip(linear, 0.0, 1.0) @ CONES_RGB.T) @ OKLAB_CONES.T
    return lab
