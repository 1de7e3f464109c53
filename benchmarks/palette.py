"""Choose the colors of labels: python benchmarks/palette.py [--check] writes `src/cuboid/ground/core/palette.json`.

`--check` writes nothing; the exit status is 1 if the colors would change.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core import palette
from cuboid.ground.core.palette import COLORS, CONES_RGB, OKLAB_CONES, linear_rgb, oklab

LIST = Path(palette.__file__).with_name("palette.json")
COLORS_IN_LINE = 16

# The hues of M. Okabe and K. Ito, "Color Universal Design" (2002), without black, which cannot be seen in the
# dark halo of a line. The order makes the first few labels differ most.
OKABE_ITO = ("56B4E9", "E69F00", "009E73", "CC79A7", "F0E442", "0072B2", "D55E00")

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

# Range of the generated colors, in Oklab: light enough to stand out from the dark halo, dark enough to differ from
# white, saturated enough to differ from unlabelled points.
LIGHTNESS = np.linspace(0.50, 0.91, 12)
CHROMA = np.linspace(0.06, 0.30, 9)
HUE_RAD = np.arange(60) * (2 * np.pi / 60)


def chosen_colors(count: int) -> list[str]:
    """Return the colors: first the Okabe-Ito hues, then repeatedly the candidate that is farthest from all so far.

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
    return ["{:02x}{:02x}{:02x}".format(*map(int, color)) for color in candidates[chosen]]


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


def main() -> int:
    codes = [json.dumps(code) for code in chosen_colors(COLORS)]
    lines = [", ".join(codes[k : k + COLORS_IN_LINE]) for k in range(0, COLORS, COLORS_IN_LINE)]
    text = "[\n" + ",\n".join(lines) + "\n]\n"
    if "--check" in sys.argv[1:]:
        return int(text != LIST.read_text(encoding="utf-8"))
    LIST.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
