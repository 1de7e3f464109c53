"""Furniture that supports objects or stands around: tables, shelves, walls, chairs, screens."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.lab.synthetic.material import Color, Material, Texture, paint, wood
from cuboid.lab.synthetic.mesh import box, grid, lathe, merged, shift, turn
from cuboid.lab.synthetic.shapes import Model
from cuboid.lab.synthetic.solids import pipe, rounded_box

# Height of a room and of a curtain, length of a sofa, metres.
WALL_M, CURTAIN_M, SOFA_M = 2.7, 2.5, 1.7

CLOTH: tuple[tuple[Color, Color], ...] = (
    ((0.33, 0.38, 0.45), (0.27, 0.32, 0.39)),
    ((0.52, 0.33, 0.28), (0.45, 0.28, 0.24)),
    ((0.60, 0.57, 0.50), (0.52, 0.49, 0.43)),
)


def table(rng: np.random.Generator, size: Sequence[float]) -> Model:
    """Return a table of `size` (x, y, height): a top and four legs."""
    x, y, height = size
    look = wood(rng, 0.06)
    leg, thick = 0.05, 0.03
    corners = [(sx * (x / 2 - 0.06), sy * (y / 2 - 0.06), 0) for sx in (-1, 1) for sy in (-1, 1)]
    legs = merged(box((leg, leg, height - thick), corner) for corner in corners)
    return Model("table", ((box((x, y, thick), (0, 0, height - thick)), look), (legs, wood(rng, 0.05))))


def round_table(rng: np.random.Generator, radius: float, height: float) -> Model:
    """Return a round table on one foot."""
    top = lathe([(0, height - 0.03), (radius, height - 0.03), (radius, height), (0, height)], 72)
    foot = lathe([(0, 0), (radius * 0.5, 0), (radius * 0.5, 0.03), (0.04, 0.05), (0.04, height - 0.03)], 40)
    return Model("table", ((top, wood(rng, 0.06)), (foot, Material((0.2, 0.2, 0.22), shine=0.3))))


def shelf(rng: np.random.Generator, size: Sequence[float], boards: Sequence[float]) -> Model:
    """Return an open shelf of `size` (x, y, height), its back at +y; `boards` are the heights of its tops."""
    x, y, height = size
    side = [box((0.025, y, height), (s * (x / 2 + 0.0125), 0, 0)) for s in (-1, 1)]
    back = box((x + 0.05, 0.012, height), (0, y / 2 + 0.006, 0))
    tops = merged(box((x, y, 0.025), (0, 0, top - 0.025)) for top in boards)
    return Model("shelf", ((tops, wood(rng, 0.07)), (merged([*side, back]), wood(rng, 0.08))))


def bay(rng: np.random.Generator, size: Sequence[float], boards: Sequence[float]) -> Model:
    """Return a `shelf` with mirroring boards and a dividing wall between two compartments side by side."""
    _, y, height = size
    body = shelf(rng, size, boards)
    lacquer = Material((0.88, 0.87, 0.84), (0.84, 0.83, 0.8), Texture.MARBLE, 0.3, 0.3, mirror=0.4)
    between = box((0.02, y, height), (0, 0, 0))
    return Model("bay", ((body.parts[0][0], lacquer), body.parts[1], (between, body.parts[1][1])))


def floor(rng: np.random.Generator, half_m: float) -> Model:
    """Return a floor: planks, tiles or a carpet."""
    materials = (
        wood(rng, 0.11),
        Material((0.66, 0.64, 0.60), (0.45, 0.44, 0.42), Texture.TILES, 0.4, 0.15),
        Material((0.47, 0.46, 0.44), (0.56, 0.54, 0.50), Texture.MARBLE, 0.05),
    )
    size = (2 * half_m, 2 * half_m, 0.02)
    return Model("floor", ((box(size, (0, 0, -0.02)), materials[int(rng.integers(len(materials)))]),))


def plain_floor(half_m: float, color: Color) -> Model:
    """Return a floor in one color."""
    return Model("floor", ((box((2 * half_m, 2 * half_m, 0.02), (0, 0, -0.02)), Material(color, shine=0.1)),))


def ceiling(half_m: float) -> Model:
    """Return a ceiling at 2.7 m."""
    size = (2 * half_m, 2 * half_m, 0.02)
    return Model("ceiling", ((box(size, (0, 0, WALL_M)), Material((0.9, 0.9, 0.88))),))


def wall(rng: np.random.Generator, length_m: float, height_m: float = WALL_M, *, pictures: bool = True) -> Model:
    """Return a wall along x with a skirting and, if wanted, two pictures; its face is at y = 0, towards -y."""
    tint = float(rng.uniform(0.0, 0.08))
    plaster = Material((0.86 - tint, 0.85 - tint, 0.80), (0.80 - tint, 0.79 - tint, 0.74), Texture.MARBLE, 0.25)
    parts = [
        (box((length_m, 0.05, height_m), (0, 0.025, 0)), plaster),
        (box((length_m, 0.012, 0.09), (0, -0.006, 0)), Material((0.93, 0.93, 0.92))),
    ]
    for side in (-1, 1) if pictures else ():
        wide, high = rng.uniform(0.4, 0.8), rng.uniform(0.35, 0.6)
        place = (side * length_m * rng.uniform(0.12, 0.3), -0.012, 1.2)
        picture = Material(paint(rng), paint(rng), (Texture.MARBLE, Texture.CHECKER)[int(rng.integers(2))], 0.12)
        parts.append((box((wide, 0.024, high), place), picture))
    return Model("wall", tuple(parts))


def curtain(rng: np.random.Generator, length_m: float) -> Model:
    """Return a curtain with deep folds along x, facing -y: a large surface that is not planar."""
    x = np.linspace(-length_m / 2, length_m / 2, int(length_m / 0.02))
    fold = 0.09 * np.sin(2 * np.pi * x / 0.31 + rng.uniform(0, 6)) + 0.04 * np.sin(2 * np.pi * x / 0.13)
    drop = np.linspace(0, CURTAIN_M, 12)
    sheet = np.stack(
        np.broadcast_arrays(x[None], fold[None] * (1 - 0.25 * drop[:, None] / CURTAIN_M), drop[:, None]), -1
    )
    color, second = CLOTH[int(rng.integers(len(CLOTH)))]
    return Model("curtain", ((grid(sheet), Material(color, second, Texture.STRIPES, 0.09)),))


def chair(rng: np.random.Generator) -> Model:
    """Return a chair that faces +x."""
    legs = merged(box((0.035, 0.035, 0.44), (a * 0.19, b * 0.19, 0)) for a in (-1, 1) for b in (-1, 1))
    posts = merged(box((0.03, 0.035, 0.46), (-0.2, b * 0.19, 0.47)) for b in (-1, 1))
    rails = merged(box((0.02, 0.38, 0.08), (-0.2, 0, z)) for z in (0.62, 0.78))
    color, second = CLOTH[int(rng.integers(len(CLOTH)))]
    seat = box((0.44, 0.44, 0.04), (0, 0, 0.44))
    return Model(
        "chair",
        (
            (merged([legs, posts, rails]), wood(rng, 0.05)),
            (seat, Material(color, second, Texture.SPECKLE, 0.02)),
        ),
    )


def stool(rng: np.random.Generator) -> Model:
    """Return a round stool with three sloping legs."""
    height, r = rng.uniform(0.42, 0.5), rng.uniform(0.15, 0.18)
    seat = lathe([(0, height - 0.035), (r, height - 0.035), (r, height - 0.005), (r - 0.01, height), (0, height)], 48)
    legs = [
        pipe([(1.05 * r, 0, 0.0), (0.65 * r, 0, height - 0.03)], 0.015).moved(turn(2 * np.pi * k / 3)) for k in range(3)
    ]
    return Model("stool", ((seat, wood(rng, 0.05)), (merged(legs), wood(rng, 0.04))))


def office_chair(rng: np.random.Generator) -> Model:
    """Return a swivel chair on five castors that faces +x."""
    height = rng.uniform(0.44, 0.52)
    angles = 2 * np.pi * np.arange(5) / 5
    spokes = [pipe([(0.02, 0, 0.1), (0.3, 0, 0.07)], (0.025, 0.016)).moved(turn(a)) for a in angles]
    castor = lathe([(0, -0.02), (0.028, -0.02), (0.028, 0.02), (0, 0.02)], 20).moved(turn(np.pi / 2, 0))
    castors = [castor.moved(turn(a) @ shift((0.3, 0, 0.028))) for a in angles]
    column = lathe([(0.032, 0.08), (0.032, 0.25), (0.018, 0.25), (0.018, height - 0.05)], 24)
    spine = pipe([(-0.1, 0, height - 0.03), (-0.27, 0, height), (-0.29, 0, height + 0.3)], 0.02)
    seat = rounded_box((0.46, 0.48, 0.08), 0.1, 0.03, (0, 0, height - 0.05))
    back = rounded_box((0.46, 0.44, 0.06), 0.1, 0.025).moved(
        shift((-0.23, 0, height + 0.37)) @ turn(-np.pi / 2 + 0.12, 1)
    )
    color, second = CLOTH[int(rng.integers(len(CLOTH)))]
    return Model(
        "office chair",
        (
            (merged([*spokes, *castors, column, spine]), Material((0.12, 0.12, 0.13), shine=0.3)),
            (merged([seat, back]), Material(color, second, Texture.SPECKLE, 0.01)),
        ),
    )


def sofa(rng: np.random.Generator) -> Model:
    """Return a sofa along y that faces +x."""
    length_m = SOFA_M
    color, second = CLOTH[int(rng.integers(len(CLOTH)))]
    body = [
        box((0.8, length_m, 0.25), (0, 0, 0.08)),
        box((0.22, length_m, 0.5), (-0.29, 0, 0.33)),
        *(box((0.8, 0.18, 0.5), (0, s * (length_m / 2 + 0.09), 0.08)) for s in (-1, 1)),
    ]
    seats = [box((0.56, length_m / 2 - 0.02, 0.13), (0.11, s * length_m / 4, 0.33)) for s in (-1, 1)]
    return Model(
        "sofa",
        (
            (merged(body), Material(color, second, Texture.MARBLE, 0.03)),
            (merged(seats), Material(second, color, Texture.MARBLE, 0.03)),
        ),
    )


def screen(rng: np.random.Generator, width_m: float, height_m: float) -> Model:
    """Return a folding screen of three leaves along x, standing on the floor."""
    leaf = width_m / 3
    leaves = [
        box((leaf * 1.02, 0.02, height_m)).moved(shift((k * leaf * 0.97, (k % 2) * 0.06, 0)) @ turn(0.12 * k))
        for k in (-1, 0, 1)
    ]
    look = Material(paint(rng), (0.92, 0.90, 0.84), Texture.STRIPES, 0.16)
    return Model("screen", ((merged(leaves), look),))


def crate(rng: np.random.Generator, size: Sequence[float]) -> Model:
    """Return a large moving box, used as an occluder: it is too large for an object."""
    look = Material((0.70, 0.54, 0.37), (0.62, 0.46, 0.30), Texture.MARBLE, 0.06)
    tape = box((size[0] + 0.001, 0.06, 0.0006), (0, 0, size[2]))
    return Model("crate", ((box(size), look), (tape, Material((0.82, 0.74, 0.58), shine=0.3))))
