"""Recipes of tables, bins and floors. Metres, degrees; the floor is at z = 0, the camera goes all around."""

from __future__ import annotations

import numpy as np
from catalog import DESK, HELD, KITCHEN, SMALL, STACKED, STANDING
from devices import appliance, plant, shoe, toy
from furniture import cable, chair, cupboard, papers, room, sofa, table
from groceries import bag, ball, bottle, carton
from hands import hand
from meshes import box, pick, rotation
from placing import Colors, in_container, make, on_top, outline, scatter
from prints import random_color, surface_print
from scans import scan
from thing import Thing
from vessels import crate, kettle, open_box

from scene import IGNORE, Focus, Scene

TABLE_MODES = {"hand": 4.0, "overhead": 1.5, "grazing": 1.5, "close": 2.0, "far": 1.0}
BIN_MODES = {"overhead": 4.0, "steep": 4.0, "hand": 2.0, "close": 1.0}
FLOOR_MODES = {"hand": 4.0, "far": 4.0, "overhead": 1.0, "grazing": 1.0, "close": 0.5}
HAND_MODES = {"hand": 4.0, "close": 3.0, "overhead": 2.0, "grazing": 1.0}


def _table_or_floor(scene: Scene, on_floor: float) -> float:
    """Add a room, and a table unless the floor is drawn with a probability; return the height to use."""
    rng = scene.rng
    room(scene, (-2.0, 2.0), (-1.8, 1.8))
    if rng.random() < on_floor:
        return 0.0
    height = rng.uniform(0.4, 0.95)
    table(scene, (0, 0), rng.uniform((1.2, 0.75), (1.6, 0.95)), height)
    return float(height)


def plain_table(scene: Scene) -> None:
    """A table with some things that stand apart or touch."""
    rng = scene.rng
    room(scene, (-2.2, 2.2), (-2.0, 2.0))
    size, height = rng.uniform((0.7, 0.55), (1.6, 0.9)), rng.uniform(0.4, 0.95)
    table(scene, (0, 0), size, height)
    w, d = size / 2 - 0.06
    papers(scene, (-w, w, -d, d), height)
    scatter(scene, make(scene, SMALL + KITCHEN, int(rng.integers(4, 13))), (-w, w, -d, d), height, near=0.4)
    if rng.random() < 0.5:
        chair(scene, (rng.uniform(-0.4, 0.4), -d - 0.4), 180 + rng.normal(0, 20))
    scene.focuses.append(Focus(np.array([0, 0, height]), 0.3 * float(min(size)), modes=TABLE_MODES))


def clutter(scene: Scene) -> None:
    """A table crowded with things that touch."""
    rng = scene.rng
    height = _table_or_floor(scene, on_floor=0.0)
    w, d = rng.uniform((0.25, 0.2), (0.45, 0.32))
    area = (-w, w, -d, d)
    papers(scene, area, height)
    if rng.random() < 0.4:
        cable(scene, area, height)
    kinds = pick(rng, (SMALL + STANDING + DESK, SMALL, STANDING, KITCHEN))
    scatter(scene, make(scene, kinds, int(rng.integers(14, 34))), area, height, near=0.75)
    scene.focuses.append(Focus(np.array([0, 0, height]), 0.2, modes=TABLE_MODES))


def stacks(scene: Scene) -> None:
    """Things on things and things in things, on a table or the floor."""
    rng = scene.rng
    height = _table_or_floor(scene, on_floor=0.2)
    colors = Colors(scene)
    bases = make(scene, STACKED, int(rng.integers(5, 12)), colors)
    placed = scatter(scene, bases, (-0.5, 0.5, -0.3, 0.3), height, lying=0)
    for one in placed:
        on_top(scene, one, height, colors)
    taken = [outline(p.thing, rotation("z", p.turn_deg)) + p.place for p in placed]
    scatter(scene, make(scene, SMALL, 4), (-0.55, 0.55, -0.33, 0.33), height, taken=taken)
    scene.focuses.append(Focus(np.array([0, 0, height + 0.05]), 0.25, modes=TABLE_MODES))


def heap(scene: Scene) -> None:
    """A bin or tote with a heap of things, from above; the bin itself is ignored."""
    rng = scene.rng
    height = _table_or_floor(scene, on_floor=0.3)
    size, turn = rng.uniform((0.3, 0.24, 0.1), (0.6, 0.45, 0.32)), rng.uniform(0, 360)
    tote = open_box(rng, random_color(rng), size, 0.01, flaps=rng.random() < 0.1)
    scene.add(tote, (0, 0, height), IGNORE, turn)
    assert tote.inside is not None
    half_w, half_d, floor_z, _ = tote.inside
    makers = (pick(rng, SMALL),) if rng.random() < 0.25 else SMALL
    fit = [
        t
        for t in make(scene, makers, int(rng.integers(14, 50)), Colors(scene))
        if max(t.size()) < 1.7 * min(half_w, half_d)
    ]
    for k, thing in enumerate(fit):
        reach = np.sort(thing.size())[1] / 2
        free = np.maximum([half_w - reach, half_d - reach], 0)
        offset = rotation("z", turn)[:2, :2] @ rng.uniform(-free, free)
        tumble = rotation("z", rng.uniform(0, 360)) @ rotation("x", rng.choice([0, 90, rng.uniform(0, 360)]))
        scene.put(thing, (*offset, height + floor_z + 0.08 + 0.07 * k), tumble)
    taken = [outline(tote, rotation("z", turn))]
    scatter(scene, make(scene, SMALL, int(rng.integers(0, 4))), (-0.55, 0.55, -0.35, 0.35), height, taken=taken)
    scene.focuses.append(Focus(np.array([0, 0, height + 0.1]), 0.1, modes=BIN_MODES))


def floor(scene: Scene) -> None:
    """Boxes, bins, bags and shoes on a floor, between furniture."""
    rng = scene.rng
    room(scene, (-2.2, 2.2), (-2.2, 2.2))
    colors = Colors(scene)
    if rng.random() < 0.7:
        chair(scene, (-0.9, 0.7), rng.uniform(0, 360))
    if rng.random() < 0.5:
        table(scene, (1.1, 1.3), (1.2, 0.7), 0.74)
    if rng.random() < 0.4:
        cupboard(scene, -1.5, 0.5, 2.2, 0.0, (0.4, rng.uniform(0.6, 1.8)))
    if rng.random() < 0.3:
        sofa(scene, (rng.uniform(-0.5, 0.5), -1.6), 180)
    if rng.random() < 0.4:
        rug = box((1.4, 1.0, 0.006), surface_print(rng, random_color(rng)), tile_m=rng.uniform(0.3, 1.4))
        scene.add(Thing((rug,), ()), (*rng.uniform(-0.5, 0.5, 2), 0), IGNORE, rng.uniform(0, 90))
    new = [carton(rng, colors(), rng.uniform(0.15, 0.5, 3)) for _ in range(int(rng.integers(1, 6)))]
    for _ in range(int(rng.integers(1, 4))):
        size = rng.uniform((0.2, 0.2, 0.15), (0.5, 0.4, 0.4))
        new += [open_box(rng, colors(), size, 0.008, flaps=rng.random() < 0.4)]
    makers = (bag, shoe, shoe, ball, crate, plant, appliance, bottle, scan, toy, kettle)
    new += make(scene, makers, int(rng.integers(4, 14)), colors)
    for one in scatter(scene, new, (-1.0, 1.0, -0.8, 0.8), 0.0, lying=0.05):
        if rng.random() < 0.5:
            on_top(scene, one, 0.0, colors)
    scene.focuses.append(Focus(np.array([0, 0, 0.1]), 0.6, modes=FLOOR_MODES))


def hands(scene: Scene) -> None:
    """One or two hands over a table: they hold something in the air, grasp it where it stands, or are empty."""
    rng = scene.rng
    height = _table_or_floor(scene, on_floor=0.0)
    colors, taken = Colors(scene), []
    for k in range(int(rng.integers(1, 3))):
        x, y = (-1) ** k * rng.uniform(0.05, 0.35), rng.uniform(-0.25, 0.1)
        if rng.random() < 0.15:
            hand(scene, np.array([x, y, height + rng.uniform(0.03, 0.2)]), 0.02, 0.02, from_above=True)
            continue
        fit = [t for t in make(scene, HELD, 12, colors) if min(t.size()[:2]) < 0.11 and t.size()[2] < 0.3]
        thing = (fit or make(scene, (ball,), 1, colors))[0]
        w, d, h = thing.size()
        lifted = rng.random() < 0.65
        at = np.array([x, y, height + (rng.uniform(0.15, 0.4) if lifted else h / 2)])
        turn = rotation("z", 0 if w < d else 90) @ rotation("y", rng.normal(0, 10) if lifted else 0)
        origin = at - turn @ ((thing.points().min(0) + thing.points().max(0)) / 2)
        scene.put(thing, origin, turn, falls=False)
        hand(scene, at, max(w, d) / 2 * 0.8, min(w, d) / 2, from_above=rng.random() < 0.4)
        taken.append(outline(thing, turn) + origin[:2])
    others = make(scene, SMALL + KITCHEN, int(rng.integers(3, 14)), colors)
    for one in scatter(scene, others, (-0.5, 0.5, -0.3, 0.3), height, taken=taken):
        if one.thing.inside is not None and rng.random() < 0.5:
            in_container(scene, one, height, colors)
    scene.focuses.append(Focus(np.array([0, -0.05, height + 0.15]), 0.15, modes=HAND_MODES))
