"""Boxes and bodies of revolution: packages, vessels, balls."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from cuboid.lab.synthetic.material import CARD, PAINTS, Material, Texture, paint, two_paints
from cuboid.lab.synthetic.mesh import Mesh, box, grid, lathe, merged, prism, shift, tube
from cuboid.lab.synthetic.shapes.model import Maker, Model


def carton(rng: np.random.Generator) -> Model:
    """Return a printed box: cereal, tea, crackers."""
    size = (rng.uniform(0.09, 0.2), rng.uniform(0.055, 0.1), rng.uniform(0.1, 0.26))
    color, second = two_paints(rng)
    texture = (Texture.BANDS, Texture.CHECKER, Texture.STRIPES)[int(rng.integers(3))]
    return Model("box", ((box(size), Material(color, second, texture, rng.uniform(0.03, 0.06), 0.1)),))


def parcel(rng: np.random.Generator) -> Model:
    """Return a cardboard box with a strip of tape."""
    x, y, z = rng.uniform(0.14, 0.26), rng.uniform(0.12, 0.2), rng.uniform(0.09, 0.18)
    tape = box((x + 0.001, 0.05, 0.0006), (0, 0, z))
    look = Material(*CARD, Texture.MARBLE, 0.04)
    return Model("parcel", ((box((x, y, z)), look), (tape, Material((0.80, 0.70, 0.52), shine=0.4))))


def can(rng: np.random.Generator) -> Model:
    """Return a drinks or food can with a printed wall, a metal rim and a recessed lid."""
    r, h = ((0.033, 0.122), (0.037, 0.11), (0.05, 0.12))[int(rng.integers(3))]
    wall = lathe([(0, 0), (r - 0.006, 0), (r, 0.006), (r, h - 0.01)])
    rim = lathe(
        [
            (r, h - 0.01),
            (r - 0.004, h - 0.001),
            (r - 0.005, h),
            (r - 0.007, h - 0.001),
            (r - 0.008, h - 0.006),
            (0, h - 0.006),
        ]
    )
    color, second = two_paints(rng)
    texture = (Texture.BANDS, Texture.STRIPES)[int(rng.integers(2))]
    printed = Material(color, second, texture, rng.uniform(0.025, 0.045), 0.5)
    return Model("can", ((wall, printed), (rim, Material((0.78, 0.79, 0.81), shine=0.8))))


def mug(rng: np.random.Generator) -> Model:
    """Return a hollow mug with its handle."""
    r, h, wall = rng.uniform(0.038, 0.048), rng.uniform(0.085, 0.11), 0.0045
    body = lathe(
        [
            (0, 0),
            (r - 0.005, 0),
            (r, 0.006),
            (r, h - 0.002),
            (r - wall / 2, h),
            (r - wall, h - 0.002),
            (r - wall, 0.014),
            (r - wall - 0.006, 0.008),
            (0, 0.008),
        ]
    )
    angle = np.linspace(-0.5 * np.pi - 0.25, 0.5 * np.pi + 0.25, 20)
    ring = np.column_stack([r - 0.004 + 0.03 * np.cos(angle), np.zeros(20), h * 0.52 + 0.031 * np.sin(angle)])
    color, second = two_paints(rng)
    texture = (Texture.PLAIN, Texture.BANDS, Texture.SPECKLE)[int(rng.integers(3))]
    glaze = Material(color, second, texture, 0.03, 0.6)
    return Model("mug", ((body, glaze), (tube(ring, 0.0055), Material(color, shine=0.6))))


def bowl(rng: np.random.Generator) -> Model:
    """Return a hollow bowl on a foot ring."""
    r, h, foot = rng.uniform(0.07, 0.105), rng.uniform(0.055, 0.085), 0.035
    rise = np.linspace(0.0, 1.0, 14)
    outer = np.column_stack([foot + (r - foot) * np.sin(rise * np.pi / 2) ** 0.9, 0.008 + (h - 0.008) * rise**1.6])
    inner = outer[::-1] - (0.005, 0.0)
    inner[:, 1] = np.maximum(inner[:, 1], 0.014)
    profile = np.concatenate([[(0, 0.004), (foot - 0.005, 0), (foot, 0)], outer, inner, [(0, 0.014)]])
    color, second = two_paints(rng)
    texture = (Texture.PLAIN, Texture.SPECKLE, Texture.MARBLE)[int(rng.integers(3))]
    return Model("bowl", ((lathe(profile, 56), Material(color, second, texture, 0.02, 0.5)),))


def cap(rng: np.random.Generator) -> Model:
    """Return a baseball cap: a dome of six panels and a brim in front."""
    r, h, color = rng.uniform(0.085, 0.095), rng.uniform(0.1, 0.125), paint(rng)
    rise = np.linspace(0, np.pi / 2, 14)
    dome = lathe(
        np.concatenate(
            [
                np.column_stack([r * np.cos(rise) ** 0.8, h * np.sin(rise)]),
                np.column_stack([(r - 0.003) * np.sin(rise) ** 0.8, (h - 0.003) * np.cos(rise)]),
            ]
        ),
        60,
    )
    button = lathe([(0.009, h - 0.002), (0.008, h + 0.004), (0, h + 0.006)], 16)
    second = PAINTS[int(rng.integers(len(PAINTS)))]
    shade = (0.72 * color[0], 0.72 * color[1], 0.72 * color[2])
    cloth = Material(color, shade, Texture.SPECKLE, 0.01)
    return Model("cap", ((dome, cloth), (merged([_brim(r), button]), Material(second, color, Texture.SPECKLE, 0.008))))


def _brim(r: float) -> Mesh:
    """Return a brim 4 mm thick that curves down to its sides, in front (+x) of a dome of radius r."""
    angle = np.linspace(-1.15, 1.15, 25)
    out = np.linspace(0.0, 1.0, 6)
    reach = 0.075 * np.cos(angle / 1.15 * np.pi / 2) ** 0.6
    radius = r * 0.97 + np.outer(out, reach)
    height = 0.022 - 0.018 * (angle / 1.15) ** 2 - 0.01 * np.outer(out, np.ones(25)) + 0.004
    top = np.stack([radius * np.cos(angle), radius * np.sin(angle) * 0.98, np.maximum(height, 0.004)], axis=-1)
    bottom = top - (0, 0, 0.004)
    return grid(np.concatenate([bottom, top[::-1], bottom[:1]]))


def bottle(rng: np.random.Generator) -> Model:
    """Return a bottle with a label and a cap."""
    r, h = rng.uniform(0.03, 0.042), rng.uniform(0.2, 0.29)
    shoulder = h * rng.uniform(0.6, 0.7)
    neck = np.linspace(0, 1, 10)
    curve = np.column_stack([r + (0.014 - r) * (3 * neck**2 - 2 * neck**3), shoulder + (h * 0.88 - shoulder) * neck])
    glass = lathe(np.concatenate([[(0, 0), (r - 0.004, 0), (r, 0.005), (r, shoulder)], curve[1:], [(0.014, h * 0.92)]]))
    lid = lathe([(0.0155, h * 0.92), (0.0155, h - 0.002), (0.014, h), (0, h)], 32)
    label = lathe([(r + 0.0006, shoulder * 0.3), (r + 0.0006, shoulder * 0.85)])
    color, second = two_paints(rng)
    glass_look = Material((0.16, 0.34, 0.24) if rng.random() < 0.5 else (0.42, 0.25, 0.12), shine=0.9)
    return Model(
        "bottle",
        (
            (glass, glass_look),
            (lid, Material(color, shine=0.4)),
            (label, Material(second, color, Texture.BANDS, 0.03, 0.1)),
        ),
    )


def book(rng: np.random.Generator) -> Model:
    """Return a thick book that lies flat: two covers, a spine, pages between."""
    x, y, z = rng.uniform(0.2, 0.26), rng.uniform(0.14, 0.18), rng.uniform(0.035, 0.055)
    color, second = two_paints(rng)
    covers = [
        box((x, y, 0.004)),
        box((x, y, 0.004), (0, 0, z - 0.004)),
        box((x, 0.004, z), (0, -y / 2 + 0.002, 0)),
    ]
    pages = box((x - 0.008, y - 0.012, z - 0.008), (0, 0.0, 0.004))
    return Model(
        "book",
        (
            (merged(covers), Material(color, second, Texture.BANDS, 0.05, 0.2)),
            (pages, Material((0.93, 0.90, 0.82), (0.80, 0.77, 0.70), Texture.STRIPES, 0.004)),
        ),
    )


def ball(rng: np.random.Generator) -> Model:
    """Return a ball."""
    r = rng.uniform(0.045, 0.09)
    rise = np.linspace(-np.pi / 2, np.pi / 2, 28)
    profile = np.column_stack([r * np.cos(rise), r + r * np.sin(rise)])
    color, second = two_paints(rng)
    texture = (Texture.CHECKER, Texture.STRIPES, Texture.MARBLE)[int(rng.integers(3))]
    return Model("ball", ((lathe(profile, 56), Material(color, second, texture, r * 0.8, 0.3)),))


def milk(rng: np.random.Generator) -> Model:
    """Return a milk carton with its gable."""
    a, h = rng.uniform(0.065, 0.08), rng.uniform(0.15, 0.19)
    roof = prism([(-a / 2, -a / 2), (a / 2, -a / 2), (a / 2, a / 2), (-a / 2, a / 2)], a * 0.45)
    gable = roof.vertices.copy()
    gable[4:8, 1] *= 0.08
    ridge = box((a, 0.006, 0.018), (0, 0, h + a * 0.45))
    color = paint(rng)
    look = Material((0.94, 0.94, 0.92), color, Texture.BANDS, 0.05, 0.15)
    top = merged([Mesh(gable, roof.faces).moved(shift((0, 0, h))), ridge])
    return Model("milk carton", ((box((a, a, h)), look), (top, Material(color, shine=0.15))))


def plant(rng: np.random.Generator) -> Model:
    """Return a cactus-like plant in a pot."""
    r, h = rng.uniform(0.05, 0.065), rng.uniform(0.08, 0.1)
    pot = lathe([(0, 0), (r * 0.72, 0), (r, h), (r - 0.007, h), (r - 0.01, h - 0.012), (0, h - 0.012)])
    s, tall = r * 0.62, rng.uniform(0.09, 0.14)
    rise = np.linspace(0, np.pi / 2, 10)
    stem = lathe(
        np.concatenate(
            [
                [(s * 0.8, h - 0.02), (s, h + tall * 0.4)],
                np.column_stack([s * np.cos(rise), h + tall * (0.5 + 0.5 * np.sin(rise))]),
            ]
        ),
        32,
    )
    clay = Material((0.72, 0.38, 0.25), (0.62, 0.30, 0.19), Texture.MARBLE, 0.03)
    green = Material((0.25, 0.50, 0.24), (0.42, 0.63, 0.30), Texture.STRIPES, 0.012)
    return Model("plant", ((pot, clay), (stem, green)))


def jar(rng: np.random.Generator) -> Model:
    """Return a jar with a wide lid."""
    r, h = rng.uniform(0.036, 0.05), rng.uniform(0.1, 0.14)
    body = lathe([(0, 0), (r - 0.006, 0), (r, 0.008), (r, h * 0.78), (r * 0.86, h * 0.86), (r * 0.86, h * 0.87)])
    lid = lathe([(r * 0.92, h * 0.85), (r * 0.92, h - 0.003), (r * 0.88, h), (0, h)])
    color, second = two_paints(rng)
    return Model(
        "jar",
        ((body, Material(color, second, Texture.MARBLE, 0.035, 0.6)), (lid, Material(second, shine=0.5))),
    )


def teapot(rng: np.random.Generator) -> Model:
    """Return a round pot with a spout, a handle and a lid."""
    r, color, second = rng.uniform(0.06, 0.075), *two_paints(rng)
    rise = np.linspace(-np.pi / 2 * 0.72, np.pi / 2 * 0.8, 20)
    base = r * 0.82 * np.sin(np.pi / 2 * 0.72)
    body = lathe(
        np.concatenate(
            [
                [(0, 0)],
                np.column_stack([r * np.cos(rise), base + r * 0.82 * np.sin(rise)]),
                [(0, base + r * 0.8)],
            ]
        ),
        56,
    )
    knob = lathe(
        [
            (0.007, base + r * 0.76),
            (0.007, base + r * 0.9),
            (0.013, base + r),
            (0.01, base + r * 1.12),
            (0, base + r * 1.16),
        ],
        24,
    )
    t = np.linspace(0, 1, 12)
    spout = np.column_stack([r * 0.85 + 0.055 * t, np.zeros(12), base * 0.75 + 0.065 * t**1.6])
    angle = np.linspace(-1.9, 1.9, 22)
    handle = np.column_stack([-r * 0.9 - 0.032 * np.cos(angle), np.zeros(22), base + 0.036 * np.sin(angle)])
    glaze = Material(color, second, Texture.SPECKLE, 0.03, 0.6)
    return Model(
        "teapot",
        (
            (body, glaze),
            (
                merged([knob, tube(spout, 0.015 - 0.006 * t), tube(handle[::-1], 0.006)]),
                Material(color, shine=0.6),
            ),
        ),
    )


def hat_box(rng: np.random.Generator) -> Model:
    """Return a six-sided box with a lid."""
    r, h = rng.uniform(0.07, 0.1), rng.uniform(0.07, 0.12)
    angle = np.arange(6) * np.pi / 3
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    lid = prism(ring * r * 1.05, 0.03).moved(shift((0, 0, h - 0.025)))
    color, second = two_paints(rng)
    return Model(
        "six-sided box",
        (
            (prism(ring * r, h), Material(color, second, Texture.CHECKER, 0.03)),
            (lid, Material(second, shine=0.1)),
        ),
    )


MAKERS: Mapping[str, Maker] = MappingProxyType(
    {
        "carton": carton,
        "can": can,
        "mug": mug,
        "bowl": bowl,
        "cap": cap,
        "bottle": bottle,
        "book": book,
        "ball": ball,
        "milk": milk,
        "parcel": parcel,
        "plant": plant,
        "jar": jar,
        "teapot": teapot,
        "hat_box": hat_box,
    }
)
