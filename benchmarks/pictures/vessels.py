"""Mugs, bowls, pots and boxes that others can lie in."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from meshes import GLASS, SHINY, Color, Floats, Rng, Vector, box, ellipsoid, hull, lathe, rotation, tube
from prints import printed, random_color, surface_print
from thing import BLACK, STEEL, Thing, random_finish, solid


def _wall(r0: float, r1: float, h: float, t: float, bulge: float) -> list[tuple[float, float]]:
    """Return the profile of an open vessel: outside up, rim, inside down."""
    steps = np.linspace(0, 1, 6)
    side = [(r0 + (r1 - r0) * s + bulge * np.sin(np.pi * s / 2) * (1 - s), h * s) for s in steps]
    return [(0.0, 0.0), *side, *[(max(r - t, 0.001), z + (t if z < t else 0)) for r, z in side[::-1]], (0.0, t)]


def ring(r0: float, r1: float, h: float, t: float) -> tuple[Floats, ...]:
    """Return convex bodies of an open vessel: a bottom and ten staves."""
    angle = np.linspace(0, 2 * np.pi, 11)
    circle = np.stack([np.cos(angle), np.sin(angle)], 1)
    bodies = [np.concatenate([np.c_[circle * r0, np.full(11, z)] for z in (0, t)])]
    for a, b in pairwise(circle):
        corners = [(*(e * (r - k * t)), z) for e in (a, b) for r, z in ((r0, 0), (r1, h)) for k in (0, 1)]
        bodies.append(np.array(corners))
    return tuple(bodies)


def vessel(rng: Rng, color: Color, r0: float, r1: float, h: float, handle: bool, plain: float = 0.6) -> Thing:
    """Return an open vessel with radii of bottom and rim and a height; its inside often has another color."""
    t, bulge = rng.uniform(0.003, 0.005), rng.uniform(0, 0.3) * (r1 - r0 + 0.01)
    texture = None if rng.random() < plain else printed(rng, color, 128, 384)
    tint = color if texture is None else (1.0, 1.0, 1.0)
    finish = GLASS if plain < 1 and rng.random() < 0.08 else random_finish(rng, color)
    parts = [lathe(_wall(r0, r1, h, t, bulge), texture, tint, finish)]
    if finish != GLASS and rng.random() < 0.4:
        parts.append(
            lathe([(r1 - t * 1.2, h), (r0 - t * 1.2 + bulge * 0.2, t * 2), (0, t * 1.6)], color=random_color(rng))
        )
    if handle:
        bow = [(r1 + 0.6 * h * 0.6 * np.sin(a), 0, h * (0.5 - 0.32 * np.cos(a))) for a in np.linspace(0.1, 3.0, 9)]
        parts.append(tube(np.array(bow) - [0.004, 0, 0], rng.uniform(0.004, 0.007), tint if texture is None else color))
    return Thing(tuple(parts), ring(r0, r1, h, t), (r1 * 0.6, r1 * 0.6, t, h))


def mug(rng: Rng, color: Color) -> Thing:
    """Return a mug or a cup."""
    r = rng.uniform(0.03, 0.045)
    return vessel(rng, color, r * rng.uniform(0.65, 1), r, rng.uniform(0.07, 0.12), rng.random() < 0.75)


def bowl(rng: Rng, color: Color) -> Thing:
    """Return a bowl or a deep plate."""
    r = rng.uniform(0.06, 0.14)
    return vessel(rng, color, r * rng.uniform(0.4, 0.65), r, rng.uniform(0.04, 0.09), handle=False, plain=0.8)


def plate(rng: Rng, color: Color) -> Thing:
    """Return a flat plate."""
    r = rng.uniform(0.08, 0.14)
    return vessel(rng, color, r * 0.6, r, rng.uniform(0.012, 0.025), handle=False, plain=0.8)


def pot(rng: Rng, color: Color) -> Thing:
    """Return a pot with two handles, with or without a lid; or a pan."""
    r, h, steel = rng.uniform(0.07, 0.13), rng.uniform(0.05, 0.16), STEEL if rng.random() < 0.5 else color
    open_pot = vessel(rng, steel, r * 0.95, r, h, handle=False, plain=1.0)
    if h < 0.075:
        grip = tube([(r, 0, h * 0.7), (r + 0.08, 0, h * 0.9), (r + 0.17, 0, h)], 0.01, BLACK)
        return Thing((*open_pot.parts, grip), (*open_pot.colliders, hull([grip])), open_pot.inside)
    grips = [
        tube([(s * r, -0.03, h * 0.8), (s * (r + 0.03), 0, h * 0.8), (s * r, 0.03, h * 0.8)], 0.006, random_color(rng))
        for s in (1, -1)
    ]
    if rng.random() < 0.5:
        return Thing((*open_pot.parts, *grips), open_pot.colliders, open_pot.inside)
    lid = lathe([(r * 1.02, h), (r * 0.9, h + 0.01), (0, h + 0.025)], color=random_color(rng), finish=SHINY)
    knob = ellipsoid((0.015, 0.015, 0.012), color=BLACK).moved((0, 0, h + 0.022))
    return solid(*open_pot.parts, *grips, lid, knob)


def kettle(rng: Rng, color: Color) -> Thing:
    """Return a jug or kettle with a spout and a handle."""
    r, h = rng.uniform(0.05, 0.08), rng.uniform(0.14, 0.24)
    body = lathe(
        [(0, 0), (r, 0), (r, 0.02), (r * 0.95, h * 0.5), (r * 0.7, h), (r * 0.3, h + 0.015), (0, h + 0.03)],
        color=color,
        finish=random_finish(rng, color),
    )
    grip = tube(
        [(r * 0.7, 0, h * 0.95), (r + 0.05, 0, h * 0.9), (r + 0.06, 0, h * 0.4), (r, 0, h * 0.2)],
        0.011,
        random_color(rng),
    )
    spout = tube(
        [(-r * 0.8, 0, h * 0.6), (-r - 0.03, 0, h * 0.8), (-r - 0.04, 0, h * 0.95)], (0.02, 0.013, 0.01), color
    )
    return solid(body, grip, spout)


def open_box(rng: Rng, color: Color, size: Vector, wall_m: float = 0.006, flaps: bool = False) -> Thing:
    """Return a container with straight walls, such as a tray, a crate or a carton with flaps."""
    w, d, h = size
    texture = (
        printed(rng, color, 128, 192)
        if rng.random() < 0.3
        else surface_print(rng, color)
        if rng.random() < 0.3
        else None
    )
    tint = color if texture is None else (1.0, 1.0, 1.0)
    finish = random_finish(rng, color)
    walls = [box((w, d, wall_m), texture, tint, finish)]
    for s in (-1, 1):
        walls.append(box((w, wall_m, h), texture, tint, finish).moved((0, s * (d - wall_m) / 2, 0)))
        walls.append(box((wall_m, d - 2 * wall_m, h), texture, tint, finish).moved((s * (w - wall_m) / 2, 0, 0)))
        if flaps:
            fold = rotation("x", s * rng.uniform(20, 110))
            flap = box((w, 0.003, d * 0.45), color=tint).moved(rotation=fold)
            walls.append(flap.moved((0, s * d / 2, h)))
    parts = tuple(walls)
    return Thing(parts, tuple(hull([p]) for p in parts), (w / 2 - wall_m, d / 2 - wall_m, wall_m, h))


def tray(rng: Rng, color: Color) -> Thing:
    """Return a tray or a shallow box."""
    return open_box(rng, color, rng.uniform((0.2, 0.14, 0.02), (0.42, 0.3, 0.08)))


def crate(rng: Rng, color: Color) -> Thing:
    """Return a small box or basket that is open above."""
    return open_box(rng, color, rng.uniform((0.12, 0.1, 0.08), (0.34, 0.26, 0.2)), flaps=rng.random() < 0.3)
