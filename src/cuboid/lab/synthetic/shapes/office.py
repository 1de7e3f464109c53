"""Things of a desk: screens, keyboard, telephone, lamp, pens, headphones."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from cuboid.lab.synthetic.material import Material, Texture, paint, two_paints
from cuboid.lab.synthetic.mesh import Mesh, box, lathe, merged, prism, shift, turn
from cuboid.lab.synthetic.shapes.model import Maker, Model, choice, standing
from cuboid.lab.synthetic.shapes.vessels import BLACK, STEEL, WHITE, dark, metal
from cuboid.lab.synthetic.solids import flattened, hollow, pipe, rounded_box, superellipsoid

GREY = (0.42, 0.43, 0.45)


def _case(rng: np.random.Generator) -> Material:
    """Return the plastic or metal of a device."""
    return choice(
        rng,
        (
            dark(),
            Material((0.22, 0.23, 0.25), shine=0.3),
            Material(WHITE, shine=0.4),
            Material((0.68, 0.69, 0.71), shine=0.6),
        ),
    )


def _display(rng: np.random.Generator) -> Material:
    """Return a screen: off, or with a picture."""
    shown = (
        Material((0.04, 0.04, 0.05), shine=0.9),
        Material((0.85, 0.87, 0.90), (0.25, 0.33, 0.48), Texture.BANDS, 0.03, 0.5),
        Material((0.10, 0.16, 0.32), (0.35, 0.55, 0.75), Texture.MARBLE, 0.15, 0.6),
    )
    return choice(rng, shown)


def _keys(x: float, y: float, columns: int, rows: int, z: float) -> Mesh:
    """Return a field of keys x by y with its middle at the origin, tops at z + 4 mm."""
    a, b = x / columns, y / rows
    places = [((i + 0.5) * a - x / 2, (j + 0.5) * b - y / 2) for i in range(columns) for j in range(rows)]
    skipped = {(i, 0) for i in range(columns // 3, 2 * columns // 3)} if rows > 4 else set()
    keys = [
        box((a * 0.84, b * 0.84, 0.004), (*place, z))
        for k, place in enumerate(places)
        if (k // rows, k % rows) not in skipped
    ]
    if skipped:
        keys.append(box((a * (len(skipped) - 0.16), b * 0.84, 0.004), (0, places[0][1], z)))
    return merged(keys)


def monitor(rng: np.random.Generator) -> Model:
    """Return a computer monitor on its stand, which faces +x."""
    wide = rng.uniform(0.48, 0.6)
    high, low, tilt = wide * 0.58, rng.uniform(0.09, 0.14), rng.uniform(-0.02, 0.14)
    frame = box((0.022, wide, high), (0, 0, -high / 2))
    back = rounded_box((0.03, wide * 0.5, high * 0.5), 0.01, 0.008, (-0.022, 0, -high / 4))
    glass = box((0.001, wide - 0.024, high - 0.03), (0.0115, 0, -high / 2 + 0.018))
    place = shift((0.02, 0, low + high / 2)) @ turn(-tilt, 1)
    foot = rounded_box((0.2, wide * 0.42, 0.012), 0.03, 0.004)
    neck = box((0.02, 0.06, low + high * 0.3), (-0.045, 0, 0.006))
    case = _case(rng)
    return standing(
        "monitor",
        (merged([frame.moved(place), back.moved(place)]), case),
        (glass.moved(place), _display(rng)),
        (merged([foot, neck]), case),
    )


def laptop(rng: np.random.Generator) -> Model:
    """Return an open laptop, which faces +x."""
    deep, wide, lid = rng.uniform(0.21, 0.24), rng.uniform(0.3, 0.35), rng.uniform(0.15, 0.45)
    base = rounded_box((deep, wide, 0.015), 0.012, 0.003)
    screen = rounded_box((0.007, wide, deep), 0.003, 0.001)
    glass = box((0.0008, wide - 0.02, deep - 0.028), (0.0037, 0, 0.014))
    place = shift((-deep / 2 + 0.002, 0, 0.013)) @ turn(-lid, 1)
    keys = _keys(deep * 0.42, wide * 0.86, 5, 14, 0.0125).moved(shift((-deep * 0.15, 0, 0)))
    pad = box((deep * 0.28, wide * 0.3, 0.0006), (deep * 0.29, 0, 0.015))
    case = _case(rng)
    return standing(
        "laptop",
        (merged([base, screen.moved(place)]), case),
        (glass.moved(place), _display(rng)),
        (merged([keys, pad]), Material((0.16, 0.16, 0.17), shine=0.2)),
    )


def keyboard(rng: np.random.Generator) -> Model:
    """Return a computer keyboard along y, whose front is at +x."""
    long, deep = rng.uniform(0.36, 0.45), rng.uniform(0.125, 0.15)
    body = rounded_box((deep, long, 0.02), 0.01, 0.003)
    letters = _keys(long * 0.74, deep * 0.82, 15, 5, 0.018).moved(turn(np.pi / 2))
    digits = (
        _keys(long * 0.18, deep * 0.82, 4, 5, 0.018) if long > 0.4 else _keys(long * 0.12, deep * 0.82, 2, 4, 0.018)
    )
    parts = merged(
        [letters.moved(shift((0, -long * 0.1, 0))), digits.moved(shift((0, long * 0.385, 0)) @ turn(np.pi / 2))]
    )
    case = _case(rng)
    keys = choice(rng, (Material((0.14, 0.14, 0.15), shine=0.2), Material((0.88, 0.88, 0.86), shine=0.2)))
    return standing("keyboard", (body, case), (parts, keys))


def mouse(rng: np.random.Generator) -> Model:
    """Return a computer mouse."""
    x, y, z = rng.uniform(0.1, 0.12), rng.uniform(0.058, 0.066), rng.uniform(0.034, 0.042)
    body = flattened(superellipsoid((x / 2, y / 2, z), 2.5), 0.0)
    wheel = lathe([(0, -0.004), (0.012, -0.004), (0.012, 0.004), (0, 0.004)], 20).moved(
        shift((x * 0.22, 0, z * 0.86)) @ turn(np.pi / 2, 0)
    )
    return standing("mouse", (body, _case(rng)), (wheel, Material(GREY, shine=0.3)))


def telephone(rng: np.random.Generator) -> Model:
    """Return a desk telephone with its handset, keys and display."""
    wide, deep = rng.uniform(0.17, 0.2), rng.uniform(0.19, 0.22)
    body = prism([(-deep / 2, -wide / 2), (deep / 2, -wide / 2), (deep / 2, wide / 2), (-deep / 2, wide / 2)], 0.1)
    vertices = body.vertices.copy()
    top = vertices[:, 2] > 0.05
    vertices[top, 2] = 0.058 - 0.036 * vertices[top, 0] / deep * 2 * 0.5
    slope = np.arctan2(0.036, deep)
    on_top = shift((0, 0, 0.058)) @ turn(slope, 1)
    keys = _keys(0.085, 0.075, 4, 3, 0).moved(on_top @ shift((0.03, wide * 0.18, 0)))
    display = box((0.03, 0.075, 0.002), (-deep * 0.3, wide * 0.18, 0)).moved(on_top)
    t = np.linspace(-1, 1, 18)
    grip = pipe(np.column_stack([0.085 * t, 0 * t, 0.03 - 0.01 * t**2]), 0.013 + 0.005 * t**4, 0.8)
    ears = [
        lathe([(0, 0.002), (0.024, 0.002), (0.026, 0.016), (0.018, 0.026), (0, 0.028)], 26).moved(
            shift((s * 0.078, 0, 0))
        )
        for s in (-1, 1)
    ]
    handset = merged([grip, *ears]).moved(on_top @ shift((0, -wide * 0.3, 0)))
    look = choice(rng, (dark(), Material((0.85, 0.84, 0.80), shine=0.3), Material((0.3, 0.31, 0.33), shine=0.3)))
    return standing(
        "telephone",
        (Mesh(vertices, body.faces), look),
        (handset, look),
        (keys, Material((0.75, 0.75, 0.73), shine=0.2)),
        (display, Material((0.45, 0.55, 0.45), shine=0.6)),
    )


def headphones(rng: np.random.Generator) -> Model:
    """Return headphones that lie on their cups."""
    half, r = rng.uniform(0.07, 0.08), rng.uniform(0.034, 0.04)
    angle = np.linspace(0, np.pi, 30)
    path = np.column_stack([1.15 * (half + 0.012) * np.sin(angle), (half + 0.012) * np.cos(angle), np.full(30, r)])
    path = np.concatenate([[(-0.01, path[0, 1], r)], path, [(-0.01, path[-1, 1], r)]])
    band = pipe(path, 0.005, 2.4)
    cups, pads = [], []
    for side in (-1, 1):
        cup = lathe([(0, 0), (r * 0.85, 0), (r, 0.008), (r, 0.02), (0, 0.02)], 36)
        pad = lathe([(r * 0.5, 0.019), (r, 0.02), (r, 0.03), (r * 0.8, 0.036), (r * 0.5, 0.03)], 36)
        place = shift((-0.012, side * (half + 0.018), r)) @ turn(side * np.pi / 2, 0)
        cups.append(cup.moved(place))
        pads.append(pad.moved(place))
    return standing("headphones", (merged([band, *cups]), _case(rng)), (merged(pads), Material((0.12, 0.12, 0.13))))


def table_lamp(rng: np.random.Generator) -> Model:
    """Return a table lamp: with a jointed arm, or with a stem and a fabric shade."""
    color = paint(rng)
    if rng.random() < 0.5:
        base = lathe([(0, 0), (0.085, 0), (0.085, 0.018), (0.02, 0.03), (0, 0.03)], 44)
        first, second, third = np.array([0.0, 0, 0.025]), np.array([-0.1, 0, 0.23]), np.array([0.1, 0, 0.38])
        arms = [pipe(np.linspace(a, b, 5), 0.0065) for a, b in ((first, second), (second, third))]
        joint = lathe([(0, -0.012), (0.013, -0.012), (0.013, 0.012), (0, 0.012)], 20).moved(
            shift(second) @ turn(np.pi / 2, 0)
        )
        shade = lathe(hollow([(0.018, 0), (0.024, 0.03), (0.072, 0.12)], 0.002, 0.002), 40)
        shade = shade.moved(shift(third) @ shift((0, 0, 0.012)) @ turn(np.pi * 0.72, 1))
        look = Material(choice(rng, (color, WHITE, BLACK)), shine=0.4)
        return standing("table lamp", (base, look), (merged([*arms, joint]), metal()), (shade, look))
    h, r = rng.uniform(0.3, 0.4), rng.uniform(0.09, 0.12)
    rise = np.linspace(0, 1, 20)
    stem = 0.012 + 0.045 * np.sin(np.pi * np.clip(rise * 1.25, 0, 1)) ** 2 * (rise < 0.8)
    foot = lathe(
        np.concatenate([[(0, 0), (0.06, 0), (0.06, 0.01)], np.column_stack([stem, 0.014 + h * 0.6 * rise])]), 40
    )
    cover = lathe([(r, h * 0.55), (r * 0.65, h), (r * 0.64, h), (r * 0.985, h * 0.55)], 48)
    bulb = lathe([(0.012, h * 0.6), (0.028, h * 0.72), (0, h * 0.85)], 20)
    cloth = Material((0.92, 0.87, 0.76), (0.88, 0.82, 0.70), Texture.STRIPES, 0.006)
    return standing(
        "table lamp", (foot, Material(color, shine=0.6)), (cover, cloth), (bulb, Material(WHITE, shine=0.5))
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


def tape_roll(rng: np.random.Generator) -> Model:
    """Return a roll of tape that lies."""
    r, h = rng.uniform(0.04, 0.058), rng.uniform(0.03, 0.05)
    inner = r * rng.uniform(0.62, 0.8)
    roll = lathe([(inner, 0), (r, 0), (r, h), (inner, h)], 48)
    core = lathe([(inner, h), (inner - 0.003, h), (inner - 0.003, 0), (inner, 0), (inner, h)], 48)
    tape = choice(rng, ((0.72, 0.56, 0.34), (0.85, 0.83, 0.76), paint(rng)))
    return standing("tape roll", (roll, Material(tape, shine=0.4)), (core, Material((0.62, 0.50, 0.36))))


def remote(rng: np.random.Generator) -> Model:
    """Return a remote control."""
    x, y = rng.uniform(0.15, 0.2), rng.uniform(0.042, 0.052)
    body = rounded_box((x, y, 0.02), 0.012, 0.006)
    keys = _keys(x * 0.6, y * 0.72, 6, 3, 0.0185).moved(shift((-x * 0.08, 0, 0)))
    power = lathe([(0.006, 0.019), (0.006, 0.0225), (0, 0.0225)], 18).moved(shift((x * 0.36, y * 0.2, 0)))
    return standing(
        "remote control", (body, dark()), (keys, Material((0.55, 0.55, 0.57))), (power, Material((0.8, 0.12, 0.1)))
    )


def calculator(rng: np.random.Generator) -> Model:
    """Return a pocket calculator."""
    x, y = rng.uniform(0.12, 0.15), rng.uniform(0.07, 0.085)
    body = rounded_box((x, y, 0.014), 0.008, 0.003)
    keys = _keys(x * 0.6, y * 0.84, 4, 4, 0.0125).moved(shift((-x * 0.14, 0, 0)))
    display = box((x * 0.18, y * 0.8, 0.001), (x * 0.33, 0, 0.014))
    return standing(
        "calculator", (body, _case(rng)), (keys, Material(GREY)), (display, Material((0.5, 0.58, 0.48), shine=0.5))
    )


def smartphone(rng: np.random.Generator) -> Model:
    """Return a smartphone that lies."""
    x, y = rng.uniform(0.14, 0.16), rng.uniform(0.07, 0.077)
    return standing(
        "smartphone",
        (rounded_box((x, y, 0.009), 0.012, 0.002), Material(paint(rng), shine=0.4)),
        (box((x - 0.022, y - 0.008, 0.0005), (0, 0, 0.009)), Material((0.03, 0.03, 0.04), shine=0.9)),
    )


def speaker(rng: np.random.Generator) -> Model:
    """Return a loudspeaker box with two cones, which faces +x."""
    deep, wide, high = rng.uniform(0.12, 0.16), rng.uniform(0.11, 0.15), rng.uniform(0.19, 0.26)
    cones = [
        lathe(
            [(0.0, 0.004), (r * 0.3, 0.003), (r * 0.9, 0.0006), (r, 0.003), (r * 1.08, 0.002), (r * 1.1, 0)][::-1], 36
        ).moved(shift((deep / 2, 0, z)) @ turn(np.pi / 2, 1))
        for r, z in ((wide * 0.36, high * 0.36), (wide * 0.18, high * 0.8))
    ]
    case = choice(
        rng,
        (dark(), Material((0.45, 0.30, 0.19), (0.36, 0.23, 0.13), Texture.WOOD, 0.05, 0.2), Material(WHITE, shine=0.3)),
    )
    return standing(
        "loudspeaker",
        (rounded_box((deep, wide, high), 0.006, 0.003), case),
        (merged(cones), Material((0.25, 0.25, 0.27), shine=0.3)),
    )


def glasses_case(rng: np.random.Generator) -> Model:
    """Return a glasses case or a pencil case."""
    body = superellipsoid((rng.uniform(0.078, 0.085), rng.uniform(0.03, 0.036), rng.uniform(0.022, 0.03)), 2.6)
    color, second = two_paints(rng)
    level = -0.8 * float(body.vertices[:, 2].max())
    return standing(
        "glasses case",
        (flattened(body, level), Material(color, second, choice(rng, (Texture.PLAIN, Texture.SPECKLE)), 0.01, 0.2)),
    )


def stapler(rng: np.random.Generator) -> Model:
    """Return a stapler."""
    x = rng.uniform(0.12, 0.15)
    base = rounded_box((x, 0.036, 0.01), 0.01, 0.003)
    t = np.linspace(0, 1, 10)
    arm = pipe(
        np.column_stack([-x * 0.46 + x * 0.94 * t, 0 * t, 0.024 + 0.02 * t + 0.004 * np.sin(np.pi * t)]),
        0.015 - 0.003 * t,
        0.8,
    )
    hinge = box((0.03, 0.03, 0.03), (-x * 0.38, 0, 0.008))
    rail = box((x * 0.85, 0.014, 0.006), (0.0, 0, 0.014))
    return standing("stapler", (merged([base, hinge]), dark()), (rail, metal()), (arm, Material(paint(rng), shine=0.4)))


OFFICE: Mapping[str, Maker] = MappingProxyType(
    {
        "monitor": monitor,
        "laptop": laptop,
        "keyboard": keyboard,
        "mouse": mouse,
        "telephone": telephone,
        "headphones": headphones,
        "table_lamp": table_lamp,
        "pen_cup": pen_cup,
        "tape_roll": tape_roll,
        "remote": remote,
        "calculator": calculator,
        "smartphone": smartphone,
        "speaker": speaker,
        "glasses_case": glasses_case,
        "stapler": stapler,
    }
)
