"""Things of an office and a home: displays, keyboards, appliances, books, tools, toys."""

from __future__ import annotations

import numpy as np
from meshes import SCREEN, SHINY, WHOLE, Color, Rng, box, ellipsoid, lathe, rotation, tube
from prints import key_print, printed, random_color, screen_print
from thing import STEEL, Thing, compound, random_finish, solid


def book(rng: Rng, color: Color) -> Thing:
    """Return a lying book: cover around white pages."""
    w, d, h = rng.uniform(0.1, 0.2), rng.uniform(0.15, 0.28), rng.uniform(0.008, 0.045)
    cover = printed(rng, color)
    pages = box((w - 0.006, d - 0.006, h - 0.004), color=(0.9, 0.88, 0.8)).moved((0.004, 0, 0.002))
    front = [box((w, d, 0.003), cover, rectangles=WHOLE).moved((0, 0, z)) for z in (0, h - 0.003)]
    spine = np.ascontiguousarray(np.rot90(printed(rng, color, 64, 384)))
    back = box((0.003, d, h), spine, rectangles=WHOLE).moved((-w / 2, 0, 0))
    return solid(pages, *front, back, flat=True)


def stick(rng: Rng, color: Color) -> Thing:
    """Return a pen, a brush, a spoon or a screwdriver: a grip and a shaft or blade of another color."""
    length, r = rng.uniform(0.06, 0.12), rng.uniform(0.004, 0.015)
    grip = tube([(0, 0, r), (length, 0, r)], (r, r * rng.uniform(0.7, 1)), color)
    thin = max(r * rng.uniform(0.3, 0.9), 0.0025)
    shaft = tube(
        [(length, 0, r), (length * rng.uniform(1.3, 2), 0, r)], thin, STEEL if rng.random() < 0.5 else random_color(rng)
    )
    head = ellipsoid((0.028, 0.019, 0.005), color=shaft.color).moved((length * 2, 0, r - 0.004))
    return solid(*([grip, shaft, head] if rng.random() < 0.3 else [grip, shaft]))


def tape(rng: Rng, color: Color) -> Thing:
    """Return a roll of tape or paper, lying or standing as physics has it."""
    r, h = rng.uniform(0.03, 0.06), rng.uniform(0.015, 0.11)
    hole = r * rng.uniform(0.35, 0.8)
    outer = lathe([(hole, 0), (r, 0), (r, h), (hole, h)], color=color)
    return solid(outer, lathe([(hole, h), (hole, 0)], color=(0.75, 0.62, 0.45)), flat=True)


def phone(rng: Rng, color: Color) -> Thing:
    """Return a phone or a tablet, display up or down, or a remote control or calculator with keys."""
    if rng.random() < 0.5:
        w, d, h = rng.uniform(0.04, 0.09), rng.uniform(0.12, 0.2), rng.uniform(0.012, 0.022)
        keys = box((w * 0.8, d * 0.7, 0.001), key_print(rng, 8, 4, color), rectangles=WHOLE).moved((0, -0.02, h))
        return solid(box((w, d, h), color=color), keys)
    w = rng.uniform(0.065, 0.19)
    d, h = w * rng.uniform(1.3, 2.1), rng.uniform(0.007, 0.011)
    face = box((w * 0.94, d * 0.95, 0.0006), screen_print(rng), finish=SCREEN, rectangles=WHOLE).moved((0, 0, h))
    return solid(box((w, d, h), color=color), face)


def mouse(rng: Rng, color: Color) -> Thing:
    """Return a computer mouse or a similar smooth lump."""
    body = ellipsoid(
        (rng.uniform(0.028, 0.036), rng.uniform(0.045, 0.062), rng.uniform(0.015, 0.022)),
        color=color,
        finish=random_finish(rng, color),
    )
    wheel = ellipsoid((0.004, 0.01, 0.006), color=random_color(rng)).moved((0, 0.03, 0.024))
    return solid(body, wheel)


def keyboard(rng: Rng, color: Color) -> Thing:
    """Return a keyboard, flat or slightly inclined."""
    w, d, h = rng.uniform(0.26, 0.46), rng.uniform(0.11, 0.16), rng.uniform(0.008, 0.03)
    keys = box((w * 0.97, d * 0.9, 0.002), key_print(rng, 5, int(rng.integers(12, 21)), color), rectangles=WHOLE).moved(
        (0, 0, h)
    )
    tilt = rotation("x", rng.uniform(0, 5))
    return solid(box((w, d, h), color=color).moved(rotation=tilt), keys.moved(rotation=tilt))


def monitor(rng: Rng, color: Color) -> Thing:
    """Return a monitor that faces -y: a frame, a picture, a neck and a foot."""
    w = rng.uniform(0.4, 0.68)
    h, lift, rim = w * rng.uniform(0.5, 0.65), rng.uniform(0.08, 0.18), rng.uniform(0.004, 0.02)
    body = box((w, rng.uniform(0.02, 0.06), h), color=color, finish=random_finish(rng, color))
    face = box((w - 2 * rim, 0.002, h - 2.5 * rim), screen_print(rng), finish=SCREEN, rectangles=WHOLE).moved(
        (0, body.vertices[:, 1].min(), rim * 1.5)
    )
    tilt = rotation("x", rng.uniform(-12, 3))
    neck = box((0.05, 0.03, lift + h * 0.4), color=color).moved((0, 0.045, 0))
    foot = (
        box((rng.uniform(0.18, 0.28), 0.18, 0.012), color=color)
        if rng.random() < 0.7
        else lathe([(0, 0), (0.11, 0), (0.1, 0.012), (0, 0.014)], color=color)
    )
    return compound(body.moved((0, 0, lift), tilt), face.moved((0, 0, lift), tilt), neck, foot.moved((0, 0.03, 0)))


def laptop(rng: Rng, color: Color) -> Thing:
    """Return an open laptop that faces -y."""
    w = rng.uniform(0.28, 0.37)
    d, open_by = w * 0.68, rotation("x", -rng.uniform(5, 35))
    base = box((w, d, 0.017), color=color)
    keys = box((w * 0.88, d * 0.45, 0.001), key_print(rng, 6, 14, color), rectangles=WHOLE).moved((0, d * 0.15, 0.017))
    lid = box((w, 0.008, d), color=color).moved((0, d / 2, 0.012), open_by)
    face = box((w * 0.94, 0.002, d * 0.88), screen_print(rng), finish=SCREEN, rectangles=WHOLE).moved(
        (0, -0.0045, 0.01)
    )
    return compound(base, keys, lid, face.moved((0, d / 2, 0.016), open_by))


def lamp(rng: Rng, color: Color) -> Thing:
    """Return a desk lamp: foot, bent arm, shade."""
    h, reach = rng.uniform(0.25, 0.4), rng.uniform(0.05, 0.15)
    foot = lathe([(0, 0), (0.07, 0), (0.065, 0.02), (0, 0.025)], color=color)
    arm = tube([(0, 0, 0.02), (-0.05, 0, h * 0.5), (0, 0, h), (reach, 0, h)], 0.006, color)
    shade = lathe([(0.065, -0.07), (0.03, 0.0), (0.0, 0.005)], color=random_color(rng)).moved((reach, 0, h))
    inner = lathe([(0.0, 0.0), (0.03, -0.002), (0.064, -0.07)], color=(1, 1, 0.9)).moved((reach, 0, h))
    return compound(foot, arm, shade, inner)


def appliance(rng: Rng, color: Color) -> Thing:
    """Return a box with a front at -y, as a microwave, toaster, coffee machine, printer or computer."""
    w, d, h = rng.uniform((0.14, 0.16, 0.16), (0.5, 0.38, 0.42))
    parts = [box((w, d, h), color=color, finish=random_finish(rng, color))]
    pane_w, pane_h = w * rng.uniform(0.5, 0.75), h * rng.uniform(0.4, 0.8)
    parts.append(
        box((pane_w, 0.006, pane_h), color=random_color(rng), finish=SCREEN).moved(
            (-(w - pane_w) / 2 + 0.015, -d / 2, (h - pane_h) / 2)
        )
    )
    for k in range(int(rng.integers(0, 5))):
        knob = box((0.022, 0.014, 0.022), color=random_color(rng)).moved(
            (w / 2 - w * 0.1, -d / 2, h * (0.2 + 0.15 * k))
        )
        parts.append(knob)
    if rng.random() < 0.4:
        parts.append(
            tube(
                [(-w * 0.3, -d / 2, h * 0.9), (0, -d / 2 - 0.03, h * 0.9), (w * 0.3, -d / 2, h * 0.9)],
                0.007,
                STEEL,
                SHINY,
            )
        )
    return solid(*parts, flat=True)


def plant(rng: Rng, color: Color) -> Thing:
    """Return a potted plant."""
    r = rng.uniform(0.04, 0.09)
    pot_ = lathe(
        [(0, 0), (r * 0.7, 0), (r, r * 1.7), (r * 0.9, r * 1.7), (r * 0.85, r * 1.5), (0, r * 1.5)], color=color
    )
    parts, green = [pot_], rng.uniform((0.08, 0.25, 0.05), (0.35, 0.55, 0.2))
    for _ in range(int(rng.integers(8, 22))):
        a, lean, tall = rng.uniform(0, 6.28), rng.uniform(0.1, 1.6) * r, rng.uniform(1, 3.2) * r
        path = [
            (0, 0, r * 1.4),
            (lean * np.cos(a) * 0.5, lean * np.sin(a) * 0.5, r * 1.5 + tall * 0.7),
            (lean * np.cos(a), lean * np.sin(a), r * 1.5 + tall),
        ]
        tint = tuple(float(x) for x in np.clip(green * rng.uniform(0.7, 1.3), 0, 1))
        parts.append(tube(path, (0.003, rng.uniform(0.008, 0.02), 0.002), tint, sides=6))  # type: ignore[arg-type]
    return solid(*parts)


def shoe(rng: Rng, color: Color) -> Thing:
    """Return something like a shoe: a sole, a body, an opening."""
    length, w = rng.uniform(0.2, 0.3), rng.uniform(0.08, 0.11)
    sole = ellipsoid((w / 2, length / 2, 0.02), color=random_color(rng))
    body = ellipsoid((w * 0.46, length * 0.47, 0.04), color=color, dents=0.08, rng=rng).moved((0, 0, 0.012))
    heel = lathe([(w * 0.42, 0), (w * 0.36, 0.09), (w * 0.3, 0.09), (w * 0.3, 0.05), (0, 0.05)], color=color).moved(
        (0, -length * 0.22, 0.02)
    )
    return solid(
        sole,
        body,
        heel,
        ellipsoid((w * 0.15, length * 0.15, 0.01), color=random_color(rng)).moved((0, length * 0.1, 0.08)),
    )


def toy(rng: Rng, color: Color) -> Thing:
    """Return a figure of a few lumps in several colors, or a stack of small blocks."""
    parts, other = [], random_color(rng)
    s = rng.uniform(0.5, 1.3)
    parts.append(ellipsoid((0.035 * s, 0.03 * s, 0.045 * s), color=color))
    parts.append(
        ellipsoid((0.028 * s, 0.028 * s, 0.026 * s), color=color if rng.random() < 0.5 else other).moved(
            (0, 0, 0.08 * s)
        )
    )
    for x in (-1, 1):
        parts.append(tube([(x * 0.03 * s, 0, 0.065 * s), (x * 0.06 * s, 0.01, 0.04 * s)], 0.011 * s, other))
        parts.append(tube([(x * 0.018 * s, 0, 0.02 * s), (x * 0.025 * s, -0.04 * s, 0.014 * s)], 0.013 * s, color))
        parts.append(ellipsoid((0.009 * s, 0.005 * s, 0.009 * s), color=other).moved((x * 0.02 * s, 0, 0.12 * s)))
    return solid(*parts)
