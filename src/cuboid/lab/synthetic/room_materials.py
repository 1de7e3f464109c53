"""Materials of floors, walls and furniture of real households, drawn at random."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cuboid.lab.synthetic.material import WOODS, Color, Layer, Material, Texture, Zone
from cuboid.lab.synthetic.palette import DARKS, WHITES, Extent, contrasting, near, tint, wear
from cuboid.lab.synthetic.shapes import choice

# Smallest top on which sheets of paper and mats lie: half its shorter side, metres.
SHEETS_ON_M = 0.15


def floor(rng: np.random.Generator) -> Material:
    """Draw boards, tiles, carpet, terrazzo, stone or linoleum."""
    color, second = _wood(rng)
    tone = _muted(rng)
    look = [
        lambda: Material(color, second, Texture.BOARDS, float(rng.uniform(0.08, 0.16)), shine=0.3),
        lambda: Material(tone, near(rng, tone, 0.2), Texture.TILES, float(rng.uniform(0.2, 0.5)), shine=0.4),
        lambda: Material(tone, near(rng, tone, 0.3), Texture.CARPET, float(rng.uniform(0.015, 0.04)), grain=0.3),
        lambda: Material(
            near(rng, (0.75, 0.73, 0.7), 0.1), tint(rng), Texture.TERRAZZO, float(rng.uniform(0.02, 0.05))
        ),
        lambda: Material(tone, near(rng, tone, 0.3), Texture.VEINS, float(rng.uniform(0.2, 0.5)), shine=0.6),
        lambda: Material(tone, near(rng, tone, 0.12), Texture.BLOTCHES, float(rng.uniform(0.1, 0.4)), shine=0.2),
        lambda: Material(tone, near(rng, tone, 0.4), Texture.CHECKED_CLOTH, float(rng.uniform(0.25, 0.4)), shine=0.3),
    ][int(rng.integers(7))]()
    return replace(look, layers=(wear(rng, look.color, 0.5),)) if rng.random() < 0.4 else look


def wall(rng: np.random.Generator) -> Material:
    """Draw paint, wallpaper, bricks or boards."""
    color = near(rng, choice(rng, WHITES), 0.06) if rng.random() < 0.5 else _muted(rng)
    kind = rng.random()
    if kind < 0.5:
        return Material(color, color, layers=(replace(wear(rng, color, 0.4), opacity=float(rng.uniform(0.05, 0.3))),))
    if kind < 0.8:
        texture = choice(rng, (Texture.STRIPED_CLOTH, Texture.FLOWERS, Texture.ZIGZAG))
        return Material(color, near(rng, color, 0.18), texture, float(rng.uniform(0.06, 0.15)))
    if kind < 0.9:
        return Material(near(rng, (0.58, 0.34, 0.27), 0.12), (0.72, 0.7, 0.66), Texture.BRICKS, 0.075, grain=0.3)
    return Material(*_wood(rng), Texture.BOARDS, 0.12)


def picture(rng: np.random.Generator) -> Material:
    """Draw a picture or a poster."""
    color = tint(rng)
    texture = choice(rng, (Texture.BLOTCHES, Texture.VEINS, Texture.PRINT, Texture.FLOWERS, Texture.ZIGZAG))
    other = contrasting(rng, color)
    place = (0.0, float(rng.uniform(1.3, 1.5)), float(rng.uniform(0.05, 0.2)), float(rng.uniform(0.05, 0.15)))
    figure = Layer(other, contrasting(rng, other), Texture.VEINS, 0.05, Zone.ROUND_LABEL, place)
    return Material(color, contrasting(rng, color), texture, float(rng.uniform(0.03, 0.12)), 0.2, layers=(figure,))


def cloth(rng: np.random.Generator) -> Material:
    """Draw the cloth of a sofa or a curtain."""
    color = tint(rng)
    other = contrasting(rng, color) if rng.random() < 0.5 else near(rng, color, 0.2)
    texture = choice(
        rng, (Texture.STRIPED_CLOTH, Texture.CHECKED_CLOTH, Texture.FLOWERS, Texture.CARPET, Texture.BLOTCHES)
    )
    return Material(color, other, texture, float(rng.uniform(0.03, 0.1)), grain=0.25)


def top(rng: np.random.Generator, extent: Extent) -> Material:
    """Draw a table top or a board: wood, tablecloth, stone, worn paint or laminate, often with sheets or mats on it."""
    look = choice(rng, _TOPS)(rng)
    layers: list[Layer] = []
    if rng.random() < 0.25:
        layers.append(wear(rng, look.color, 0.15))
    if min(extent.half) > SHEETS_ON_M and rng.random() < 0.45:
        layers += [_sheet(rng, look.color, extent) for _ in range(int(rng.integers(1, 4)))]
    return replace(look, layers=(*look.layers, *layers))


def frame(rng: np.random.Generator) -> Material:
    """Draw legs, sides and backs of furniture: wood or painted."""
    if rng.random() < 0.6:
        return Material(*_wood(rng), Texture.GRAIN, float(rng.uniform(0.03, 0.08)), shine=0.15)
    color = tint(rng)
    return Material(color, color, shine=float(rng.uniform(0, 0.5)))


def _sheet(rng: np.random.Generator, color: Color, extent: Extent) -> Layer:
    """Draw a mat, a newspaper, a stain or a napkin that lies on a top, without height."""
    ground = contrasting(rng, color)
    texture = choice(rng, (Texture.PRINT, Texture.PLAIN, Texture.CHECKED_CLOTH, Texture.STRIPED_CLOTH, Texture.VEINS))
    x, y = (rng.uniform(-0.7, 0.7) * half for half in extent.half)
    zone = choice(rng, (Zone.SHEET, Zone.SHEET, Zone.ROUND_SHEET))
    size = float(rng.uniform(0.05, 0.2)), float(rng.uniform(0.05, 0.15))
    return Layer(
        ground, contrasting(rng, ground), texture, float(rng.uniform(0.005, 0.02)), zone, (float(x), float(y), *size)
    )


def _wood(rng: np.random.Generator) -> tuple[Color, Color]:
    """Draw a wood whose grain is weak or strong."""
    color, second = choice(rng, WOODS)
    color, factor = near(rng, color, 0.06), rng.uniform(0.45, 0.85)
    red, green, blue = np.multiply(second, factor).tolist()
    return color, (red, green, blue)


def _muted(rng: np.random.Generator) -> Color:
    """Draw a color of a wall or a floor: a tint with a part of its strength."""
    color, strength = np.array(tint(rng)), rng.uniform(0.15, 0.6)
    red, green, blue = (strength * color + (1 - strength) * color.mean()).tolist()
    return red, green, blue


def _grained(rng: np.random.Generator) -> Material:
    return Material(*_wood(rng), Texture.GRAIN, float(rng.uniform(0.02, 0.07)), float(rng.uniform(0.05, 0.5)))


def _boards(rng: np.random.Generator) -> Material:
    return Material(*_wood(rng), Texture.BOARDS, float(rng.uniform(0.06, 0.14)), 0.15)


def _tablecloth(rng: np.random.Generator) -> Material:
    color = choice(rng, WHITES) if rng.random() < 0.5 else tint(rng)
    texture = choice(rng, (Texture.CHECKED_CLOTH, Texture.STRIPED_CLOTH, Texture.FLOWERS, Texture.DOTS))
    return Material(color, contrasting(rng, color), texture, float(rng.uniform(0.02, 0.09)), grain=0.2)


def _stone(rng: np.random.Generator) -> Material:
    color = _muted(rng)
    if rng.random() < 0.5:
        return Material(
            color, contrasting(rng, color), Texture.TERRAZZO, float(rng.uniform(0.008, 0.03)), 0.6, polish=50
        )
    return Material(color, near(rng, color, 0.4), Texture.VEINS, float(rng.uniform(0.05, 0.25)), 0.8, polish=60)


def _painted(rng: np.random.Generator) -> Material:
    color = tint(rng)
    return Material(color, color, shine=0.2, layers=(wear(rng, color, 0.08),))


def _laminate(rng: np.random.Generator) -> Material:
    color = choice(rng, (*WHITES, *DARKS))
    return Material(color, near(rng, color, 0.1), Texture.DOTS, 0.006, float(rng.uniform(0.1, 0.6)))


_TOPS: tuple[Callable[[np.random.Generator], Material], ...] = (
    *(_grained, _grained, _boards, _tablecloth, _tablecloth, _stone, _painted, _laminate),
)
