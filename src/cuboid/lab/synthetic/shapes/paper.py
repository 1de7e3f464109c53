"""Things of paper and cardboard: books that lie and stand, folders, a box with flaps."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from cuboid.lab.synthetic.material import CARD, Material, Texture, paint, two_paints
from cuboid.lab.synthetic.mesh import Mesh, box, lathe, merged, shift, turn
from cuboid.lab.synthetic.shapes.model import Maker, Model, choice, standing

PAGES = Material((0.93, 0.90, 0.82), (0.80, 0.77, 0.70), Texture.STRIPES, 0.004)
# Thickness of cardboard, metres.
CARD_M = 0.004


def _volume(rng: np.random.Generator, high: float, deep: float, thick: float) -> tuple[tuple[Mesh, Material], ...]:
    """Return a standing book along y with its back at +x: covers and pages."""
    cover = 0.0025
    boards = [box((deep, cover, high), (0, s * (thick - cover) / 2, 0)) for s in (-1, 1)]
    back = box((cover, thick, high), (deep / 2 - cover / 2, 0, 0))
    label = box((0.0006, thick * 0.7, high * 0.16), (deep / 2, 0, high * rng.uniform(0.55, 0.75)))
    pages = box((deep - 0.006, thick - 2 * cover, high - 0.008), (-0.001, 0, 0.004))
    color, second = two_paints(rng)
    pattern = choice(rng, (Texture.PLAIN, Texture.BANDS, Texture.PLAIN))
    return (
        (merged([*boards, back]), Material(color, second, pattern, 0.05, 0.2)),
        (label, Material(second, shine=0.2)),
        (pages, PAGES),
    )


def paperback(rng: np.random.Generator) -> Model:
    """Return a thin book that lies."""
    parts = _volume(rng, rng.uniform(0.18, 0.24), rng.uniform(0.12, 0.17), rng.uniform(0.012, 0.03))
    return standing("book", *((mesh.moved(turn(np.pi / 2, 0)), look) for mesh, look in parts))


def standing_book(rng: np.random.Generator) -> Model:
    """Return a thick book or a folder that stands."""
    parts = _volume(rng, rng.uniform(0.2, 0.27), rng.uniform(0.14, 0.2), rng.uniform(0.035, 0.06))
    return standing("standing book", *parts)


def row_of_books(rng: np.random.Generator) -> Model:
    """Return four to eight books that stand side by side; the last one leans on them."""
    parts: list[tuple[Mesh, Material]] = []
    at, high = 0.0, 0.2
    for _ in range(int(rng.integers(4, 9))):
        high, thick = rng.uniform(0.17, 0.26), rng.uniform(0.014, 0.042)
        place = shift((rng.uniform(-0.012, 0.0), at + thick / 2, 0))
        parts += [(mesh.moved(place), look) for mesh, look in _volume(rng, high, rng.uniform(0.12, 0.17), thick)]
        at += thick + 0.0006
    if rng.random() < 0.6:
        lean, thick = rng.uniform(0.15, 0.3), rng.uniform(0.014, 0.025)
        tall = min(rng.uniform(0.17, 0.24), (high - 0.01) / np.cos(lean))
        # The upper edge of the leaning book touches the last one, its lower edge stands.
        place = shift(
            (0, at + 0.001 + tall * np.sin(lean) + thick / 2 * np.cos(lean), thick / 2 * np.sin(lean))
        ) @ turn(lean, 0)
        parts += [(mesh.moved(place), look) for mesh, look in _volume(rng, tall, rng.uniform(0.12, 0.17), thick)]
    return standing("row of books", *parts)


def pile_of_books(rng: np.random.Generator) -> Model:
    """Return a pile of three to five books, each turned a little; it counts as one object."""
    parts: list[tuple[Mesh, Material]] = []
    level = 0.0
    for _ in range(int(rng.integers(3, 6))):
        thick = rng.uniform(0.015, 0.035)
        place = shift((0, 0, level + thick / 2)) @ turn(rng.uniform(-0.2, 0.2)) @ turn(np.pi / 2, 0)
        volume = _volume(rng, rng.uniform(0.19, 0.25), rng.uniform(0.13, 0.18), thick)
        parts += [(mesh.moved(place @ shift((0, 0, -0.11))), look) for mesh, look in volume]
        level += thick + 0.0004
    return standing("pile of books", *parts)


def binder(rng: np.random.Generator) -> Model:
    """Return a ring binder that stands, with a label and a finger hole on its back."""
    high, deep, thick = 0.315, 0.285, rng.uniform(0.05, 0.08)
    shell = merged(
        [
            *(box((deep, 0.003, high), (0, s * (thick - 0.003) / 2, 0)) for s in (-1, 1)),
            box((0.003, thick, high), (deep / 2 - 0.0015, 0, 0)),
        ]
    )
    label = box((0.0006, thick * 0.75, 0.14), (deep / 2, 0, 0.13))
    hole = lathe([(0, 0), (0.012, 0), (0.012, 0.0008), (0, 0.0008)], 24).moved(
        shift((deep / 2, 0, 0.06)) @ turn(np.pi / 2, 1)
    )
    color = paint(rng)
    dim = (0.55 * color[0], 0.55 * color[1], 0.55 * color[2])
    return standing(
        "binder",
        (shell, Material(color, dim, choice(rng, (Texture.PLAIN, Texture.MARBLE)), 0.015, 0.1)),
        (label, Material((0.94, 0.94, 0.92))),
        (hole, Material((0.1, 0.1, 0.1))),
        (box((deep - 0.03, thick - 0.016, 0.297), (-0.01, 0, 0.003)), PAGES),
    )


def open_carton(rng: np.random.Generator) -> Model:
    """Return an open cardboard box with four flaps."""
    x, y, z = rng.uniform(0.2, 0.3), rng.uniform(0.15, 0.22), rng.uniform(0.1, 0.18)
    walls = [box((x, y, CARD_M))]
    flaps = []
    for side, (along, across) in enumerate(((x, y), (y, x), (x, y), (y, x))):
        place = turn(side * np.pi / 2) @ shift((0, -across / 2, 0))
        walls.append(box((along, CARD_M, z), (0, CARD_M / 2, 0)).moved(place))
        flap = box((along - 0.004, CARD_M, min(across / 2, 0.1)))
        opened = rng.uniform(1.0, 2.3)
        flaps.append(flap.moved(place @ shift((0, CARD_M / 2, z - 0.001)) @ turn(opened, 0)))
    look = Material(*CARD, Texture.MARBLE, 0.04)
    print_look = Material((0.35, 0.25, 0.18), CARD[0], Texture.BANDS, 0.02)
    mark = box((x * 0.35, 0.0006, z * 0.3), (0, -y / 2 - 0.0003, z * 0.35))
    return standing("cardboard box", (merged([*walls, *flaps]), look), (mark, print_look))


def letter_tray(rng: np.random.Generator) -> Model:
    """Return two letter trays on each other with sheets in them, open to +x."""
    x, y, gap = 0.33, 0.25, 0.07
    parts: list[tuple[Mesh, Material]] = []
    look = Material(choice(rng, (paint(rng), (0.2, 0.2, 0.22), (0.8, 0.82, 0.84))), shine=0.4)
    shells, stacks = [], []
    for level in (0.0, gap):
        shells += [box((x, y, 0.003), (0, 0, level)), box((0.003, y, 0.05), (-x / 2, 0, level))]
        shells += [box((x, 0.003, 0.05), (0, s * (y - 0.003) / 2, level)) for s in (-1, 1)]
        stacks.append(box((0.297, 0.21, rng.uniform(0.004, 0.03)), (0.005, rng.uniform(-0.01, 0.01), level + 0.003)))
    shells += [box((0.012, 0.003, gap), (a * 0.14, b * (y - 0.003) / 2, 0)) for a in (-1, 1) for b in (-1, 1)]
    parts += [
        (merged(shells), look),
        (merged(stacks), Material((0.95, 0.95, 0.94), (0.85, 0.85, 0.84), Texture.STRIPES, 0.003)),
    ]
    return standing("letter trays", *parts)


PAPER: Mapping[str, Maker] = MappingProxyType(
    {
        "paperback": paperback,
        "standing_book": standing_book,
        "row_of_books": row_of_books,
        "pile_of_books": pile_of_books,
        "binder": binder,
        "open_carton": open_carton,
        "letter_trays": letter_tray,
    }
)
