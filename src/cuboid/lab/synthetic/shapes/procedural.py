"""Shapes with a random number of different parts, or with surfaces that need more than a formula."""

from __future__ import annotations

import numpy as np

from cuboid.lab.synthetic.material import Material, Texture, two_paints
from cuboid.lab.synthetic.mesh import lathe, merged, shift, turn
from cuboid.lab.synthetic.shapes.model import Model, choice, standing
from cuboid.lab.synthetic.shapes.table import PLATE_FLAT, PLATE_FLOOR_M, leaf, material, plate_profile
from cuboid.lab.synthetic.solids import (
    blended,
    hollow,
    loft,
    pipe,
    rounded_rectangle,
    sheet,
    superellipsoid,
)


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
    return standing(
        "plate with food",
        (lathe(plate_profile(r), 64), material(rng, "porcelain")),
        (merged(slices), bread),
        (heap, salad),
    )


def flowers(rng: np.random.Generator) -> Model:
    """Return a vase with flowers."""
    r, h = rng.uniform(0.035, 0.05), rng.uniform(0.15, 0.2)
    rise = np.linspace(0, 1, 18)
    vase = lathe(
        hollow(np.column_stack([r * (0.75 + 0.35 * np.sin(np.pi * rise * 0.9) - 0.35 * rise), h * rise]), 0.003, 0.006)
    )
    petal = sheet(leaf(0.03, 0.018, 0.5), 0.0012)
    stems, heads, hearts = [], [], []
    for k in range(int(rng.integers(4, 8))):
        bearing, out, up = k * 2.39996, rng.uniform(0.03, 0.09), rng.uniform(0.07, 0.13)
        way = np.array([np.cos(bearing), np.sin(bearing), 0])
        t = np.linspace(0, 1, 8)[:, None]
        path = t**1.7 * out * way + (0, 0, 1) * (0.02 + (h + up - 0.02) * t)
        stems.append(pipe(path, 0.0022))
        petals = [petal.moved(turn(a) @ turn(-0.5, 1)) for a in np.arange(7) * 2 * np.pi / 7]
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
