from __future__ import annotations

import cv2
import numpy as np
import pytest

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.palette import COLORS, color_of, hex_of, ink_on

# The hues of M. Okabe and K. Ito, "Color Universal Design" (2002), without black.
OKABE_ITO = ["#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442", "#0072b2", "#d55e00"]
# Linear RGB to cones, and what cones a deuteranope is left with: F. Viénot, H. Brettel and J. Mollon,
# "Digital video colourmaps for checking the legibility of displays by dichromats" (1999). It is another
# model than the one that the palette is made with.
CONES_RGB = np.array([[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]])
DEUTERANOPE = np.array([[1.0, 0.0, 0.0], [0.494207, 0.0, 1.24827], [0.0, 0.0, 1.0]])


def as_deuteranope(colors: Float64Array) -> Float64Array:
    """Return sRGB colors (N, 3), 0..1, as a deuteranope sees them."""
    linear = np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ (np.linalg.inv(CONES_RGB) @ DEUTERANOPE @ CONES_RGB).T, 0, 1)
    return np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055)


def smallest_difference(colors: Float64Array) -> float:
    """Return the smallest CIE 1976 color difference between two of the colors: 2.3 is just noticeable."""
    lab = cv2.cvtColor(colors[None].astype(np.float32), cv2.COLOR_RGB2LAB)[0]
    difference = np.linalg.norm(lab[:, None] - lab[None], axis=-1)
    return float(difference[np.triu_indices(len(lab), 1)].min())


@pytest.mark.parametrize(("labels", "least"), [(7, 15.0), (16, 12.0), (32, 6.0), (64, 3.5), (128, 2.3)])
@pytest.mark.parametrize("vision", ["normal", "deuteranope"])
def test_labels_are_told_apart(labels: int, least: float, vision: str) -> None:
    colors = np.array([color_of(label) for label in range(1, labels + 1)]) / 255.0
    if vision == "deuteranope":
        colors = as_deuteranope(colors)
    assert smallest_difference(colors) >= least


def test_all_colors_differ() -> None:
    colors = np.array([color_of(label) for label in range(1, COLORS + 1)]) / 255.0
    assert smallest_difference(colors) > 2.3


def test_colors_of_neighbouring_labels_differ_well_for_a_deuteranope() -> None:
    colors = as_deuteranope(np.array([color_of(label) for label in range(1, COLORS + 1)]) / 255.0)
    assert min(smallest_difference(colors[i : i + 8]) for i in range(COLORS - 8)) >= 3.5


def test_the_first_labels_have_the_known_colors_and_later_ones_come_again() -> None:
    assert [hex_of(label) for label in range(1, 8)] == OKABE_ITO
    assert color_of(COLORS + 3) == color_of(3)
    assert color_of(0) not in {color_of(label) for label in range(1, COLORS + 1)}


def test_text_on_a_color_has_the_contrast_that_the_w3c_asks_of_large_text() -> None:
    def luminance(color: tuple[int, int, int]) -> float:
        c = np.array(color) / 255.0
        return float(np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ (0.2126, 0.7152, 0.0722))

    for label in range(COLORS + 1):
        low, high = sorted((luminance(color_of(label)), luminance(ink_on(color_of(label)))))
        assert (high + 0.05) / (low + 0.05) >= 3.0, label
