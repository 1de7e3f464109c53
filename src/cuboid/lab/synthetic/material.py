"""The material of a surface: two colors, a texture by position on the body, and a shine."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from cuboid.ground.arrays import Float64Array

Color = tuple[float, float, float]


class Texture(IntEnum):
    """The pattern that mixes the two colors, by position on the body."""

    PLAIN = 0
    CHECKER = 1
    STRIPES = 2
    WOOD = 3
    MARBLE = 4
    BANDS = 5
    SPECKLE = 6
    TILES = 7
    PRINT = 8
    CHECKED_CLOTH = 9
    STRIPED_CLOTH = 10
    FLOWERS = 11
    TERRAZZO = 12
    CARPET = 13
    BLOTCHES = 14
    GRAIN = 15
    BOARDS = 16
    DOTS = 17
    ZIGZAG = 18
    BRICKS = 19
    VEINS = 20


class Zone(IntEnum):
    """The zone of a body that a layer covers; `Layer.extent` is a, b, c, d."""

    ALL = 0
    BAND = 1  # heights a..b
    SIDE = 2  # beyond distance b from the axis in direction a (radians)
    LABEL = 3  # on sides: a rectangle around s = a, t = b, half sizes c and d
    ROUND_LABEL = 4  # the ellipse in it
    SHEET = 5  # the same rectangle on faces that look up
    ROUND_SHEET = 6
    INSIDE = 7  # sides that face the axis: the inside of a mug


@dataclass(frozen=True, slots=True)
class Layer:
    """A second material that covers a zone of a body: a label, a colored band, wear.

    Attributes
    ----------
    color, second : (r, g, b)
    texture : Texture
    scale_m : float
    zone : Zone
    extent : (a, b, c, d)
        The zone's extent, metres.
    opacity : float
        0..1.
    """

    color: Color
    second: Color
    texture: Texture = Texture.PLAIN
    scale_m: float = 0.03
    zone: Zone = Zone.ALL
    extent: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    opacity: float = 1.0


@dataclass(frozen=True, slots=True)
class Material:
    """The material of a part.

    Attributes
    ----------
    color, second : (r, g, b)
        Colors as in an image, 0..1 (sRGB).
    texture : Texture
    scale_m : float
        Size of the texture's features, metres.
    shine : float
        Strength of the highlight, 0..1.
    mirror : float
        Fraction of the light, and of the depth readings, from the mirror image in a level face, 0..1.
    polish : float
        Exponent of the highlight: the higher, the smaller.
    grain : float
        Strength of the fine noise, 0..1.
    layers : tuple of Layer
        Each covers those before it.
    axis, yaw_rad, radius_m : (x, y), float, float
        Vertical axis and direction of the body in its model, and the radius of a round body (0 for others): textures
        along the surface follow them.
    """

    color: Color
    second: Color = (1.0, 1.0, 1.0)
    texture: Texture = Texture.PLAIN
    scale_m: float = 0.03
    shine: float = 0.0
    mirror: float = 0.0
    polish: float = 20.0
    grain: float = 0.12
    layers: tuple[Layer, ...] = ()
    axis: tuple[float, float] = (0.0, 0.0)
    yaw_rad: float = 0.0
    radius_m: float = 0.0


WOODS: tuple[tuple[Color, Color], ...] = (
    ((0.72, 0.52, 0.33), (0.56, 0.37, 0.21)),
    ((0.80, 0.66, 0.47), (0.68, 0.52, 0.34)),
    ((0.50, 0.32, 0.20), (0.37, 0.22, 0.13)),
    ((0.86, 0.80, 0.70), (0.76, 0.68, 0.57)),
)
PAINTS: tuple[Color, ...] = (
    (0.84, 0.19, 0.16),
    (0.12, 0.42, 0.72),
    (0.95, 0.71, 0.13),
    (0.16, 0.56, 0.34),
    (0.93, 0.45, 0.13),
    (0.45, 0.26, 0.60),
    (0.10, 0.60, 0.62),
    (0.85, 0.33, 0.50),
    (0.93, 0.91, 0.85),
    (0.20, 0.24, 0.32),
)
STEEL, BLACK, WHITE, GREY = (0.76, 0.77, 0.79), (0.09, 0.09, 0.10), (0.93, 0.93, 0.91), (0.42, 0.43, 0.45)
CARD: tuple[Color, Color] = ((0.74, 0.58, 0.40), (0.66, 0.50, 0.33))


def paint(rng: np.random.Generator) -> Color:
    """Return one of the strong colors."""
    return PAINTS[int(rng.integers(len(PAINTS)))]


def two_paints(rng: np.random.Generator) -> tuple[Color, Color]:
    """Return two different strong colors."""
    first, second = rng.choice(len(PAINTS), 2, replace=False)
    return PAINTS[int(first)], PAINTS[int(second)]


def wood(rng: np.random.Generator, scale_m: float = 0.05) -> Material:
    """Return one of the woods."""
    color, second = WOODS[int(rng.integers(len(WOODS)))]
    return Material(color, second, Texture.WOOD, scale_m, shine=0.12)


def linear(color: Color) -> Float64Array:
    """Return an sRGB color as linear light (3,)."""
    amounts: Float64Array = np.asarray(color, np.float64) ** 2.2
    return amounts
