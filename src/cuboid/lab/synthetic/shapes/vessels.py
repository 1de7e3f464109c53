"""Vessels and packages of a kitchen or bathroom: cans with spouts, pans, baskets, bottles with pumps, appliances."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic.material import Material, Texture, paint, two_paints
from cuboid.lab.synthetic.mesh import Mesh, box, grid, lathe, merged, shift, turn
from cuboid.lab.synthetic.shapes.model import Maker, Model, choice, standing
from cuboid.lab.synthetic.solids import (
    displaced,
    hollow,
    loft,
    pipe,
    ribbon,
    rounded_box,
    rounded_rectangle,
    superellipse,
    swept,
)

STEEL, BLACK, WHITE = (0.76, 0.77, 0.79), (0.09, 0.09, 0.10), (0.93, 0.93, 0.91)


def metal() -> Material:
    """Return polished steel."""
    return Material(STEEL, shine=0.9)


def dark() -> Material:
    """Return black plastic."""
    return Material(BLACK, shine=0.35)


def arc(center: tuple[float, float], radii: tuple[float, float], start: float, end: float, count: int) -> Float64Array:
    """Return points (count, 3) on an arc of an ellipse in the x-z plane, around (x, z); angles from +x to +z."""
    angle = np.linspace(start, end, count)
    return np.column_stack(
        [center[0] + radii[0] * np.cos(angle), np.zeros(count), center[1] + radii[1] * np.sin(angle)]
    )


def watering_can(rng: np.random.Generator) -> Model:
    """Return a watering can with a long spout, a rose at its end, and a handle."""
    r, h = rng.uniform(0.065, 0.085), rng.uniform(0.13, 0.17)
    body = lathe(hollow([(r, 0), (r, h * 0.8), (r * 0.7, h), (r * 0.62, h * 1.02)], 0.003, 0.004))
    t = np.linspace(0, 1, 14)
    reach, tip = r + rng.uniform(0.12, 0.16), h * rng.uniform(1.1, 1.25)
    path = np.column_stack([r * 0.75 + (reach - r * 0.75) * t, 0 * t, 0.03 + (tip - 0.03) * t**1.25])
    spout = pipe(path, 0.017 - 0.008 * t)
    rose = lathe([(0, 0), (0.009, 0), (0.024, 0.022), (0.022, 0.026), (0, 0.028)], 24)
    rose = rose.moved(shift(path[-1] - (0.002, 0, 0)) @ turn(0.85, 1))
    handle = pipe(arc((-r * 0.55, h * 0.72), (r * 1.15, h * 0.55), 0.9, 1.45 * np.pi, 24), 0.006)
    color = paint(rng)
    look = Material(color, shine=0.4)
    return standing("watering can", (body, look), (merged([spout, handle]), look), (rose, metal()))


def jug(rng: np.random.Generator) -> Model:
    """Return a jug with a lip and a handle."""
    r, h = rng.uniform(0.05, 0.062), rng.uniform(0.17, 0.23)
    rise = np.linspace(0, 1, 20)
    radius = r * (0.78 + 0.25 * np.sin(np.pi * rise * 0.95) - 0.12 * rise + 0.12 * rise**6)
    body = lathe(hollow(np.column_stack([radius, h * rise]), 0.004, 0.006), 56)
    vertices = body.vertices.copy()
    high = np.clip(vertices[:, 2] / h - 0.8, 0, None) / 0.2
    front = np.clip(np.cos(np.arctan2(vertices[:, 1], vertices[:, 0])), 0, None) ** 12
    vertices[:, 0] += 0.022 * high * front
    vertices[:, 2] += 0.012 * high * front
    handle = pipe(arc((-r * 0.72, h * 0.55), (0.055, h * 0.3), 0.55 * np.pi, 1.5 * np.pi, 22), 0.0065)
    color, second = two_paints(rng)
    glaze = Material(color, second, choice(rng, (Texture.PLAIN, Texture.PLAIN, Texture.SPECKLE)), 0.02, 0.6)
    return standing("jug", (Mesh(vertices, body.faces), glaze), (handle, glaze))


def coffee_pot(rng: np.random.Generator) -> Model:
    """Return a tall pot with a curved spout, a handle and a lid with a knob."""
    r, h = rng.uniform(0.045, 0.055), rng.uniform(0.17, 0.21)
    body = lathe([(0, 0), (r * 0.9, 0), (r, 0.03), (r * 0.95, h * 0.45), (r * 0.68, h * 0.85), (r * 0.68, h * 0.87)])
    lid = lathe([(r * 0.72, h * 0.86), (r * 0.7, h * 0.88), (r * 0.4, h * 0.95), (0.006, h * 0.965)], 40)
    knob = lathe([(0.006, h * 0.96), (0.011, h * 1.0), (0.009, h * 1.04), (0, h * 1.05)], 20)
    t = np.linspace(0, 1, 18)
    spout_x = r * 0.8 + 0.075 * t
    spout_z = h * (0.3 + 0.52 * (3 * t**2 - 2 * t**3))
    spout = pipe(np.column_stack([spout_x, 0 * t, spout_z]), 0.016 - 0.009 * t)
    handle = pipe(arc((-r * 0.7, h * 0.52), (0.055, h * 0.27), 0.55 * np.pi, 1.45 * np.pi, 22), 0.006)
    look = Material(choice(rng, (WHITE, paint(rng), STEEL)), shine=0.7)
    return standing("coffee pot", (body, look), (merged([lid, knob]), look), (merged([spout, handle]), look))


def kettle(rng: np.random.Generator) -> Model:
    """Return an electric kettle on its base, with a beak and a large handle."""
    r, h = rng.uniform(0.07, 0.08), rng.uniform(0.18, 0.21)
    base = lathe([(0, 0), (r * 1.1, 0), (r * 1.1, 0.014), (r, 0.02), (0, 0.02)])
    rise = np.linspace(0, 1, 14)
    wall = np.column_stack([r * (1 - 0.28 * rise**1.3), 0.02 + (h - 0.02) * rise])
    body = lathe(np.concatenate([[(0, 0.02)], wall, [(r * 0.6, h + 0.012), (0, h + 0.018)]]), 56)
    vertices = body.vertices.copy()
    high = np.clip(vertices[:, 2] / h - 0.72, 0, 0.28) / 0.28
    front = np.clip(np.cos(np.arctan2(vertices[:, 1], vertices[:, 0])), 0, None) ** 10
    vertices[:, 0] += 0.035 * high * front * (vertices[:, 2] < h + 0.005)
    knob = lathe([(0.012, h + 0.012), (0.014, h + 0.026), (0, h + 0.03)], 20)
    t = np.linspace(0, 1, 18)
    path = np.column_stack([-r * 0.62 - 0.062 * np.sin(np.pi * t) ** 0.6, 0 * t, h - 0.012 - (h - 0.055) * t])
    path[0, 0] = -r * 0.5
    handle = pipe(path, 0.011, 1.25)
    look = choice(rng, (metal(), Material(WHITE, shine=0.5), Material(paint(rng), shine=0.5)))
    return standing("kettle", (Mesh(vertices, body.faces), look), (merged([base, knob, handle]), dark()))


def saucepan(rng: np.random.Generator) -> Model:
    """Return a saucepan with a straight handle."""
    r, h = rng.uniform(0.075, 0.1), rng.uniform(0.08, 0.12)
    pot = lathe(hollow([(r - 0.006, 0), (r, 0.007), (r, h - 0.004), (r + 0.004, h)], 0.0035, 0.005), 56)
    t = np.linspace(0, 1, 10)
    line = np.column_stack([r + 0.17 * t - 0.002, 0 * t, h * 0.82 + 0.02 * t])
    handle = pipe(line, 0.0075 + 0.004 * np.sin(np.pi * t), 0.7)
    look = choice(rng, (metal(), Material(paint(rng), shine=0.6)))
    return standing("saucepan", (pot, look), (handle, dark()))


def frying_pan(rng: np.random.Generator) -> Model:
    """Return a shallow pan with a long handle."""
    r, h = rng.uniform(0.1, 0.13), rng.uniform(0.035, 0.05)
    pan = lathe(hollow([(r * 0.8, 0), (r * 0.86, 0.006), (r, h)], 0.004, 0.005), 60)
    t = np.linspace(0, 1, 10)
    line = np.column_stack([r * 0.97 + 0.18 * t, 0 * t, h * 0.8 + 0.035 * t**0.8])
    return standing("frying pan", (pan, dark()), (pipe(line, 0.009 + 0.004 * np.sin(np.pi * t), 0.6), dark()))


def basket(rng: np.random.Generator) -> Model:
    """Return a woven basket, oval or rectangular, some with a handle over it."""
    x, y, h = rng.uniform(0.2, 0.3), rng.uniform(0.15, 0.2), rng.uniform(0.09, 0.15)
    outline = superellipse(2, 2 * y / x, rng.uniform(2.0, 5.0), 60)
    levels = np.linspace(0, 1, 49)
    ropes = 0.0035 * np.abs(np.sin(np.pi * levels * 8))
    outer = np.column_stack([x / 2 * (0.86 + 0.14 * levels) + ropes, h * levels])
    body = swept(outline, hollow(outer, 0.009, 0.01))
    straw = Material((0.72, 0.55, 0.33), (0.55, 0.38, 0.20), Texture.CHECKER, 0.012)
    parts = [(body, straw), (pipe(_loop(outline * x / 2 * 0.985, h), 0.007), straw)]
    if rng.random() < 0.5:
        bow = arc((0, h - 0.01), (x / 2 * 0.97, h * 0.9), 0, np.pi, 30)
        parts.append((pipe(bow, 0.007), Material((0.60, 0.43, 0.25))))
    return standing("basket", *parts)


def _loop(outline: Float64Array, height: float) -> Float64Array:
    ring = np.concatenate([outline, outline[:2]])
    return np.column_stack([ring, np.full(len(ring), height)])


def spray_bottle(rng: np.random.Generator) -> Model:
    """Return a bottle of cleaner with a trigger and a nozzle."""
    x, y, h = rng.uniform(0.075, 0.095), rng.uniform(0.045, 0.055), rng.uniform(0.17, 0.2)
    outline = superellipse(2, 2 * y / x, 2.6, 48)
    half = x / 2
    body = swept(
        outline,
        [(half * 0.9, 0), (half, 0.008), (half, h * 0.55), (half * 0.8, h * 0.8), (0.016, h), (0.014, h + 0.012)],
    )
    label = swept(outline, [(half + 0.0006, h * 0.12), (half + 0.0006, h * 0.5)])
    collar = lathe([(0.019, h + 0.004), (0.019, h + 0.022), (0, h + 0.024)], 28)
    side = [(-0.03, 0.0), (0.03, 0.004), (0.062, 0.012), (0.062, 0.026), (-0.02, 0.04), (-0.036, 0.026)]
    rings = [[(a, w, h + 0.02 + b) for a, b in side] for w in (0.011, -0.011)]
    t = np.linspace(0, 1, 8)
    trigger = pipe(np.column_stack([0.04 - 0.012 * np.sin(np.pi * t), 0 * t, h + 0.03 - 0.058 * t]), 0.005)
    nozzle = lathe([(0, 0), (0.009, 0), (0.008, 0.013), (0, 0.013)], 18)
    nozzle = nozzle.moved(shift((0.06, 0, h + 0.039)) @ turn(np.pi / 2, 1))
    color, second = two_paints(rng)
    bottle_look = Material(choice(rng, (WHITE, color)), shine=0.5)
    printed = Material(second, color, Texture.BANDS, 0.03, 0.2)
    head = Material(second, shine=0.4)
    return standing(
        "spray bottle",
        (body, bottle_look),
        (label, printed),
        (merged([loft(rings), trigger, collar]), head),
        (nozzle, Material(color, shine=0.4)),
    )


def shampoo(rng: np.random.Generator) -> Model:
    """Return a flat bottle of shampoo or soap, with a cap or a pump."""
    x, y, h = rng.uniform(0.06, 0.085), rng.uniform(0.035, 0.045), rng.uniform(0.14, 0.2)
    outline, half = superellipse(2, 2 * y / x, choice(rng, (2.0, 3.0, 4.5)), 48), x / 2
    rise = np.linspace(0, 1, 8)
    shoulder = np.column_stack([half + (0.013 - half) * rise**2.5, h * 0.86 + h * 0.14 * np.sqrt(rise)])
    body = swept(outline, np.concatenate([[(half * 0.92, 0), (half, 0.006)], shoulder]))
    label = swept(outline, [(half + 0.0006, h * 0.2), (half + 0.0006, h * 0.65)])
    color, second = two_paints(rng)
    if rng.random() < 0.5:
        stem = lathe([(0.014, h - 0.002), (0.014, h + 0.014), (0.005, h + 0.016), (0.005, h + 0.04)], 20)
        spout = pipe([(-0.012, 0, h + 0.045), (0.01, 0, h + 0.046), (0.034, 0, h + 0.043), (0.04, 0, h + 0.036)], 0.006)
        top = merged([stem, spout])
    else:
        top = lathe([(0.018, h - 0.003), (0.018, h + 0.022), (0.016, h + 0.025), (0, h + 0.025)], 32)
    return standing(
        "shampoo bottle",
        (body, Material(choice(rng, (WHITE, color)), shine=0.5)),
        (label, Material(color, second, Texture.BANDS, 0.028, 0.3)),
        (top, Material(second, shine=0.4)),
    )


def tissue_box(rng: np.random.Generator) -> Model:
    """Return a box of tissues; one looks out of it."""
    x, y, z = rng.uniform(0.2, 0.24), rng.uniform(0.11, 0.125), rng.uniform(0.055, 0.1)
    color, second = two_paints(rng)
    slot = swept(superellipse(2, 1.0, 2.4, 36), [(0.0, z), (x * 0.26, z), (x * 0.26, z + 0.0008), (0.0, z + 0.0008)])
    u, v = np.linspace(-1, 1, 26), np.linspace(-1, 1, 20)
    a, b = np.meshgrid(v, u, indexing="ij")
    fold = np.abs(a)
    height = z + 0.055 * (1 - fold) * (0.75 + 0.25 * np.cos(2.4 * b + rng.uniform(-1, 1))) + 0.002
    points = np.stack(
        [0.05 * b * (0.7 + 0.3 * (1 - fold)), 0.03 * a * (0.5 + 0.5 * fold) + 0.006 * np.sin(4 * b), height], -1
    )
    tissue = displaced(grid(points), rng, 0.0025, 0.04)
    pattern = choice(rng, (Texture.MARBLE, Texture.PLAIN, Texture.STRIPES))
    return standing(
        "tissue box",
        (box((x, y, z)), Material(color, second, pattern, 0.04)),
        (slot, Material((0.25, 0.24, 0.23))),
        (tissue, Material((0.97, 0.97, 0.96))),
    )


def toaster(rng: np.random.Generator) -> Model:
    """Return a toaster with two slots and a lever."""
    x, y, z = rng.uniform(0.26, 0.3), rng.uniform(0.15, 0.18), rng.uniform(0.17, 0.2)
    body = rounded_box((x, y, z), 0.03, 0.025, (0, 0, 0.01))
    slots = [box((x * 0.62, 0.028, 0.001), (0, s * 0.032, z + 0.01)) for s in (-1, 1)]
    lever = rounded_box((0.022, 0.04, 0.014), 0.004, 0.003, (x / 2 + 0.01, 0, z * 0.65))
    knob = lathe([(0, 0), (0.014, 0), (0.013, 0.012), (0, 0.012)], 24).moved(
        shift((x / 2, 0, z * 0.3)) @ turn(np.pi / 2, 1)
    )
    feet = box((x * 0.85, y * 0.8, 0.01))
    look = choice(rng, (metal(), Material(WHITE, shine=0.5), Material(paint(rng), shine=0.6)))
    return standing("toaster", (body, look), (merged([*slots, lever, knob, feet]), dark()))


def drinking_glass(rng: np.random.Generator) -> Model:
    """Return a drinking glass; it is not transparent, as frosted glass."""
    r, h = rng.uniform(0.03, 0.038), rng.uniform(0.09, 0.14)
    body = lathe(hollow([(r * 0.82, 0), (r, h)], 0.0025, 0.008))
    tint = choice(rng, ((0.75, 0.82, 0.84), (0.60, 0.72, 0.66), (0.80, 0.80, 0.80)))
    return standing("glass", (body, Material(tint, shine=0.9)))


def thermos(rng: np.random.Generator) -> Model:
    """Return an insulated bottle with a screw cap."""
    r, h = rng.uniform(0.033, 0.04), rng.uniform(0.22, 0.28)
    body = lathe([(0, 0), (r - 0.003, 0), (r, 0.004), (r, h * 0.76), (r * 0.72, h * 0.85), (r * 0.72, h * 0.87)])
    lid = lathe([(r * 0.78, h * 0.86), (r * 0.78, h * 0.985), (r * 0.7, h), (0, h)], 40)
    return standing("thermos", (body, choice(rng, (metal(), Material(paint(rng), shine=0.4)))), (lid, dark()))


def pepper_mill(rng: np.random.Generator) -> Model:
    """Return a turned pepper mill."""
    h = rng.uniform(0.14, 0.22)
    rise = np.linspace(0, 1, 30)
    radius = 0.026 - 0.009 * np.sin(np.pi * np.clip(rise / 0.72, 0, 1)) ** 2
    radius[rise > 0.74] = 0.023 * np.sqrt(np.clip(1 - ((rise[rise > 0.74] - 0.84) / 0.17) ** 2, 0.02, 1))
    body = lathe(np.concatenate([[(0, 0)], np.column_stack([radius, h * rise]), [(0, h)]]), 36)
    look = choice(rng, (Material((0.45, 0.28, 0.16), (0.36, 0.21, 0.12), Texture.WOOD, 0.03, 0.3), dark()))
    return standing("pepper mill", (body, look), (lathe([(0.006, h), (0.007, h + 0.01), (0, h + 0.012)], 16), metal()))


def cutting_board(rng: np.random.Generator) -> Model:
    """Return a cutting board that lies, with a handle."""
    x, y = rng.uniform(0.24, 0.32), rng.uniform(0.15, 0.2)
    board = rounded_box((x, y, 0.018), 0.02, 0.003)
    handle = ribbon([x / 2 - 0.01, x / 2 + 0.03, x / 2 + 0.1], [0.05, 0.034, 0.04], [0.009] * 3, [0.018] * 3)
    look = Material((0.76, 0.58, 0.37), (0.64, 0.45, 0.26), Texture.WOOD, 0.04, 0.1)
    return standing("cutting board", (board, look), (handle, look))


def waste_basket(rng: np.random.Generator) -> Model:
    """Return a small waste basket."""
    top, h = rng.uniform(0.11, 0.13), rng.uniform(0.24, 0.3)
    outline = rounded_rectangle(2, 2 * rng.uniform(0.75, 1.0), 0.5)
    body = swept(outline, hollow([(top * 0.75, 0), (top, h - 0.01), (top + 0.006, h)], 0.004, 0.005))
    return standing("waste basket", (body, Material(choice(rng, (WHITE, BLACK, paint(rng))), shine=0.2)))


VESSELS: Mapping[str, Maker] = MappingProxyType(
    {
        "watering_can": watering_can,
        "jug": jug,
        "coffee_pot": coffee_pot,
        "kettle": kettle,
        "saucepan": saucepan,
        "frying_pan": frying_pan,
        "basket": basket,
        "spray_bottle": spray_bottle,
        "shampoo": shampoo,
        "tissue_box": tissue_box,
        "toaster": toaster,
        "glass": drinking_glass,
        "thermos": thermos,
        "pepper_mill": pepper_mill,
        "cutting_board": cutting_board,
        "waste_basket": waste_basket,
    }
)
