"""Colors and materials of real households, drawn at random."""

from __future__ import annotations

import colorsys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cuboid.lab.synthetic.material import CARD, WOODS, Color, Layer, Material, Texture, Zone
from cuboid.lab.synthetic.shapes import choice

# Minimum difference of two contrasting colors (mean over the channels).
MIN_CONTRAST = 0.22
WHITES: tuple[Color, ...] = ((0.95, 0.95, 0.94), (0.91, 0.88, 0.8), (0.86, 0.86, 0.87), (0.93, 0.9, 0.86))
DARKS: tuple[Color, ...] = ((0.07, 0.07, 0.08), (0.14, 0.14, 0.15), (0.12, 0.14, 0.22), (0.2, 0.13, 0.1))
EARTHS: tuple[Color, ...] = ((0.62, 0.42, 0.26), (0.5, 0.36, 0.26), (0.72, 0.6, 0.44), (0.45, 0.42, 0.34), CARD[0])


@dataclass(frozen=True, slots=True)
class Extent:
    """Size of a part in its model, metres.

    Attributes
    ----------
    low, high : float
        Heights of its lower and upper end.
    half : (float, float)
        Half its length and width.
    round : bool
    """

    low: float
    high: float
    half: tuple[float, float]
    round: bool

    def at(self, fraction: float) -> float:
        """Return the height at a fraction of the part's own."""
        return self.low + fraction * (self.high - self.low)


Recipe = Callable[[np.random.Generator, Color, Extent], Material]


def tint(rng: np.random.Generator) -> Color:
    """Draw a color: white, dark, grey, brown, pastel or strong."""
    kind = rng.random()
    if kind < 0.24:
        return choice(rng, WHITES)
    if kind < 0.36:
        return choice(rng, DARKS)
    if kind < 0.43:
        grey = float(rng.uniform(0.3, 0.7))
        return grey, grey, grey * 1.02
    if kind < 0.53:
        return near(rng, choice(rng, EARTHS), 0.06)
    strong = kind > 0.72
    value = rng.uniform(0.35, 0.9) if strong else rng.uniform(0.65, 0.95)
    saturation = rng.uniform(0.55, 0.95) if strong else rng.uniform(0.12, 0.45)
    return colorsys.hsv_to_rgb(float(rng.random()), float(saturation), float(value))


def contrasting(rng: np.random.Generator, color: Color) -> Color:
    """Draw a color that differs clearly from another."""
    for _ in range(12):
        other = tint(rng)
        if np.abs(np.subtract(other, color)).mean() > MIN_CONTRAST:
            return other
    return DARKS[0] if sum(color) > 1.5 else WHITES[0]


def near(rng: np.random.Generator, color: Color, by: float) -> Color:
    """Draw a color that differs by at most `by` from another."""
    red, green, blue = np.clip(np.add(color, rng.uniform(-by, by) + rng.uniform(-by, by, 3) / 3), 0.02, 0.98)
    return float(red), float(green), float(blue)


def finish(rng: np.random.Generator, look: Material) -> Material:
    """Draw the surface of a material: matte, satin or glossy, smooth or coarse."""
    shine = float(rng.choice([rng.uniform(0, 0.08), rng.uniform(0.1, 0.35), rng.uniform(0.5, 1.0)]))
    return replace(look, shine=shine, polish=float(rng.integers(10, 70)), grain=float(rng.uniform(0.04, 0.16)))


def object_material(rng: np.random.Generator, extent: Extent, color: Color | None) -> Material:
    """Draw the material of an object's main part; `color` is its main color, by default any."""
    weights = np.array([of_round if extent.round else of_flat for _, of_round, of_flat in _RECIPES])
    recipe = _RECIPES[int(rng.choice(len(_RECIPES), p=weights / weights.sum()))][0]
    look = finish(rng, recipe(rng, color or tint(rng), extent))
    layers = list(look.layers)
    if rng.random() < 0.3:  # a logo, or a sticker
        layers.append(_logo(rng, look.color, extent))
    if extent.round and rng.random() < 0.4:
        floor_m = extent.at(0.3)
        inside = contrasting(rng, look.color) if rng.random() < 0.6 else choice(rng, WHITES)
        layers.append(Layer(inside, inside, zone=Zone.INSIDE, extent=(floor_m, 0, 0, 0)))
    if rng.random() < 0.25:
        layers.append(wear(rng, look.color, 0.03))
    return replace(look, layers=tuple(layers))


def trim(rng: np.random.Generator, main: Color) -> Material:
    """Draw the material of a small part of an object: lid, handle, rim."""
    color = near(rng, main, 0.05) if rng.random() < 0.4 else contrasting(rng, main)
    return finish(rng, Material(color))


def wear(rng: np.random.Generator, color: Color, scale_m: float) -> Layer:
    """Draw large soft blotches of worn paint or dirt."""
    factor = rng.choice([rng.uniform(0.45, 0.75), rng.uniform(1.25, 1.6)])
    worn = tuple(np.clip(np.multiply(color, factor), 0.02, 0.97).tolist())
    soft = Layer((0, 0, 0), (0, 0, 0), Texture.BLOTCHES, scale_m * rng.uniform(0.7, 2.0))
    return replace(soft, color=color, second=worn, opacity=float(rng.uniform(0.3, 0.7)))


def _plain(rng: np.random.Generator, color: Color, extent: Extent) -> Material:
    return Material(color, color)


def _all_over(*textures: Texture, low_m: float, high_m: float) -> Recipe:
    """Return a recipe with one of several textures all over the body; `low_m` and `high_m` limit its scale."""

    def draw(rng: np.random.Generator, color: Color, extent: Extent) -> Material:
        texture = choice(rng, textures)
        return Material(color, contrasting(rng, color), texture, float(rng.uniform(low_m, high_m)))

    return draw


def _zones(rng: np.random.Generator, color: Color, extent: Extent) -> Material:
    """Two or three zones by height, one of them perhaps textured."""
    ends = np.sort(rng.uniform(0.15, 0.85, int(rng.integers(1, 3))))
    layers, above = [], color
    for end in ends:
        above = contrasting(rng, above)
        texture = choice(rng, (Texture.PLAIN, Texture.PLAIN, Texture.DOTS, Texture.ZIGZAG))
        layers.append(_band(above, contrasting(rng, above), texture, rng.uniform(0.008, 0.02), extent.at(end), 1e3))
    return Material(color, color, layers=tuple(layers))


def _rings(rng: np.random.Generator, color: Color, extent: Extent) -> Material:
    """Narrow bands around the body."""
    layers = []
    for height in rng.uniform(0.1, 0.9, int(rng.integers(2, 5))):
        ring = contrasting(rng, color)
        wide = rng.uniform(0.02, 0.12)
        layers.append(_band(ring, ring, Texture.PLAIN, 0.01, extent.at(height), extent.at(height + wide)))
    return Material(color, color, layers=tuple(layers))


def _sides(rng: np.random.Generator, color: Color, extent: Extent) -> Material:
    """Two halves, side by side."""
    other = contrasting(rng, color)
    turn, off = rng.uniform(0, 2 * np.pi), rng.uniform(-0.4, 0.4) * min(extent.half)
    half = Layer(other, color, zone=Zone.SIDE, extent=(float(turn), float(off), 0, 0))
    return Material(color, color, layers=(half,))


def _label(rng: np.random.Generator, color: Color, extent: Extent) -> Material:
    """A printed band around the body, often with a block of a third color in it."""
    paper = contrasting(rng, color)
    ink = contrasting(rng, paper)
    low, high = extent.at(rng.uniform(0.08, 0.35)), extent.at(rng.uniform(0.6, 0.95))
    layers = [_band(paper, ink, Texture.PRINT, rng.uniform(0.004, 0.009), low, high)]
    if rng.random() < 0.6:
        third = contrasting(rng, paper)
        cut = low + rng.uniform(0.15, 0.5) * (high - low)
        ends = (low, cut) if rng.random() < 0.5 else (high - (cut - low), high)
        layers.append(_band(third, paper, Texture.PRINT, rng.uniform(0.006, 0.014), *ends))
    return Material(color, color, layers=tuple(layers))


def _packaging(rng: np.random.Generator, color: Color, extent: Extent) -> Material:
    """A box printed all over, with a picture and a title on its sides and its top."""
    picture, ink = contrasting(rng, color), contrasting(rng, color)
    texture = choice(rng, (Texture.FLOWERS, Texture.VEINS, Texture.DOTS, Texture.BLOTCHES))
    x, y = extent.half
    z = extent.high - extent.low
    wide, high = rng.uniform(0.4, 0.85) * x, rng.uniform(0.15, 0.3) * z
    zone = choice(rng, (Zone.LABEL, Zone.ROUND_LABEL))
    place = (float(rng.uniform(-0.3, 0.3) * x), extent.at(rng.uniform(0.3, 0.7)), float(wide), float(high))
    layers = [
        Layer(picture, contrasting(rng, picture), texture, float(rng.uniform(0.01, 0.03)), zone, place),
        _band(ink, color, Texture.PRINT, rng.uniform(0.007, 0.014), extent.at(rng.uniform(0.7, 0.82)), extent.high),
    ]
    sheet = (0.0, 0.0, float(0.75 * x), float(0.7 * y))
    layers.append(Layer(picture, ink, Texture.PRINT, float(rng.uniform(0.006, 0.012)), Zone.SHEET, sheet))
    return Material(color, ink, Texture.PRINT, float(rng.uniform(0.003, 0.007)), layers=tuple(layers))


def _cardboard(rng: np.random.Generator, color: Color, extent: Extent) -> Material:
    """Cardboard with a printed sticker."""
    paper = choice(rng, WHITES)
    place = (0.0, extent.at(0.55), 0.5 * extent.half[0], 0.25 * (extent.high - extent.low))
    sticker = Layer(paper, DARKS[0], Texture.PRINT, float(rng.uniform(0.004, 0.008)), Zone.LABEL, place)
    mark = Layer(DARKS[0], CARD[0], Texture.PRINT, 0.012, Zone.BAND, (extent.low, extent.at(0.2), 0, 0), 0.7)
    top = Layer(paper, DARKS[0], Texture.PRINT, 0.005, Zone.SHEET, (0.02, 0.01, 0.045, 0.03))
    return Material(*CARD, Texture.BLOTCHES, 0.05, layers=(mark, sticker, top))


def _woody(rng: np.random.Generator, color: Color, extent: Extent) -> Material:
    return Material(*choice(rng, WOODS), Texture.GRAIN, float(rng.uniform(0.012, 0.04)))


def _logo(rng: np.random.Generator, color: Color, extent: Extent) -> Layer:
    ground = contrasting(rng, color)
    size = rng.uniform(0.25, 0.55) * min(max(extent.half), 0.5 * (extent.high - extent.low) + 1e-3)
    texture = choice(rng, (Texture.PLAIN, Texture.PRINT, Texture.VEINS))
    zone = choice(rng, (Zone.LABEL, Zone.ROUND_LABEL))
    place = (float(rng.uniform(-0.05, 0.05)), extent.at(rng.uniform(0.35, 0.65)), float(size), float(size * 0.8))
    return Layer(ground, contrasting(rng, ground), texture, float(rng.uniform(0.005, 0.012)), zone, place)


def _band(color: Color, second: Color, texture: Texture, scale_m: float, low_m: float, high_m: float) -> Layer:
    return Layer(color, second, texture, float(scale_m), Zone.BAND, (float(low_m), float(high_m), 0.0, 0.0))


_SPECKLED = _all_over(Texture.DOTS, Texture.SPECKLE, Texture.TERRAZZO, low_m=0.006, high_m=0.02)
_PATTERNED = _all_over(
    Texture.ZIGZAG, Texture.STRIPED_CLOTH, Texture.FLOWERS, Texture.CHECKED_CLOTH, low_m=0.012, high_m=0.035
)
_CLOUDY = _all_over(Texture.VEINS, Texture.BLOTCHES, Texture.MARBLE, low_m=0.02, high_m=0.06)
# Recipes with their weights for round and for other bodies.
_RECIPES: tuple[tuple[Recipe, float, float], ...] = (
    (_plain, 2, 1.5),
    (_SPECKLED, 3, 1),
    (_PATTERNED, 2, 2.5),
    (_CLOUDY, 2, 2),
    (_zones, 4, 2),
    (_rings, 2, 0),
    (_label, 5, 3),
    (_sides, 1, 1.5),
    (_packaging, 0, 7),
    (_cardboard, 0, 2),
    (_woody, 1.5, 1.5),
)
