"""Toys in plain colors: animals, vehicles, blocks."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic.material import Color, Material, Texture, paint
from cuboid.lab.synthetic.mesh import Mesh, box, lathe, merged, prism, shift, turn
from cuboid.lab.synthetic.shapes.model import Maker, Model, choice, standing
from cuboid.lab.synthetic.shapes.vessels import BLACK, WHITE
from cuboid.lab.synthetic.solids import blended, flattened, hollow, loft, pipe, rounded_box, superellipsoid

# Side of a cell of the fields of animals, as a fraction of their height.
CELL = 0.028


def _plain(rng: np.random.Generator) -> Material:
    return Material(paint(rng), shine=0.3)


def _eyes(center: tuple[float, float, float], apart: float, r: float) -> Mesh:
    """Return two round eyes, which look to +x."""
    eye = superellipsoid((r, r, r), 2.0, 16)
    return merged(eye.moved(shift((center[0], s * apart / 2, center[2]))) for s in (-1, 1))


def bear(rng: np.random.Generator) -> Model:
    """Return a teddy bear that sits and looks to +x."""
    h = rng.uniform(0.17, 0.26)
    body = [
        ((0, 0, 0.30), (0.21, 0.23, 0.28)),
        ((0.03, 0, 0.72), (0.2, 0.215, 0.2)),
        ((0.0, 0.17, 0.92), (0.045, 0.075, 0.08)),
        ((0.0, -0.17, 0.92), (0.045, 0.075, 0.08)),
        ((0.1, 0.27, 0.42), (0.17, 0.075, 0.08)),
        ((0.1, -0.27, 0.42), (0.17, 0.075, 0.08)),
        ((0.27, 0.17, 0.1), (0.2, 0.09, 0.095)),
        ((0.27, -0.17, 0.1), (0.2, 0.09, 0.095)),
    ]
    snout = superellipsoid((0.095 * h, 0.1 * h, 0.075 * h), 2.0, 24).moved(shift((0.2 * h, 0, 0.67 * h)))
    belly = superellipsoid((0.07 * h, 0.15 * h, 0.18 * h), 2.0, 24).moved(shift((0.165 * h, 0, 0.32 * h)))
    feet = [
        superellipsoid((0.02 * h, 0.07 * h, 0.075 * h), 2.0, 20).moved(shift((0.465 * h, s * 0.17 * h, 0.1 * h)))
        for s in (-1, 1)
    ]
    nose = superellipsoid((0.02 * h, 0.035 * h, 0.025 * h), 2.0, 16).moved(shift((0.29 * h, 0, 0.7 * h)))
    fur = choice(rng, ((0.55, 0.36, 0.20), (0.72, 0.54, 0.34), (0.86, 0.80, 0.70), paint(rng)))
    pale = tuple(0.5 + 0.5 * c for c in fur)
    shade = tuple(0.85 * c for c in fur)
    mesh = flattened(_scaled(blended(body, 0.035, CELL), h), 0.01 * h)
    return standing(
        "teddy bear",
        (mesh, Material(fur, (shade[0], shade[1], shade[2]), Texture.SPECKLE, 0.006)),
        (merged([snout, belly, *feet]), Material((pale[0], pale[1], pale[2]))),
        (merged([nose, _eyes((0.215 * h, 0, 0.79 * h), 0.17 * h, 0.022 * h)]), Material(BLACK, shine=0.8)),
    )


def _scaled(mesh: Mesh, factor: float) -> Mesh:
    return Mesh(mesh.vertices * factor, mesh.faces)


def duck(rng: np.random.Generator) -> Model:
    """Return a bath duck that looks to +x."""
    h = rng.uniform(0.08, 0.14)
    body = [
        ((0, 0, 0.28), (0.46, 0.34, 0.28)),
        ((0.22, 0, 0.74), (0.25, 0.24, 0.24)),
        ((-0.42, 0, 0.46), (0.16, 0.14, 0.1)),
        ((0.12, 0, 0.5), (0.2, 0.18, 0.16)),
    ]
    wings = [
        superellipsoid((0.24 * h, 0.05 * h, 0.13 * h), 2.0, 24).moved(
            shift((-0.08 * h, s * 0.33 * h, 0.34 * h)) @ turn(0.25, 1)
        )
        for s in (-1, 1)
    ]
    beak = merged(
        [
            superellipsoid((0.14 * h, 0.11 * h, 0.035 * h), 2.4, 24).moved(
                shift((0.5 * h, 0, 0.72 * h)) @ turn(-0.12, 1)
            ),
            superellipsoid((0.1 * h, 0.09 * h, 0.028 * h), 2.4, 24).moved(
                shift((0.48 * h, 0, 0.67 * h)) @ turn(0.15, 1)
            ),
        ]
    )
    yellow: Color = choice(rng, ((0.96, 0.80, 0.12), (0.96, 0.80, 0.12), paint(rng)))
    mesh = flattened(_scaled(blended(body, 0.05, CELL), h), 0.05 * h)
    return standing(
        "toy duck",
        (mesh, Material(yellow, shine=0.4)),
        (merged(wings), Material(yellow, shine=0.4)),
        (beak, Material((0.92, 0.38, 0.08), shine=0.4)),
        (_eyes((0.42 * h, 0, 0.82 * h), 0.22 * h, 0.032 * h), Material(BLACK, shine=0.8)),
    )


def elephant(rng: np.random.Generator) -> Model:
    """Return a toy elephant that stands and looks to +x."""
    h = rng.uniform(0.1, 0.16)
    body = [((0.0, 0.0, 0.58), (0.42, 0.27, 0.28)), ((0.45, 0.0, 0.72), (0.22, 0.2, 0.23))]
    body += [((a, b, 0.18), (0.11, 0.11, 0.24)) for a in (-0.24, 0.24) for b in (-0.14, 0.14)]
    body += [
        ((0.64, 0.0, 0.58), (0.1, 0.09, 0.16)),
        ((0.7, 0.0, 0.38), (0.07, 0.065, 0.16)),
        ((0.76, 0.0, 0.24), (0.09, 0.055, 0.06)),
    ]
    ears = [
        superellipsoid((0.13 * h, 0.025 * h, 0.19 * h), 2.0, 24).moved(
            shift((0.33 * h, s * 0.24 * h, 0.74 * h)) @ turn(s * 0.5)
        )
        for s in (-1, 1)
    ]
    color = choice(rng, ((0.55, 0.57, 0.62), paint(rng)))
    mesh = flattened(_scaled(blended(body, 0.03, CELL), h), 0.0)
    tail = pipe(np.array([(-0.4, 0, 0.6), (-0.48, 0, 0.5), (-0.49, 0, 0.36)]) * h, 0.018 * h)
    return standing(
        "toy elephant",
        (mesh, Material(color, shine=0.2)),
        (merged([*ears, tail]), Material((0.85 * color[0], 0.85 * color[1], 0.85 * color[2]), shine=0.2)),
        (_eyes((0.6 * h, 0, 0.8 * h), 0.26 * h, 0.022 * h), Material(BLACK, shine=0.8)),
    )


def _wheels(places: tuple[tuple[float, float], ...], r: float, wide: float) -> tuple[Mesh, Mesh]:
    """Return tyres and hubs of wheels with their axes along y, at (x, y)."""
    tyre = lathe(
        [(0, -wide / 2), (r * 0.9, -wide / 2), (r, -wide * 0.3), (r, wide * 0.3), (r * 0.9, wide / 2), (0, wide / 2)],
        28,
    )
    hub = lathe([(r * 0.5, -wide * 0.56), (r * 0.5, wide * 0.56), (0, wide * 0.56)], 20)
    hub = merged([hub, hub.moved(turn(np.pi, 0))])
    poses = [shift((a, b, r)) @ turn(np.pi / 2, 0) for a, b in places]
    return merged(tyre.moved(T) for T in poses), merged(hub.moved(T) for T in poses)


def _extruded(side: Float64Array, wide: float, taper: float = 0.92) -> Mesh:
    """Return a side view (x, z), counter-clockwise, extruded along y, with slightly narrower ends."""
    middle = side.mean(0)
    rings = []
    for y, scale in ((wide / 2, taper), (wide * 0.4, 1.0), (-wide * 0.4, 1.0), (-wide / 2, taper)):
        points = middle + (side - middle) * scale
        rings.append(np.column_stack([points[:, 0], np.full(len(side), y), points[:, 1]]))
    return loft(rings)


def car(rng: np.random.Generator) -> Model:
    """Return a toy car; its front is at +x."""
    s = rng.uniform(0.13, 0.24)
    r, w = 0.13 * s, 0.46 * s
    body = [(-0.5, 0.1), (0.5, 0.1), (0.51, 0.24), (0.46, 0.31), (0.2, 0.34), (-0.46, 0.34), (-0.51, 0.28)]
    cabin = [(-0.4, 0.33), (0.24, 0.33), (0.1, 0.52), (-0.02, 0.55), (-0.26, 0.55), (-0.34, 0.5)]
    glass = _extruded(np.array([(-0.34, 0.36), (0.17, 0.36), (0.07, 0.5), (-0.28, 0.5)]) * s, w * 0.93, 1.0)
    front = box((0.01 * s, w * 0.7, 0.12 * s), (0, 0, 0)).moved(shift((0.175 * s, 0, 0.37 * s)) @ turn(-0.64, 1))
    tyres, hubs = _wheels(((0.3 * s, w / 2), (0.3 * s, -w / 2), (-0.3 * s, w / 2), (-0.3 * s, -w / 2)), r, 0.09 * s)
    lights = [
        superellipsoid((0.02 * s, 0.05 * s, 0.035 * s), 2.0, 16).moved(shift((0.5 * s, k * w * 0.32, 0.24 * s)))
        for k in (-1, 1)
    ]
    paint_look = _plain(rng)
    return standing(
        "toy car",
        (merged([_extruded(np.array(body) * s, w), _extruded(np.array(cabin) * s, w * 0.88)]), paint_look),
        (merged([glass, front]), Material((0.2, 0.28, 0.35), shine=0.8)),
        (tyres, Material(BLACK, shine=0.1)),
        (merged([hubs, *lights]), Material(WHITE, shine=0.5)),
    )


def truck(rng: np.random.Generator) -> Model:
    """Return a toy truck with an open bed; its front is at +x."""
    s = rng.uniform(0.16, 0.26)
    w, r = 0.4 * s, 0.1 * s
    cabin = rounded_box((0.26 * s, w, 0.34 * s), 0.03 * s, 0.02 * s, (0.34 * s, 0, 0.12 * s))
    window = rounded_box((0.27 * s, w * 0.8, 0.13 * s), 0.02 * s, 0.01 * s, (0.342 * s, 0, 0.28 * s))
    frame = box((0.94 * s, w * 0.7, 0.06 * s), (0, 0, 0.1 * s))
    bed = [box((0.64 * s, w, 0.02 * s), (-0.15 * s, 0, 0.16 * s))]
    bed += [box((0.64 * s, 0.02 * s, 0.2 * s), (-0.15 * s, k * (w - 0.02 * s) / 2, 0.16 * s)) for k in (-1, 1)]
    bed += [box((0.02 * s, w, 0.2 * s), (-0.15 * s + k * 0.31 * s, 0, 0.16 * s)) for k in (-1, 1)]
    tyres, hubs = _wheels(tuple((a * s, b * w / 2) for a in (0.32, -0.14, -0.36) for b in (-1, 1)), r, 0.1 * s)
    return standing(
        "toy truck",
        (cabin, _plain(rng)),
        (merged(bed), _plain(rng)),
        (window, Material((0.2, 0.28, 0.35), shine=0.8)),
        (merged([frame, tyres]), Material(BLACK, shine=0.1)),
        (hubs, Material(WHITE, shine=0.4)),
    )


def block(rng: np.random.Generator) -> Model:
    """Return a toy block: a cube, a bar, a cylinder or an arch."""
    a = rng.uniform(0.035, 0.055)
    shapes = (
        box((a, a, a)),
        box((2 * a, a, a)),
        lathe([(0, 0), (a / 2, 0), (a / 2, 1.4 * a), (0, 1.4 * a)], 36),
        merged([box((0.5 * a, a, a), (s * 0.75 * a, 0, 0)) for s in (-1, 1)] + [box((2 * a, a, 0.5 * a), (0, 0, a))]),
        prism(np.array([(np.cos(t), np.sin(t)) for t in np.pi / 6 + np.arange(3) * 2 * np.pi / 3]) * a * 0.8, a),
    )
    return standing("toy block", (choice(rng, shapes), _plain(rng)))


def block_tower(rng: np.random.Generator) -> Model:
    """Return a building of four to seven blocks in different colors; it counts as one object."""
    a = rng.uniform(0.035, 0.05)
    parts: list[tuple[Mesh, Material]] = [(box((a, a, a), (s * a * 0.75, 0, 0)), _plain(rng)) for s in (-1, 1)]
    parts.append((box((2.5 * a, a, 0.6 * a), (0, 0, a)), _plain(rng)))
    level = 1.6 * a
    for _ in range(int(rng.integers(1, 4))):
        high = a * rng.uniform(0.6, 1.1)
        turned = box((a, a, high)).moved(shift((rng.uniform(-0.3, 0.3) * a, 0, level)) @ turn(rng.uniform(-0.3, 0.3)))
        parts.append((turned, _plain(rng)))
        level += high
    roof = lathe([(0, level), (a * 0.5, level), (0, level + a)], 36)
    return standing("toy blocks", *parts, *([(roof, _plain(rng))] if rng.random() < 0.5 else []))


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
            (lathe(np.concatenate([[(0.01, profile[0, 1])], profile, [(0.01, profile[-1, 1])]]), 40), _plain(rng))
        )
    ball = superellipsoid((0.018, 0.018, 0.018), 2.0, 24).moved(shift((0, 0, 0.024 + h * count)))
    return standing("ring tower", *parts, (ball, _plain(rng)))


def sand_bucket(rng: np.random.Generator) -> Model:
    """Return a toy bucket with a handle."""
    r, h = rng.uniform(0.06, 0.08), rng.uniform(0.11, 0.14)
    body = lathe(hollow([(r * 0.72, 0), (r * 0.97, h * 0.9), (r * 1.04, h * 0.94), (r * 1.04, h)], 0.004, 0.004), 48)
    angle = np.linspace(0, np.pi, 24)
    tilt = rng.uniform(0.9, 1.3)
    bow = np.column_stack([r * 1.05 * np.cos(angle), np.zeros(24), r * 1.02 * np.sin(angle)])
    handle = pipe(bow, 0.004).moved(shift((0, 0, h * 0.95)) @ turn(tilt, 0))
    return standing("toy bucket", (body, _plain(rng)), (handle, _plain(rng)))


def plain_ball(rng: np.random.Generator) -> Model:
    """Return a ball in one color."""
    r = rng.uniform(0.03, 0.08)
    return standing("ball", (superellipsoid((r, r, r), 2.0, 44), Material(paint(rng), shine=0.3)))


def plain_cup(rng: np.random.Generator) -> Model:
    """Return a stacking cup that stands upside down or upright."""
    r, h = rng.uniform(0.03, 0.045), rng.uniform(0.05, 0.08)
    body = lathe(hollow([(r * 0.8, 0), (r, h)], 0.003, 0.004), 44)
    if rng.random() < 0.4:
        body = body.moved(turn(np.pi, 0))
    return standing("toy cup", (body, _plain(rng)))


TOYS: Mapping[str, Maker] = MappingProxyType(
    {
        "bear": bear,
        "duck": duck,
        "elephant": elephant,
        "car": car,
        "truck": truck,
        "block": block,
        "block_tower": block_tower,
        "ring_tower": ring_tower,
        "sand_bucket": sand_bucket,
        "plain_ball": plain_ball,
        "plain_cup": plain_cup,
    }
)
