"""Plates, trays, cutlery, and food."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from cuboid.lab.synthetic.material import WOODS, Material, Texture, paint, two_paints
from cuboid.lab.synthetic.mesh import Mesh, lathe, merged, shift, turn
from cuboid.lab.synthetic.shapes.model import Maker, Model, choice, standing
from cuboid.lab.synthetic.shapes.vessels import WHITE, metal
from cuboid.lab.synthetic.solids import (
    blended,
    displaced,
    flattened,
    hollow,
    loft,
    pipe,
    ribbon,
    rounded_rectangle,
    sheet,
    superellipsoid,
    swept,
)

# Wall and floor of a tray, metres.
TRAY_WALL_M, TRAY_FLOOR_M = 0.006, 0.006
# Radius of the flat part of a plate as a fraction of its radius, and its height above the foot, metres.
PLATE_FLAT, PLATE_FLOOR_M = 0.62, 0.008


def porcelain(rng: np.random.Generator) -> Material:
    """Return glazed ceramics: mostly white, some colored or speckled."""
    color, second = two_paints(rng)
    return choice(
        rng,
        (
            Material(WHITE, shine=0.6),
            Material((0.88, 0.86, 0.80), (0.55, 0.48, 0.40), Texture.SPECKLE, 0.012, 0.4),
            Material(color, second, Texture.PLAIN, shine=0.6),
        ),
    )


def _plate_mesh(r: float) -> Mesh:
    flat, floor = r * PLATE_FLAT, PLATE_FLOOR_M
    outer = [(flat * 0.9, 0), (flat, 0.002), (r * 0.7, 0.0125), (r * 0.97, 0.019), (r, 0.021)]
    inner = [(r * 0.985, 0.023), (r * 0.72, 0.0175), (r * 0.68, 0.0155), (flat, floor), (0, floor)]
    return lathe(np.concatenate([[(0, 0.0)], outer, inner]), 64)


def plate(rng: np.random.Generator) -> Model:
    """Return a plate."""
    return standing("plate", (_plate_mesh(rng.uniform(0.085, 0.135)), porcelain(rng)))


def plates(rng: np.random.Generator) -> Model:
    """Return a pile of three to seven plates, nested in each other; it counts as one object."""
    one, count = _plate_mesh(rng.uniform(0.085, 0.13)), int(rng.integers(3, 8))
    pile = merged(one.moved(shift((0, 0, 0.0085 * k))) for k in range(count))
    return standing("pile of plates", (pile, porcelain(rng)))


def meal(rng: np.random.Generator) -> Model:
    """Return a plate with food on it: slices of bread or cake, and a heap."""
    r = rng.uniform(0.105, 0.13)
    flat = r * PLATE_FLAT
    heap = blended(
        [((*(flat * 0.4 * rng.uniform(-1, 1, 2)), 0.014), (0.022, 0.02, rng.uniform(0.008, 0.016))) for _ in range(6)],
        0.006,
        0.004,
    )
    heap = heap.moved(shift((0, flat * 0.35, PLATE_FLOOR_M - heap.vertices[:, 2].min())))
    ring = rounded_rectangle(0.085, 0.06, 0.018)
    slices = [
        loft([np.column_stack([ring, np.full(len(ring), z)]) for z in (0, 0.013)]).moved(
            shift((0.012 * k - 0.01, -flat * 0.32, PLATE_FLOOR_M + 0.013 * k)) @ turn(rng.uniform(-0.4, 0.4))
        )
        for k in range(int(rng.integers(1, 3)))
    ]
    bread = Material((0.80, 0.62, 0.36), (0.70, 0.48, 0.24), Texture.MARBLE, 0.01)
    food = choice(rng, ((0.35, 0.55, 0.22), (0.80, 0.42, 0.16), (0.74, 0.24, 0.18)))
    salad = Material(food, (0.85, 0.72, 0.35), Texture.SPECKLE, 0.01)
    return standing("plate with food", (_plate_mesh(r), porcelain(rng)), (merged(slices), bread), (heap, salad))


def tray(rng: np.random.Generator) -> Model:
    """Return an empty tray with a rim."""
    return tray_of(rng, rng.uniform(0.34, 0.44), rng.uniform(0.24, 0.3))


def tray_of(rng: np.random.Generator, x: float, y: float) -> Model:
    """Return a tray of this length and width with a rim; its flat inner part is a centimetre smaller on each side."""
    h = rng.uniform(0.022, 0.04)
    outline = rounded_rectangle(2, 2 * y / x, 0.22)
    half = x / 2
    body = swept(outline, hollow([(half - 0.012, 0), (half - 0.002, h - 0.003), (half, h)], TRAY_WALL_M, TRAY_FLOOR_M))
    color, second = WOODS[int(rng.integers(len(WOODS)))]
    looks = (
        Material(color, second, Texture.WOOD, 0.05, 0.2),
        Material(paint(rng), shine=0.4),
        metal(),
        Material(WHITE, shine=0.4),
    )
    return standing("tray", (body, choice(rng, looks)))


def _handle(length: float) -> tuple[np.ndarray, ...]:
    """Return stations, widths, heights and thicknesses of a cutlery handle from its end to its neck."""
    t = np.linspace(0, 1, 12)
    width = 0.02 - 0.013 * t**0.7
    return length * t, width, 0.003 + 0.009 * np.sin(np.pi * t * 0.75) * t, np.full(12, 0.003)


def knife(rng: np.random.Generator) -> Model:
    """Return a table knife or a kitchen knife."""
    handle, blade = rng.uniform(0.09, 0.11), rng.uniform(0.1, 0.15)
    t = np.linspace(0, 1, 12)
    wide = choice(rng, (0.019, 0.034))
    grip = pipe(np.column_stack([handle * t, 0 * t, np.full(12, 0.009)]), 0.009 + 0.002 * np.sin(3 * np.pi * t), 0.75)
    edge = ribbon(
        handle + blade * t, wide * np.sqrt(np.clip(1 - t**3, 0.003, 1)), np.full(12, 0.008), np.full(12, 0.0018)
    )
    look = choice(rng, (metal(), Material((0.15, 0.12, 0.11), shine=0.3), Material((0.45, 0.28, 0.16), shine=0.2)))
    return standing("knife", (grip, look), (edge, metal()))


def spoon(rng: np.random.Generator) -> Model:
    """Return a spoon."""
    length = rng.uniform(0.11, 0.14)
    x, width, z, thick = _handle(length)
    long, wide = length * 0.4, length * 0.26
    t, s = np.linspace(0.02, 0.98, 16), np.linspace(-1, 1, 11)
    half = wide / 2 * np.sqrt(np.clip(1 - (2 * t - 1) ** 2, 0, None))
    depth = 0.012 * (1 - (2 * t - 1) ** 2) * (1 - s[:, None] ** 2)
    points = np.stack(np.broadcast_arrays(length * 0.97 + long * t, s[:, None] * half, 0.0142 - depth), axis=-1)
    return standing("spoon", (ribbon(x, width, z + 0.003, thick), metal()), (sheet(points, 0.0016), metal()))


def fork(rng: np.random.Generator) -> Model:
    """Return a fork with four tines."""
    length = rng.uniform(0.12, 0.14)
    x, width, z, thick = _handle(length)
    t = np.linspace(0, 1, 8)
    palm = ribbon(length + 0.026 * t, 0.007 + 0.017 * np.sin(t * np.pi / 2), 0.0094 - 0.004 * t, np.full(8, 0.0022))
    tines = [
        ribbon(
            length + 0.024 + 0.045 * t,
            0.0036 - 0.0016 * t,
            0.0055 - 0.004 * np.sin(np.pi * t) + 0.006 * t**2,
            np.full(8, 0.002),
        )
        for _ in range(4)
    ]
    placed = [tine.moved(shift((0, 0.0067 * (k - 1.5), 0))) for k, tine in enumerate(tines)]
    return standing("fork", (ribbon(x, width, z, thick), metal()), (merged([palm, *placed]), metal()))


def scissors(rng: np.random.Generator) -> Model:
    """Return scissors, slightly open."""
    blade, opening = rng.uniform(0.09, 0.12), rng.uniform(0.08, 0.3)
    t = np.linspace(0, 1, 10)
    grips, blades = [], []
    for side in (-1, 1):
        place = turn(side * opening / 2)
        level = 0.006 + 0.0012 * side
        cut = ribbon(-0.015 + blade * t, 0.016 * np.sqrt(1 - 0.97 * t**2), np.full(10, level), np.full(10, 0.002))
        blades.append(cut.moved(place))
        angle = np.linspace(0, 2 * np.pi, 26)
        loop = np.column_stack(
            [-0.075 + 0.03 * np.cos(angle), side * -0.024 + 0.019 * np.sin(angle), np.full(26, 0.006)]
        )
        arm = pipe([(-0.012, 0, 0.006), (-0.03, side * -0.005, 0.006), (-0.05, side * -0.013, 0.006)], 0.0055)
        grips += [pipe(loop, 0.0055).moved(place), arm.moved(place)]
    rivet = lathe([(0, 0.0), (0.005, 0.0), (0.005, 0.011), (0, 0.0115)], 16)
    return standing("scissors", (merged([*blades, rivet]), metal()), (merged(grips), Material(paint(rng), shine=0.4)))


def apple(rng: np.random.Generator) -> Model:
    """Return an apple or an orange."""
    if rng.random() < 0.3:
        r = rng.uniform(0.035, 0.042)
        rise = np.linspace(-np.pi / 2, np.pi / 2, 24)
        skin = Material((0.95, 0.55, 0.12), (0.90, 0.48, 0.08), Texture.SPECKLE, 0.004, 0.25)
        return standing("orange", (lathe(np.column_stack([r * np.cos(rise), 0.95 * r * np.sin(rise)]), 40), skin))
    r = rng.uniform(0.034, 0.042)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 30)
    radius = r * np.cos(angle) * (1.0 + 0.12 * np.sin(angle))
    height = 0.92 * r * np.sin(angle) - 0.3 * r * np.sign(angle) * np.exp(-((radius / (0.35 * r)) ** 2))
    stalk = pipe([(0, 0, 0.5 * r), (0.002, 0, 0.9 * r), (0.006, 0, 1.15 * r)], 0.0018)
    color, second = choice(
        rng,
        (
            ((0.74, 0.13, 0.12), (0.85, 0.55, 0.2)),
            ((0.50, 0.66, 0.18), (0.62, 0.74, 0.28)),
            ((0.85, 0.72, 0.2), (0.8, 0.3, 0.15)),
        ),
    )
    skin = Material(color, second, Texture.MARBLE, 0.03, 0.5)
    return standing("apple", (lathe(np.column_stack([radius, height]), 44), skin), (stalk, Material((0.3, 0.2, 0.1))))


def pear(rng: np.random.Generator) -> Model:
    """Return a pear that stands."""
    r = rng.uniform(0.032, 0.038)
    t = np.linspace(0, 1, 30)
    radius = r * np.sin(np.pi * t**0.8) ** 0.75 * (1.06 - 0.62 * t)
    body = lathe(np.column_stack([radius * 1.25, 2.7 * r * t]), 40)
    stalk = pipe([(0, 0, 2.6 * r), (0.001, 0, 2.8 * r), (0.007, 0, 3.1 * r)], 0.0018)
    skin = Material((0.70, 0.72, 0.25), (0.60, 0.55, 0.18), Texture.MARBLE, 0.02, 0.3)
    return standing("pear", (body, skin), (stalk, Material((0.3, 0.2, 0.1))))


def banana(rng: np.random.Generator) -> Model:
    """Return a banana on its side."""
    t = np.linspace(0, 1, 24)
    angle, bend = rng.uniform(1.2, 1.6) * (t - 0.5), rng.uniform(0.11, 0.13)
    path = np.column_stack([bend * np.sin(angle), bend * (1 - np.cos(angle)), np.zeros(24)])
    radius = 0.0175 * np.clip(np.sin(np.pi * np.clip(t * 0.94 + 0.03, 0, 1)), 0.0, 1) ** 0.45
    radius[t > 0.9] = 0.006
    skin = Material((0.93, 0.78, 0.18), (0.80, 0.60, 0.12), Texture.MARBLE, 0.03, 0.2)
    return standing("banana", (pipe(path, np.maximum(radius, 0.005)), skin))


def loaf(rng: np.random.Generator) -> Model:
    """Return a loaf of bread."""
    x, y, z = rng.uniform(0.2, 0.28), rng.uniform(0.1, 0.13), rng.uniform(0.07, 0.1)
    body = displaced(superellipsoid((x / 2, y / 2, z * 0.6), 2.4), rng, 0.004, 0.06)
    crust = Material((0.66, 0.42, 0.20), (0.80, 0.60, 0.36), Texture.MARBLE, 0.03)
    return standing("bread", (flattened(body, -z * 0.35), crust))


TABLEWARE: Mapping[str, Maker] = MappingProxyType(
    {
        "plate": plate,
        "plates": plates,
        "meal": meal,
        "tray": tray,
        "knife": knife,
        "spoon": spoon,
        "fork": fork,
        "scissors": scissors,
        "apple": apple,
        "pear": pear,
        "banana": banana,
        "bread": loaf,
    }
)
