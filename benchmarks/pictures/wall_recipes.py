"""Recipes of places at a wall (high y), which the camera sees from low y: desks, kitchens, shelves, lying cartons."""

from __future__ import annotations

import numpy as np
from catalog import BIG, DESK, KITCHEN, SMALL, STANDING
from devices import appliance, keyboard, laptop, monitor, mouse, stick
from furniture import cable, chair, cupboard, papers, room, shelves, table
from groceries import bag
from meshes import Color, Floats, box, pick, rotation
from placing import Colors, books_upright, make, on_top, outline, put_where_free, row, scatter
from prints import random_color, surface
from vessels import mug, open_box, pot

from scene import IGNORE, Focus, Scene

CARDBOARD: Color = (0.68, 0.52, 0.36)
DISPLAY_BLACK: Color = (0.06, 0.06, 0.065)
SHELF_MODES = {"front": 5.0, "close_front": 3.0, "far": 1.0}
CARTON_MODES = {**SHELF_MODES, "hand": 3.0, "overhead": 0.5}
DESK_MODES = {"hand": 5.0, "close": 2.0, "far": 1.5, "overhead": 1.0, "front": 2.0, "grazing": 1.0}
KITCHEN_MODES = {"hand": 3.0, "front": 2.0, "far": 4.0, "close": 1.5, "grazing": 1.0, "overhead": 0.5}
# Chance that a compartment of a shelf holds upright books.
BOOKS_CHANCE = 0.12


def shelf(scene: Scene) -> None:
    """Shelves with compartments; things stand at different depths and near the side walls."""
    rng, back = scene.rng, 0.98
    room(scene, (-1.8, 1.8), (-2.2, 1.0), walls=int(rng.integers(1, 4)))
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(2, 5))
    w, h, d = rng.uniform((0.35, 0.24, 0.22), (0.75, 0.42, 0.42))
    thick, base = rng.uniform(0.015, 0.03), rng.uniform(0.05, max(0.06, 1.7 - rows * h))
    scene.add(shelves(rng, (columns, rows), (w, d, h), thick), (0, back - d / 2, base))
    makers, colors = pick(rng, (STANDING, KITCHEN, (*BIG, *STANDING), SMALL)), Colors(scene)
    for r, c in np.ndindex(rows, columns):
        x, z = (c - columns / 2) * w, base + r * h + thick
        area = (x + thick, x + w - thick, back - d + 0.01, back - 0.02)
        if rng.random() < BOOKS_CHANCE:
            books_upright(scene, area, z, min(h - thick, 0.28), colors)
            continue
        fit = [t for t in make(scene, makers, 14, colors) if t.size()[2] < h - thick - 0.01]
        fit = [t for t in fit if max(t.size()[:2]) < d - 0.04][: int(rng.integers(1, 13))]
        placed = row(scene, fit, area, z) if rng.random() < 0.4 else scatter(scene, fit, area, z)
        for one in placed[:1]:
            if one.thing.flat and one.thing.size()[2] < 0.4 * h and rng.random() < 0.5:
                on_top(scene, one, z, colors, most=1)
    for r in range(rows):
        point = np.array([0, back - d * 0.6, base + (r + 0.4) * h])
        scene.focuses.append(Focus(point, 0.25 * columns * w, (-90, 40), SHELF_MODES))


def lying_cartons(scene: Scene) -> None:
    """Open cartons or crates on their side with groceries in them, on a table or the floor."""
    rng = scene.rng
    room(scene, (-1.8, 1.8), (-2.2, 1.2), walls=int(rng.integers(1, 4)))
    height = 0.0 if rng.random() < 0.3 else rng.uniform(0.4, 0.9)
    if height:
        table(scene, (0, 0), (1.4, 0.9), height)
    colors = Colors(scene)
    for x in (-0.45, 0.0, 0.45)[: int(rng.integers(1, 4))]:
        w, d, h = rng.uniform((0.28, 0.2, 0.2), (0.42, 0.32, 0.36))
        color = CARDBOARD if rng.random() < 0.5 else colors()
        case = open_box(rng, color, (w, h, d), 0.006, flaps=rng.random() < 0.4)
        on_side = rotation("z", rng.normal(0, 8)) @ rotation("x", 90)
        scene.add(case, (x, 0.15 + d / 2, height + h / 2), 1, on_side)
        fit = [t for t in make(scene, STANDING, int(rng.integers(3, 9)), colors) if t.size()[2] < h - 0.02]
        inside = (x - w / 2 + 0.03, x + w / 2 - 0.03, 0.15 - d / 2 + 0.02, 0.13 + d / 2 - 0.02)
        scatter(scene, fit, inside, height + 0.008, lying=0.05)
    scatter(scene, make(scene, SMALL, int(rng.integers(2, 7)), colors), (-0.6, 0.6, -0.4, -0.05), height)
    scene.focuses.append(Focus(np.array([0, 0.05, height + 0.12]), 0.3, (-90, 45), CARTON_MODES))


def desk(scene: Scene) -> None:
    """A desk with displays, keyboard, mouse and other things."""
    rng = scene.rng
    room(scene, (-2.0, 2.0), (-2.2, 0.75), walls=int(rng.integers(1, 4)))
    height, w = rng.uniform(0.7, 0.78), rng.uniform(0.6, 0.85)
    table(scene, (0, 0.3), (2 * w, 0.8), height)
    if rng.random() < 0.4:
        cupboard(scene, w - 0.5, w - 0.1, 0.65, 0.0, (0.6, height - 0.06))
    papers(scene, (-w + 0.2, w - 0.2, -0.05, 0.5), height)
    for _ in range(int(rng.integers(0, 3))):
        cable(scene, (-w, w, 0.1, 0.68), height)
    color = random_color(rng) if rng.random() < 0.3 else DISPLAY_BLACK
    taken: list[Floats] = []
    x = rng.uniform(-0.25, 0.1)
    for _ in range(int(rng.integers(0, 3))):
        put_where_free(scene, monitor(rng, color), (x, x, 0.4, 0.55), height, rng.normal(0, 14), taken)
        x += rng.choice([-1, 1]) * rng.uniform(0.5, 0.7)
    makers = [laptop] if rng.random() < 0.5 or not taken else []
    for maker in [*makers, keyboard][: 2 if rng.random() < 0.85 else len(makers)]:
        thing = maker(rng, color if rng.random() < 0.5 else random_color(rng))
        put_where_free(scene, thing, (-0.4, 0.4, 0.05, 0.3), height + 0.002, rng.normal(0, 12), taken)
    things = make(scene, (*DESK, mouse), int(rng.integers(5, 16)))
    scatter(scene, things, (-w + 0.03, w - 0.03, -0.07, 0.67), height, taken=taken)
    chair(scene, (rng.uniform(-0.3, 0.3), -0.45), 180 + rng.normal(0, 30))
    scene.focuses.append(Focus(np.array([0, 0.28, height + 0.1]), 0.3, (-90, 55), DESK_MODES))


def _counter(scene: Scene, x0: float, x1: float, depth: float, height: float) -> None:
    """Add a counter with cupboards below, and above it tiles and cupboards, or boards with things in rows."""
    rng = scene.rng
    middle = (x0 + x1) / 2
    cupboard(scene, x0, x1, 1.2, 0.0, (depth, height - 0.04))
    scene.add([surface(rng, (x1 - x0, depth + 0.02, 0.04))], (middle, 1.2 - depth / 2 - 0.01, height - 0.04))
    if rng.random() < 0.5:
        scene.add([surface(rng, (x1 - x0, 0.01, 0.5))], (middle, 1.19, height))
    if rng.random() < 0.55:
        cupboard(scene, x0, x1, 1.2, height + rng.uniform(0.5, 0.65), (0.35, 0.7))
        return
    for z in (height + 0.42, height + 0.78)[: int(rng.integers(0, 3))]:
        scene.add([surface(rng, (1.2, 0.2, 0.02))], (0, 1.1, z))
        fit = [t for t in make(scene, KITCHEN + STANDING, 12) if t.size()[2] < 0.3]
        row(scene, fit, (-0.58, 0.58, 1.02, 1.19), z + 0.02)


def _at_the_wall(scene: Scene, x0: float, x1: float, z: float, colors: Colors) -> None:
    """Hang things on the wall over a counter, and add sockets."""
    rng = scene.rng
    for _ in range(int(rng.integers(0, 5))):
        thing = pick(rng, (stick, pot, mug, bag))(rng, colors())
        hung = rotation("y", 90) if thing.size()[0] > thing.size()[2] else rotation("x", 90)
        points = thing.points() @ hung.T
        if np.ptp(points[:, 2]) < 0.45:
            at = (rng.uniform(x0 + 0.2, x1 - 0.2), 1.18 - points[:, 1].max(), z + rng.uniform(0.25, 0.45))
            scene.put(thing, at, hung, falls=False)
    for _ in range(int(rng.integers(0, 3))):
        socket = box((rng.uniform(0.06, 0.1), 0.01, 0.08), color=(0.95, 0.95, 0.95))
        scene.add([socket], (rng.uniform(x0, x1), 1.18, z + 0.25), IGNORE)


def kitchen(scene: Scene) -> None:
    """A counter with appliances, jars and bottles in a row at the wall, dishes before them, things that hang."""
    rng = scene.rng
    room(scene, (-1.9, 1.9), (-2.2, 1.2), walls=int(rng.integers(1, 4)))
    x0, x1 = -rng.uniform(1.0, 1.9), rng.uniform(1.0, 1.9)
    height, depth = rng.uniform(0.85, 0.95), rng.uniform(0.55, 0.65)
    _counter(scene, x0, x1, depth, height)
    colors, taken = Colors(scene), []
    back = make(scene, (appliance, appliance, *KITCHEN), int(rng.integers(3, 10)), colors)
    for one in row(scene, back, (x0 + 0.05, x1 - 0.05, 1.2 - depth * 0.6, 1.17), height):
        taken.append(outline(one.thing, np.eye(3)) + one.place)
        if one.thing.flat and rng.random() < 0.3:
            on_top(scene, one, height, colors)
    front = make(scene, KITCHEN, int(rng.integers(4, 12)), colors)
    scatter(scene, front, (x0 + 0.05, x1 - 0.05, 1.2 - depth + 0.03, 1.17), height, near=0.4, taken=taken)
    _at_the_wall(scene, x0, x1, height, colors)
    for x in (x0 * 0.55, 0.0, x1 * 0.55):
        scene.focuses.append(Focus(np.array([x, 1.2 - depth / 2, height + 0.1]), 0.2, (-90, 50), KITCHEN_MODES))
