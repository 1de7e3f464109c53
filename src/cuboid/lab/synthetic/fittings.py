"""Fittings of rooms: sockets, doors with handles, cabinets. They are structure: a box found there is false."""

from __future__ import annotations

import numpy as np

from cuboid.lab.synthetic.material import Material, Texture, wood
from cuboid.lab.synthetic.mesh import Mesh, box, lathe, merged, shift, turn
from cuboid.lab.synthetic.shapes.model import Model, choice
from cuboid.lab.synthetic.solids import pipe, rounded_box, superellipse, swept

PLASTIC = Material((0.94, 0.94, 0.92), shine=0.3)
STEEL = Material((0.72, 0.73, 0.75), shine=0.8)
# Height of the plinth of a cabinet, thickness of its worktop and its overhang in front, metres.
PLINTH_M, WORKTOP_M, OVERHANG_M = 0.1, 0.038, 0.02


def _toward_room(mesh: Mesh) -> Mesh:
    """Return a mesh whose top faced up, turned so that it faces -y."""
    return mesh.moved(turn(np.pi / 2, 0))


def socket(rng: np.random.Generator) -> Model:
    """Return a row of one to three wall sockets; its back is at y = 0, it faces -y."""
    plates, holes = [], []
    for k in range(int(rng.integers(1, 4))):
        place = shift((0.075 * k, 0, 0))
        plates.append(_toward_room(rounded_box((0.072, 0.072, 0.009), 0.006, 0.003)).moved(place))
        hole = swept(superellipse(2, 2, 2.0, 28), [(0.0, 0.009), (0.02, 0.009), (0.02, 0.0094), (0.0, 0.0094)])
        holes.append(_toward_room(hole).moved(place))
    return Model("socket", ((merged(plates), PLASTIC), (merged(holes), Material((0.75, 0.75, 0.74)))))


def door(rng: np.random.Generator) -> Model:
    """Return a closed door in its frame with a handle; its back is at y = 0, it faces -y."""
    wide, high = rng.uniform(0.82, 0.95), 2.02
    frame = [box((0.07, 0.03, high + 0.07), (s * (wide + 0.07) / 2, -0.015, 0)) for s in (-1, 1)]
    frame.append(box((wide + 0.14, 0.03, 0.07), (0, -0.015, high)))
    leaf = box((wide, 0.012, high), (0, -0.006, 0.004))
    panels = [box((wide * 0.62, 0.004, 0.72), (0, -0.014, z)) for z in (0.18, 1.1)]
    side = wide / 2 - 0.07
    plate = box((0.04, 0.006, 0.2), (side, -0.015, 0.92))
    grip = pipe(
        [(side, -0.015, 1.04), (side, -0.055, 1.04), (side - 0.015, -0.06, 1.04), (side - 0.12, -0.06, 1.04)], 0.009
    )
    paint_look = choice(rng, (Material((0.92, 0.92, 0.9), shine=0.2), wood(rng, 0.08)))
    return Model("door", ((merged([*frame, leaf, *panels]), paint_look), (merged([plate, grip]), STEEL)))


def _fronts(length: float, high: float, bottom: float, y: float, unit: float) -> tuple[Mesh, Mesh]:
    """Return doors side by side along x, facing -y, and their bar handles."""
    count = max(1, round(length / unit))
    wide = length / count
    doors, handles = [], []
    for k in range(count):
        x = -length / 2 + (k + 0.5) * wide
        doors.append(box((wide - 0.006, 0.018, high - 0.006), (x, y - 0.009, bottom + 0.003)))
        grip = x + (wide / 2 - 0.05) * (1 if k % 2 == 0 else -1)
        level = bottom + (high - 0.22 if bottom < 1.0 else 0.06)
        bar = [
            (grip, y - 0.018, level),
            (grip, y - 0.045, level),
            (grip, y - 0.045, level + 0.14),
            (grip, y - 0.018, level + 0.14),
        ]
        handles.append(pipe(np.array(bar), 0.005))
    return merged(doors), merged(handles)


def base_cabinets(rng: np.random.Generator, length: float, depth: float, height: float) -> Model:
    """Return base cabinets along x under a worktop; their doors with handles face -y."""
    inner = height - WORKTOP_M
    body = box((length, depth - 0.03, inner - PLINTH_M), (0, 0.0, PLINTH_M))
    plinth = box((length, depth - 0.1, PLINTH_M), (0, 0.03, 0))
    top = box((length + 0.01, depth + OVERHANG_M, WORKTOP_M), (0, -OVERHANG_M / 2, inner))
    doors, handles = _fronts(length, inner - PLINTH_M, PLINTH_M, -depth / 2 + 0.015, 0.5)
    fronts = choice(
        rng, (Material((0.90, 0.90, 0.88), shine=0.2), Material((0.35, 0.42, 0.44), shine=0.1), wood(rng, 0.08))
    )
    stone = Material((0.55, 0.54, 0.52), (0.40, 0.39, 0.38), Texture.SPECKLE, 0.006, 0.3)
    worktop = choice(rng, (stone, wood(rng, 0.07), Material((0.86, 0.85, 0.82), shine=0.3)))
    return Model(
        "cabinet",
        ((merged([body, doors]), fronts), (plinth, Material((0.15, 0.15, 0.15))), (top, worktop), (handles, STEEL)),
    )


def wall_cabinets(rng: np.random.Generator, length: float) -> Model:
    """Return cabinets that hang on a wall; their back is at y = 0, their doors face -y."""
    bottom, high, depth = 1.48, 0.65, 0.33
    body = box((length, depth, high), (0, -depth / 2, bottom))
    doors, handles = _fronts(length, high, bottom, -depth, 0.5)
    look = choice(
        rng, (Material((0.90, 0.90, 0.88), shine=0.2), Material((0.35, 0.42, 0.44), shine=0.1), wood(rng, 0.08))
    )
    return Model("cabinet", ((merged([body, doors]), look), (handles, STEEL)))


def splashback(rng: np.random.Generator, length: float, low: float) -> Model:
    """Return tiles on the wall between the worktop and the wall cabinets; they face -y."""
    tone = rng.uniform(0.7, 0.92)
    tiles = Material((tone, tone, tone * 0.97), (0.6, 0.6, 0.58), Texture.TILES, rng.uniform(0.1, 0.2), 0.4)
    return Model("tiles", ((box((length, 0.008, 1.48 - low), (0, -0.004, low)), tiles),))


def hob(rng: np.random.Generator) -> Model:
    """Return a hob with four rings, flush in a worktop (4 mm high)."""
    plate = rounded_box((0.56, 0.46, 0.004), 0.01, 0.001)
    rings = [
        lathe([(r - 0.003, 0.004), (r, 0.004), (r, 0.0045), (r - 0.003, 0.0045)], 40).moved(
            shift((a * 0.14, b * 0.11, 0))
        )
        for a, b, r in ((-1, -1, 0.09), (1, -1, 0.07), (-1, 1, 0.07), (1, 1, 0.09))
    ]
    return Model(
        "hob", ((plate, Material((0.05, 0.05, 0.06), shine=0.8)), (merged(rings), Material((0.45, 0.45, 0.47))))
    )
