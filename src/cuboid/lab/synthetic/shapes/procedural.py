"""Shapes with a random number of different parts, or with surfaces that need more than a formula."""

from __future__ import annotations

import numpy as np

from cuboid.lab.synthetic.material import BLACK, STEEL, WHITE, Material, Texture, paint, two_paints
from cuboid.lab.synthetic.mesh import Mesh, box, lathe, merged, shift, turn
from cuboid.lab.synthetic.shapes.model import Model, choice, plain, standing
from cuboid.lab.synthetic.shapes.table import PLATE_FLAT, PLATE_FLOOR_M, arc, build, leaf, material, plate_profile
from cuboid.lab.synthetic.solids import (
    blended,
    hollow,
    loft,
    pipe,
    rounded_rectangle,
    sheet,
    superellipse,
    superellipsoid,
    waves,
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


def pen_cup(rng: np.random.Generator) -> Model:
    """Return a cup with pens, pencils and a ruler in it."""
    r, h = rng.uniform(0.034, 0.042), rng.uniform(0.09, 0.11)
    cup = lathe(hollow([(r * 0.96, 0), (r, h)], 0.003, 0.004))
    parts = [(cup, Material(choice(rng, (paint(rng), BLACK, STEEL)), shine=0.4))]
    for k in range(int(rng.integers(4, 7))):
        bearing = 2 * np.pi * (k + rng.uniform(-0.3, 0.3)) / 6
        out = np.array([np.cos(bearing), np.sin(bearing)])
        low, high = -0.35 * r * out, 0.82 * r * out
        length, tip = rng.uniform(0.13, 0.165), np.array([*(high - low), h - 0.008])
        end = np.array([*low, 0.006]) + tip / np.linalg.norm(tip) * length
        pen = pipe(np.linspace((*low, 0.006), end, 3), 0.0038)
        parts.append((pen, Material(paint(rng), shine=0.4)))
    return standing("pens in a cup", *parts)


def paperback(rng: np.random.Generator) -> Model:
    """Return a thin book that lies."""
    sizes = {"high": rng.uniform(0.18, 0.24), "deep": rng.uniform(0.12, 0.17), "thick": rng.uniform(0.012, 0.03)}
    return standing("book", *build("volume", rng, **sizes).moved(turn(np.pi / 2, 0)).parts)


def standing_book(rng: np.random.Generator) -> Model:
    """Return a thick book or a folder that stands."""
    return standing("standing book", *build("volume", rng).parts)


def row_of_books(rng: np.random.Generator) -> Model:
    """Return four to eight books that stand side by side; the last one leans on them."""
    parts: list[tuple[Mesh, Material]] = []
    at, high = 0.0, 0.2
    for _ in range(int(rng.integers(4, 9))):
        high, thick = rng.uniform(0.17, 0.26), rng.uniform(0.014, 0.042)
        place = shift((rng.uniform(-0.012, 0.0), at + thick / 2, 0))
        parts += build("volume", rng, high=high, deep=rng.uniform(0.12, 0.17), thick=thick).moved(place).parts
        at += thick + 0.0006
    if rng.random() < 0.6:
        lean, thick = rng.uniform(0.15, 0.3), rng.uniform(0.014, 0.025)
        tall = min(rng.uniform(0.17, 0.24), (high - 0.01) / np.cos(lean))
        # The upper edge of the leaning book touches the last one, its lower edge stands.
        place = shift(
            (0, at + 0.001 + tall * np.sin(lean) + thick / 2 * np.cos(lean), thick / 2 * np.sin(lean))
        ) @ turn(lean, 0)
        parts += build("volume", rng, high=tall, deep=rng.uniform(0.12, 0.17), thick=thick).moved(place).parts
    return standing("row of books", *parts)


def pile_of_books(rng: np.random.Generator) -> Model:
    """Return a pile of three to five books, each turned a little; it counts as one object."""
    parts: list[tuple[Mesh, Material]] = []
    level = 0.0
    for _ in range(int(rng.integers(3, 6))):
        thick = rng.uniform(0.015, 0.035)
        place = shift((0, 0, level + thick / 2)) @ turn(rng.uniform(-0.2, 0.2)) @ turn(np.pi / 2, 0)
        volume = build("volume", rng, high=rng.uniform(0.19, 0.25), deep=rng.uniform(0.13, 0.18), thick=thick)
        parts += volume.moved(place @ shift((0, 0, -0.11))).parts
        level += thick + 0.0004
    return standing("pile of books", *parts)


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


def block_tower(rng: np.random.Generator) -> Model:
    """Return a building of four to seven blocks in different colors; it counts as one object."""
    a = rng.uniform(0.035, 0.05)
    parts: list[tuple[Mesh, Material]] = [(box((a, a, a), (s * a * 0.75, 0, 0)), plain(rng)) for s in (-1, 1)]
    parts.append((box((2.5 * a, a, 0.6 * a), (0, 0, a)), plain(rng)))
    level = 1.6 * a
    for _ in range(int(rng.integers(1, 4))):
        high = a * rng.uniform(0.6, 1.1)
        turned = box((a, a, high)).moved(shift((rng.uniform(-0.3, 0.3) * a, 0, level)) @ turn(rng.uniform(-0.3, 0.3)))
        parts.append((turned, plain(rng)))
        level += high
    roof = lathe([(0, level), (a * 0.5, level), (0, level + a)], 36)
    return standing("toy blocks", *parts, *([(roof, plain(rng))] if rng.random() < 0.5 else []))


def ring_tower(rng: np.random.Generator) -> Model:
    """Return a peg with rings of decreasing size."""
    h = rng.uniform(0.026, 0.032)
    parts = [(lathe([(0, 0), (0.06, 0), (0.06, 0.012), (0, 0.014)], 40), Material(WHITE, shine=0.3))]
    bend = np.linspace(-np.pi / 2, np.pi / 2, 9)
    count = int(rng.integers(3, 6))
    for k in range(count):
        r = 0.055 - 0.007 * k
        profile = np.column_stack([r - h / 2 + h / 2 * np.cos(bend), 0.012 + h * (k + 0.5) + h / 2 * np.sin(bend)])
        parts.append(
            (lathe(np.concatenate([[(0.01, profile[0, 1])], profile, [(0.01, profile[-1, 1])]]), 40), plain(rng))
        )
    ball = superellipsoid((0.018, 0.018, 0.018), 2.0, 24).moved(shift((0, 0, 0.024 + h * count)))
    return standing("ring tower", *parts, (ball, plain(rng)))
