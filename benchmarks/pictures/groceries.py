"""Packages, cans, jars, bottles, fruit, bags."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from meshes import GLASS, MATT, SHINY, Color, Part, Rng, Vector, box, ellipsoid, lathe, tube
from prints import printed, random_color, surface_print
from thing import STEEL, Thing, random_finish, solid


def carton(rng: Rng, color: Color, size: Vector | None = None) -> Thing:
    """Return a package with a print, or of cardboard with a strip of tape."""
    if size is None:
        size = rng.uniform((0.05, 0.03, 0.04), (0.2, 0.13, 0.24))
    if rng.random() < 0.25:
        cardboard = (0.68, 0.52, 0.36)
        image = (
            surface_print(rng, cardboard) if rng.random() < 0.3 else np.full((128, 192, 3), [174, 133, 92], np.uint8)
        )
        image[:, int(image.shape[1] * 0.3) : int(image.shape[1] * 0.4)] = rng.integers(150, 230)
        return solid(box(size, image), flat=True)
    return solid(box(size, printed(rng, color), finish=random_finish(rng, color)), flat=True)


def block(rng: Rng, color: Color) -> Thing:
    """Return a plain box."""
    return solid(box(rng.uniform(0.03, (0.16, 0.12, 0.14)), color=color, finish=random_finish(rng, color)), flat=True)


def can(rng: Rng, color: Color) -> Thing:
    """Return a can: a printed label between metal rims."""
    r, h = rng.uniform(0.03, 0.05), rng.uniform(0.05, 0.14)
    label = lathe([(r, 0.004), (r, h - 0.004)], printed(rng, color))
    metal = [(0, 0), (r * 0.97, 0), (r * 1.01, 0.003), (r * 1.01, 0.005), (r * 0.99, 0.006), (r * 0.99, h - 0.006)]
    metal += [(r * 1.01, h - 0.005), (r * 1.01, h - 0.001), (r * 0.96, h), (r * 0.94, h - 0.004), (0, h - 0.004)]
    return solid(label, lathe(metal, color=STEEL, finish=SHINY), flat=True)


def jar(rng: Rng, color: Color) -> Thing:
    """Return a jar: body, label and lid, each of its own color."""
    r, h = rng.uniform(0.025, 0.055), rng.uniform(0.07, 0.17)
    neck, lid = r * rng.uniform(0.7, 1.0), rng.uniform(0.012, 0.03)
    body = lathe(
        [(0, 0), (r * 0.95, 0), (r, 0.008), (r, h * 0.8), (neck, h * 0.92), (neck, h), (0, h)],
        color=color,
        finish=random_finish(rng, color),
    )
    parts = [body, lathe([(neck * 1.06, h - lid * 0.3), (neck * 1.06, h + lid), (0, h + lid)], color=random_color(rng))]
    if rng.random() < 0.75:
        low, high = sorted(rng.uniform(0.1, 0.78, 2) * h)
        parts.append(lathe([(r * 1.01, low), (r * 1.01, high + 0.01)], printed(rng, random_color(rng))))
    return solid(*_squeezed(rng, parts), flat=True)


def bottle(rng: Rng, color: Color) -> Thing:
    """Return a bottle: body of glass or plastic, mostly with a label, and a cap."""
    r, h = rng.uniform(0.022, 0.048), rng.uniform(0.14, 0.32)
    neck, shoulder = r * rng.uniform(0.25, 0.5), h * rng.uniform(0.5, 0.8)
    bend = [
        (neck + (r - neck) * (0.5 + 0.5 * np.cos(np.pi * t)), shoulder + t * 0.2 * h) for t in (0, 0.25, 0.5, 0.75, 1)
    ]
    top = max(h, shoulder + 0.22 * h)
    finish = int(rng.choice([MATT, SHINY, GLASS], p=[0.6, 0.2, 0.2]))
    parts = [lathe([(0, 0), (r * 0.9, 0), (r, 0.01), *bend, (neck, top), (0, top)], color=color, finish=finish)]
    parts.append(
        lathe([(neck * 1.15, top - 0.025), (neck * 1.15, top + 0.004), (0, top + 0.004)], color=random_color(rng))
    )
    if rng.random() < 0.75:
        low = rng.uniform(0.05, 0.3) * shoulder
        parts.append(
            lathe(
                [(r * 1.01, low), (r * 1.01, low + rng.uniform(0.35, 0.65) * shoulder)], printed(rng, random_color(rng))
            )
        )
    if rng.random() < 0.2:  # a trigger, as on a spray bottle
        trigger = box((0.09, 0.022, 0.03), color=random_color(rng)).moved((0.02, 0, top))
        parts += [trigger, tube([(0.035, 0, top), (0.04, 0, top - 0.035)], 0.005, random_color(rng))]
    return solid(*_squeezed(rng, parts))


def _squeezed(rng: Rng, parts: list[Part]) -> list[Part]:
    """Return parts made oval or almost square in half of the cases, as bottles of detergent, sauce or milk are."""
    if rng.random() < 0.5:
        return parts
    scale, power = np.array([1.0, rng.uniform(0.5, 1), 1.0]), rng.choice([2.0, rng.uniform(2, 10)])
    out = []
    for part in parts:
        direction = part.vertices[:, :2] / (np.linalg.norm(part.vertices[:, :2], axis=1, keepdims=True) + 1e-9)
        stretch = (np.abs(direction) ** power).sum(1, keepdims=True) ** (-1 / power)
        points = np.column_stack([part.vertices[:, :2] * np.where(stretch > 0, stretch, 1), part.vertices[:, 2]])
        out.append(replace(part, vertices=points * scale))
    return out


def lump(rng: Rng, color: Color) -> Thing:
    """Return a superellipsoid, between a rounded box, a cylinder and a lens, sometimes with a second part."""
    size, round_z, round_xy = rng.uniform((0.02, 0.02, 0.012), (0.09, 0.07, 0.08)), *rng.uniform(0.15, 1.1, 2)
    texture = printed(rng, color) if rng.random() < 0.4 else None
    ball_ = ellipsoid((1, 1, 1), texture, color if texture is None else (1, 1, 1), random_finish(rng, color))
    x, y, z = (ball_.vertices - [0, 0, 1]).T
    around, height = np.arctan2(y, x), np.arcsin(np.clip(z, -1, 1))
    bent = [
        np.sign(f(a)) * np.abs(f(a)) ** e
        for f, a, e in (
            (np.cos, around, round_xy),
            (np.sin, around, round_xy),
            (np.cos, height, round_z),
            (np.sin, height, round_z),
        )
    ]
    points = np.column_stack([bent[0] * bent[2], bent[1] * bent[2], bent[3] + 1]) * size
    parts = [replace(ball_, vertices=points)]
    if rng.random() < 0.35:
        second = replace(ball_, vertices=points * rng.uniform(0.35, 0.8, 3), texture=None, color=random_color(rng))
        parts.append(second.moved((*rng.uniform(-0.3, 0.3, 2) * size[:2], size[2] * rng.uniform(0.8, 1.7))))
    return solid(*parts)


def ball(rng: Rng, color: Color) -> Thing:
    """Return a ball, a fruit or a smooth lump."""
    r, texture = rng.uniform(0.02, 0.06), surface_print(rng, color) if rng.random() < 0.4 else None
    tint = color if texture is None else (1.0, 1.0, 1.0)
    return solid(ellipsoid(r * rng.uniform(0.75, 1.2, 3), texture, tint, dents=rng.uniform(0, 0.12), rng=rng))


def banana(rng: Rng, color: Color) -> Thing:
    """Return a bent tube, such as a banana or a pepper."""
    a, r = np.linspace(0, rng.uniform(0.8, 2), 8), rng.uniform(0.013, 0.02)
    path = np.stack([0.08 * np.cos(a), 0.08 * np.sin(a), np.full(8, r)], 1)
    tip = tube([path[-1], path[-1] * [1, 1.25, 1]], r * 0.4, (0.3, 0.25, 0.1))
    return solid(
        tube(path - [0.05, 0.04, 0], r * np.sin(np.linspace(0.5, 2.7, 8)), color), tip.moved((-0.05, -0.04, 0))
    )


def bag(rng: Rng, color: Color) -> Thing:
    """Return a soft bag, a bag of chips or a backpack, with or without handles."""
    size = rng.uniform((0.05, 0.03, 0.06), (0.17, 0.09, 0.17)) * rng.choice([0.5, 0.6, 1.0])
    texture = printed(rng, color) if rng.random() < 0.5 else surface_print(rng, color)
    body = ellipsoid(size, texture, dents=0.2, rng=rng)
    points = np.sign(body.vertices) * np.abs(body.vertices / [*size[:2], 1]) ** 0.7 * [*size[:2], 1]
    part = Part(points, body.faces, body.uv, None, texture)
    if rng.random() < 0.5:
        return solid(part)
    w, top = size[0] * 0.5, size[2] * 2
    return solid(
        part,
        tube(
            [(-w, 0, top * 0.9), (-w * 0.6, 0, top * 1.25), (w * 0.6, 0, top * 1.25), (w, 0, top * 0.9)],
            0.007,
            random_color(rng),
        ),
    )
