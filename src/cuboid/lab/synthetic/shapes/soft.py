"""Soft things and plants: bags, a backpack, cushions, shoes, a hat, leaves."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from cuboid.lab.synthetic.material import Color, Material, Texture, paint, two_paints
from cuboid.lab.synthetic.mesh import Mesh, lathe, merged, shift, turn
from cuboid.lab.synthetic.shapes.model import Maker, Model, choice, standing
from cuboid.lab.synthetic.shapes.vessels import arc
from cuboid.lab.synthetic.solids import (
    displaced,
    flattened,
    hollow,
    loft,
    pipe,
    sheet,
    superellipse,
    superellipsoid,
    waves,
)

# Muted colors of cloth and leather.
FABRICS: tuple[Color, ...] = (
    (0.20, 0.24, 0.32),
    (0.13, 0.13, 0.14),
    (0.45, 0.28, 0.17),
    (0.52, 0.14, 0.16),
    (0.32, 0.38, 0.26),
    (0.55, 0.52, 0.46),
    (0.72, 0.66, 0.55),
)


def fabric(rng: np.random.Generator) -> Material:
    """Return cloth or leather."""
    color = choice(rng, (*FABRICS, paint(rng)))
    shade = (0.8 * color[0], 0.8 * color[1], 0.8 * color[2])
    return Material(color, shade, choice(rng, (Texture.SPECKLE, Texture.MARBLE)), 0.006, 0.05)


def _dim(look: Material) -> Material:
    r, g, b = look.color
    return Material((0.6 * r, 0.6 * g, 0.6 * b), shine=0.1)


def handbag(rng: np.random.Generator) -> Model:
    """Return a soft bag with two handles."""
    x, y, z = rng.uniform(0.26, 0.36), rng.uniform(0.1, 0.14), rng.uniform(0.2, 0.26)
    body = superellipsoid((x / 2, y / 2, z / 2), 3.2, 56)
    vertices = body.vertices.copy()
    high = np.clip(vertices[:, 2] / (z / 2), -1, 1)
    vertices[:, 1] *= 1.0 - 0.42 * (high + 1) / 2
    vertices[:, 2] -= 0.02 * np.clip(high, 0, 1) * np.cos(vertices[:, 0] / x * np.pi)
    body = flattened(displaced(Mesh(vertices, body.faces), rng, 0.008, 0.11), -z * 0.44)
    look = fabric(rng)
    handles = [
        pipe(arc((0, z * 0.36), (x * 0.2, rng.uniform(0.09, 0.13)), -0.15, np.pi + 0.15, 22), 0.006).moved(
            shift((0, s * y * 0.2, 0))
        )
        for s in (-1, 1)
    ]
    seam = pipe(
        np.column_stack(
            [
                np.linspace(-0.36, 0.36, 12) * x,
                np.zeros(12),
                z * (0.47 - 0.075 * np.cos(np.linspace(-0.36, 0.36, 12) * np.pi)),
            ]
        ),
        0.006,
    )
    return standing("bag", (body, look), (merged([*handles, seam]), _dim(look)))


def backpack(rng: np.random.Generator) -> Model:
    """Return a backpack that stands, with a front pocket and straps behind; its front is at +x."""
    x, y, z = rng.uniform(0.13, 0.17), rng.uniform(0.26, 0.31), rng.uniform(0.36, 0.44)
    main = superellipsoid((x / 2, y / 2, z / 2), 3.0, 52)
    pocket = superellipsoid((x * 0.3, y * 0.38, z * 0.22), 3.4, 40).moved(shift((x * 0.42, 0, -z * 0.2)))
    side = [
        superellipsoid((x * 0.25, 0.02, z * 0.16), 2.6, 28).moved(shift((0, s * y * 0.48, -z * 0.24))) for s in (-1, 1)
    ]
    look = fabric(rng)
    foot = -z * 0.46
    body = flattened(displaced(main, rng, 0.009, 0.14), foot)
    pockets = flattened(displaced(merged([pocket, *side]), rng, 0.005, 0.09), foot)
    loop = pipe(
        arc((0, z * 0.47), (0.004, 0.035), 0, np.pi, 12)[:, [1, 0, 2]]
        + np.column_stack([np.full(12, -x * 0.2), np.linspace(-0.035, 0.035, 12), np.zeros(12)]),
        0.006,
    )
    t = np.linspace(0, 1, 18)
    straps = [
        pipe(
            np.column_stack([-x * 0.45 - 0.05 * np.sin(np.pi * t), s * (0.05 + 0.045 * t), z * (0.4 - 0.78 * t)]),
            0.007,
            2.6,
        )
        for s in (-1, 1)
    ]
    zip_angle = np.linspace(0.1, np.pi - 0.1, 26)
    zipper = pipe(
        np.column_stack(
            [np.full(26, x * 0.3), y * 0.47 * np.cos(zip_angle), z * (0.05 + 0.41 * np.sin(zip_angle) ** 0.5)]
        ),
        0.004,
    )
    return standing("backpack", (body, look), (pockets, look), (merged([loop, *straps, zipper]), _dim(look)))


def pouch(rng: np.random.Generator) -> Model:
    """Return a soft pouch that lies, with a zip."""
    x, y, z = rng.uniform(0.09, 0.12), rng.uniform(0.04, 0.06), rng.uniform(0.025, 0.035)
    body = displaced(superellipsoid((x, y, z), 2.6, 44), rng, 0.006, 0.06)
    zipper = pipe(
        np.column_stack(
            [np.linspace(-x, x, 20) * 0.86, np.zeros(20), z * np.sqrt(1 - np.linspace(-0.86, 0.86, 20) ** 4) + 0.002]
        ),
        0.003,
    )
    look = fabric(rng)
    return standing("pouch", (flattened(body, -0.75 * z), look), (zipper, Material((0.7, 0.7, 0.68), shine=0.6)))


def paper_bag(rng: np.random.Generator) -> Model:
    """Return a carrier bag of paper, open at the top, with two handles."""
    x, y, z = rng.uniform(0.2, 0.26), rng.uniform(0.09, 0.12), rng.uniform(0.24, 0.32)
    levels = np.linspace(0, 1, 12)
    outline = superellipse(1, y / x, 14.0, 56)
    rings = [np.column_stack([outline * x * (1, 1 - 0.25 * t), np.full(56, z * t)]) for t in levels]
    inner = [np.column_stack([ring[:, :2] * 0.97, np.maximum(ring[:, 2], 0.002)]) for ring in rings[::-1]]
    body = loft([*rings, *inner])
    vertices = body.vertices.copy()
    # Both sides of a wall move together, more towards the top.
    vertices[:, 1] += 0.005 * waves(vertices[:, [0, 2]], rng, 0.12) * vertices[:, 2] / z
    body = Mesh(vertices, body.faces)
    bow = pipe(arc((0, z - 0.02), (x * 0.16, 0.1), 0, np.pi, 20), 0.003)
    handles = [bow.moved(shift((0, s * y * 0.36, 0))) for s in (-1, 1)]
    color, second = two_paints(rng)
    look = choice(
        rng,
        (
            Material((0.72, 0.56, 0.38), (0.66, 0.5, 0.33), Texture.MARBLE, 0.05),
            Material(color, second, Texture.CHECKER, 0.08),
        ),
    )
    return standing("paper bag", (body, look), (merged(handles), Material((0.9, 0.88, 0.82))))


def cushion(rng: np.random.Generator) -> Model:
    """Return a cushion that lies."""
    a = rng.uniform(0.17, 0.22)
    outline = superellipse(2 * a, 2 * a, 6.0, 64)
    thick = rng.uniform(0.05, 0.065)
    steps = np.linspace(0, np.pi / 2, 9)
    rows = [(np.cos(s) ** 0.5, thick * np.sin(s)) for s in steps]
    rings = [np.column_stack([outline * w, np.full(64, -h)]) for w, h in rows[::-1]]
    rings += [np.column_stack([outline * w, np.full(64, h)]) for w, h in rows[1:]]
    body = displaced(loft(rings), rng, 0.006, 0.1)
    look = fabric(rng)
    return standing("cushion", (flattened(body, -thick * 0.7), look))


def shoe(rng: np.random.Generator) -> Model:
    """Return a shoe: sole, upper with an opening, tongue and laces; its tip is at +x."""
    long, wide = rng.uniform(0.25, 0.3), rng.uniform(0.09, 0.105)
    t = np.linspace(0, 1, 22)
    half = (
        wide
        / 2
        * (0.78 + 0.22 * np.sin(np.pi * (t * 1.1 - 0.35)))
        * np.clip(1.02 - np.abs(2 * t - 1) ** 5, 0.05, 1) ** 0.6
    )
    x = long * (t - 0.5)
    top = 0.05 + 0.055 * np.clip(1 - t / 0.62, 0, 1) ** 0.6 - 0.012 * np.clip(t - 0.7, 0, 1)
    top *= np.clip(1.03 - t**9, 0.3, 1)
    angle = np.linspace(0, np.pi, 20)
    rings = []
    for a, w, h in zip(x, half, top, strict=True):
        ring = np.column_stack([np.full(20, a), w * np.cos(angle), 0.02 + (h - 0.02) * np.sin(angle) ** 0.75])
        rings.append(ring)
    upper = loft(rings)
    side = np.column_stack([np.concatenate([x, x[::-1]]), np.concatenate([-half, half[::-1]]) * 1.08])
    lift = 0.008 * np.clip((np.concatenate([t, t[::-1]]) - 0.75) / 0.25, 0, 1) ** 2
    sole = loft([np.column_stack([side, lift]), np.column_stack([side, 0.024 + lift * 0.5])])
    opening = loft([np.column_stack([superellipse(0.105, wide * 0.56, 2.2, 30), np.full(30, z)]) for z in (0.0, 0.003)])
    opening = opening.moved(shift((-long * 0.27, 0, 0.094)) @ turn(0.24, 1))
    laces = [
        pipe(
            np.column_stack(
                [
                    np.full(9, long * (0.0 + 0.055 * k)),
                    wide * 0.24 * np.linspace(-1, 1, 9),
                    np.interp(0.5 + 0.055 * k, t, top) + 0.003 - 0.006 * np.linspace(-1, 1, 9) ** 2,
                ]
            ),
            0.0028,
        )
        for k in range(4)
    ]
    look = choice(rng, (fabric(rng), Material(paint(rng), shine=0.2), Material((0.12, 0.1, 0.09), shine=0.5)))
    return standing(
        "shoe",
        (upper, look),
        (sole, Material(choice(rng, ((0.92, 0.92, 0.9), (0.15, 0.14, 0.13))))),
        (opening, Material((0.07, 0.07, 0.08))),
        (merged(laces), Material((0.9, 0.9, 0.88))),
    )


def woolly_hat(rng: np.random.Generator) -> Model:
    """Return a knitted hat with a turned-up edge and a bobble."""
    r, h = rng.uniform(0.09, 0.105), rng.uniform(0.12, 0.15)
    rise = np.linspace(0, np.pi / 2, 14)
    dome = lathe(np.column_stack([r * np.cos(rise), h * np.sin(rise)]), 56)
    edge = lathe([(r * 1.04, 0), (r * 1.09, 0.015), (r * 1.08, 0.045), (r * 1.02, 0.055), (r * 0.8, 0.055)], 56)
    bobble = displaced(superellipsoid((0.024, 0.024, 0.024), 2.0, 24), rng, 0.0012, 0.024).moved(
        shift((0, 0, h + 0.014))
    )
    color, second = two_paints(rng)
    wool = Material(color, second, choice(rng, (Texture.SPECKLE, Texture.STRIPES)), 0.012)
    return standing(
        "woolly hat",
        (displaced(dome, rng, 0.005, 0.08), wool),
        (merged([edge, bobble]), Material(second, color, Texture.SPECKLE, 0.006)),
    )


def _leaf(length: float, width: float, bend: float) -> Mesh:
    """Return a leaf that starts at the origin, goes out along +x and bends down."""
    t, s = np.linspace(0, 1, 12), np.linspace(-1, 1, 5)
    half = width / 2 * np.sin(np.pi * t**0.8) ** 0.9
    angle = bend * t
    x, z = np.cumsum(np.cos(angle)) * length / 12, -np.cumsum(np.sin(angle)) * length / 12
    fold = 0.18 * np.abs(s[:, None]) * half
    points = np.stack(np.broadcast_arrays(x, s[:, None] * half, z + fold), axis=-1)
    return sheet(points, 0.0012)


def leafy_plant(rng: np.random.Generator) -> Model:
    """Return a plant in a pot with ten to twenty curved leaves."""
    r, h = rng.uniform(0.05, 0.075), rng.uniform(0.08, 0.12)
    pot = lathe(hollow([(r * 0.7, 0), (r * 0.95, h * 0.8), (r, h * 0.8), (r * 1.02, h)], 0.005, 0.006), 48)
    earth = lathe([(r * 0.96, h * 0.86), (0, h * 0.9)], 32)
    upright, broad = choice(rng, ((1.1, 0.2), (0.75, 0.42), (0.95, 0.3)))
    count = int(rng.integers(12, 22))
    leaves = []
    for k in range(count):
        bearing = k * 2.39996 + rng.uniform(-0.3, 0.3)
        length = rng.uniform(0.11, 0.19)
        up = upright * rng.uniform(0.55, 1.25) * (1.0 if k > count / 2 else 0.6)
        leaf = _leaf(length, length * broad, rng.uniform(0.4, 1.3))
        place = shift((0, 0, h * 0.88 + 0.03 * k / count)) @ turn(bearing) @ shift((0.006, 0, 0)) @ turn(-up, 1)
        leaves.append(leaf.moved(place))
    foliage = merged(leaves)
    green = choice(rng, ((0.20, 0.42, 0.18), (0.34, 0.52, 0.22), (0.16, 0.36, 0.24)))
    look = Material(green, (0.45, 0.62, 0.32), choice(rng, (Texture.PLAIN, Texture.MARBLE)), 0.03, 0.25)
    clay = choice(
        rng,
        (
            Material((0.72, 0.38, 0.25), (0.62, 0.30, 0.19), Texture.MARBLE, 0.03),
            Material((0.92, 0.92, 0.9), shine=0.5),
            Material(paint(rng), shine=0.4),
        ),
    )
    kept = foliage.vertices.copy()
    kept[:, 2] = np.maximum(kept[:, 2], 0.004)
    return standing("plant", (pot, clay), (earth, Material((0.2, 0.14, 0.1))), (Mesh(kept, foliage.faces), look))


def flowers(rng: np.random.Generator) -> Model:
    """Return a vase with flowers."""
    r, h = rng.uniform(0.035, 0.05), rng.uniform(0.15, 0.2)
    rise = np.linspace(0, 1, 18)
    vase = lathe(
        hollow(np.column_stack([r * (0.75 + 0.35 * np.sin(np.pi * rise * 0.9) - 0.35 * rise), h * rise]), 0.003, 0.006)
    )
    stems, heads, hearts = [], [], []
    for k in range(int(rng.integers(4, 8))):
        bearing, out, up = k * 2.39996, rng.uniform(0.03, 0.09), rng.uniform(0.07, 0.13)
        way = np.array([np.cos(bearing), np.sin(bearing), 0])
        t = np.linspace(0, 1, 8)[:, None]
        path = t**1.7 * out * way + (0, 0, 1) * (0.02 + (h + up - 0.02) * t)
        stems.append(pipe(path, 0.0022))
        petals = [_leaf(0.03, 0.018, 0.5).moved(turn(a) @ turn(-0.5, 1)) for a in np.arange(7) * 2 * np.pi / 7]
        place = shift(path[-1]) @ turn(bearing) @ turn(0.5, 1)
        heads.append(merged(petals).moved(place))
        hearts.append(superellipsoid((0.008, 0.008, 0.005), 2.0, 16).moved(place))
    color, second = two_paints(rng)
    return standing(
        "vase of flowers",
        (vase, Material(color, shine=0.6)),
        (merged(stems), Material((0.22, 0.45, 0.2))),
        (merged(heads), Material(second, shine=0.1)),
        (merged(hearts), Material((0.9, 0.7, 0.15))),
    )


def towel(rng: np.random.Generator) -> Model:
    """Return a folded towel: three soft layers."""
    x, y = rng.uniform(0.22, 0.3), rng.uniform(0.15, 0.2)
    layers = [
        displaced(superellipsoid((x / 2 * rng.uniform(0.97, 1.0), y / 2, 0.013), 5.0, 48), rng, 0.003, 0.1).moved(
            shift((0, 0, 0.022 * k))
        )
        for k in range(int(rng.integers(3, 5)))
    ]
    color, second = two_paints(rng)
    cloth = Material(color, second, choice(rng, (Texture.PLAIN, Texture.STRIPES)), 0.04)
    return standing("towel", (flattened(merged(layers), -0.008), cloth))


SOFT: Mapping[str, Maker] = MappingProxyType(
    {
        "handbag": handbag,
        "backpack": backpack,
        "pouch": pouch,
        "paper_bag": paper_bag,
        "cushion": cushion,
        "shoe": shoe,
        "woolly_hat": woolly_hat,
        "leafy_plant": leafy_plant,
        "flowers": flowers,
        "towel": towel,
    }
)
