"""Rooms, tables, shelves and cupboards (structure); chairs, papers and cables (ignored)."""

from __future__ import annotations

import numpy as np
from meshes import SCREEN, SHINY, WHOLE, Part, Rng, Vector, box, pick, rotation, tube
from placing import Region
from prints import printed, random_color, surface, surface_print
from thing import STEEL, Thing

from scene import IGNORE, Scene

# A pane of a window: no depth, but drawn opaque.
GLASS_PANE = SCREEN


def door(rng: Rng) -> list[Part]:
    """Return a door or a cupboard front that faces -y: a leaf with panels in a frame, and a handle."""
    w, h, color = rng.uniform(0.7, 0.95), rng.uniform(1.9, 2.1), random_color(rng)
    leaf = surface(rng, (w, 0.03, h))
    rims = [box((0.07, 0.05, h + 0.07), color=color).moved((s * (w / 2 + 0.035), 0, 0)) for s in (1, -1)]
    panels = [
        box((w * 0.7, 0.012, h * 0.35), leaf.texture, leaf.color, tile_m=0.7).moved((0, -0.02, h * z))
        for z in (0.1, 0.55)
    ]
    return [
        leaf,
        *rims,
        *panels,
        tube([(w * 0.42, -0.02, 1.0), (w * 0.42, -0.06, 1.0), (w * 0.3, -0.06, 1.0)], 0.01, STEEL, SHINY),
    ]


def radiator(rng: Rng) -> list[Part]:
    """Return a heater with ribs that faces -y."""
    count, h = int(rng.integers(5, 14)), rng.uniform(0.4, 0.7)
    return [
        box((0.05, 0.07, h), color=(0.92, 0.92, 0.9)).moved((0.06 * (k - count / 2), -0.05, 0.12)) for k in range(count)
    ]


def window(rng: Rng) -> list[Part]:
    """Return a bright window with a frame that faces -y."""
    w, h, color = rng.uniform(0.6, 1.4), rng.uniform(0.7, 1.2), random_color(rng)
    pane = box((w, 0.02, h), surface_print(rng, (0.8, 0.9, 1.0)), finish=GLASS_PANE, rectangles=WHOLE).moved(
        (0, 0, 0.95)
    )
    bars = [box((0.05, 0.05, h), color=color).moved((x * w / 2, -0.01, 0.95)) for x in (-1, 0, 1)]
    return [pane, *bars, *(box((w, 0.09, 0.04), color=color).moved((0, -0.02, 0.95 + z)) for z in (0, h - 0.04))]


def _on_wall(scene: Scene, middle: Vector, turn_deg: float) -> None:
    """Add a door, heater or window, or ignored pictures, to a wall whose inside faces -y before the turn."""
    rng, turn = scene.rng, rotation("z", turn_deg)
    if rng.random() < 0.4:
        along = turn @ [rng.uniform(-1.2, 1.2), -0.055, 0]
        scene.add(pick(rng, (door, radiator, window))(rng), middle + along, turn=turn)
        return
    for _ in range(int(rng.integers(0, 3))):
        w, h = rng.uniform(0.15, 0.7, 2)
        picture = box((w, 0.015, h), printed(rng, random_color(rng)), rectangles=WHOLE)
        along = turn @ [rng.uniform(-0.8, 0.8), -0.055, rng.uniform(1.0, 1.6)]
        scene.add([picture], middle + along, IGNORE, turn)


def room(scene: Scene, x: tuple[float, float], y: tuple[float, float], walls: int = 4) -> None:
    """Add a floor and up to four walls, the first at high y, with doors, windows, heaters and pictures."""
    rng, height = scene.rng, 2.6
    (x0, x1), (y0, y1) = x, y
    scene.bounds = np.array([[x0 + 0.1, y0 + 0.1, 0.05], [x1 - 0.1, y1 - 0.1, 2.4]])
    middle_x, middle_y = (x0 + x1) / 2, (y0 + y1) / 2
    scene.add([surface(rng, (x1 - x0 + 0.4, y1 - y0 + 0.4, 0.1), 0.15)], (middle_x, middle_y, -0.1))
    long_wall = surface(rng, (x1 - x0 + 0.2, 0.1, height), 0.5, pale=True)
    short_wall = surface(rng, (y1 - y0, 0.1, height), 0.5, pale=True)
    sides = (
        (long_wall, (middle_x, y1 + 0.05, 0), 0.0),
        (short_wall, (x0 - 0.05, middle_y, 0), 90.0),
        (short_wall, (x1 + 0.05, middle_y, 0), -90.0),
        (long_wall, (middle_x, y0 - 0.05, 0), 180.0),
    )
    for wall, middle, turn_deg in sides[:walls]:
        scene.add([wall], middle, turn=turn_deg)
        _on_wall(scene, np.array(middle), turn_deg)


def table(scene: Scene, at: Vector, size: Vector, height: float, turn: float = 0.0) -> None:
    """Add a table or desk with legs or panels under its top."""
    rng = scene.rng
    w, d = size
    thick = rng.uniform(0.02, 0.05)
    parts = [surface(rng, (w, d, thick)).moved((0, 0, height - thick))]
    leg = random_color(rng)
    inset = 0.06
    if rng.random() < 0.7:
        parts += [
            box((0.05, 0.05, height - thick), color=leg).moved((s * (w / 2 - inset), t * (d / 2 - inset), 0))
            for s in (1, -1)
            for t in (1, -1)
        ]
    else:
        parts += [box((0.03, d * 0.9, height - thick), color=leg).moved((s * (w / 2 - inset), 0, 0)) for s in (1, -1)]
    scene.add(parts, (*at, 0), turn=turn)


def chair(scene: Scene, at: Vector, turn: float) -> None:
    """Add a chair, which is ignored."""
    rng = scene.rng
    color, h = random_color(rng), rng.uniform(0.4, 0.5)
    parts = [
        box((0.42, 0.42, 0.05), color=color).moved((0, 0, h)),
        box((0.42, 0.04, 0.42), color=color).moved((0, 0.2, h + 0.08)),
    ]
    parts += [
        box((0.035, 0.035, h), color=random_color(rng)).moved((s * 0.18, t * 0.18, 0)) for s in (1, -1) for t in (1, -1)
    ]
    scene.add(parts, (*at, 0), IGNORE, turn)


def sofa(scene: Scene, at: Vector, turn_deg: float) -> None:
    """Add a sofa with its front at -y before the turn; it is ignored."""
    rng = scene.rng
    skin = surface(rng, (1, 1, 1))
    w, seat = rng.uniform(1.2, 1.9), rng.uniform(0.38, 0.46)
    blocks = (((w, 0.8, seat), (0, 0, 0)), ((w, 0.2, 0.4), (0, 0.32, seat)))
    sides = tuple(((0.18, 0.8, 0.2), (s * (w / 2 - 0.09), 0, seat)) for s in (1, -1))
    parts = [box(size, skin.texture, skin.color, tile_m=0.6).moved(place) for size, place in blocks + sides]
    scene.add(parts, (*at, 0), IGNORE, turn_deg)


def shelves(rng: Rng, count: tuple[int, int], size: Vector, thick: float) -> list[Part]:
    """Return columns and rows of compartments of a size (w, d, h), centred in x and y, mostly with a back."""
    (columns, rows), (w, d, h) = count, size
    board, side = surface(rng, (columns * w, d, thick)), surface(rng, (thick, d, rows * h))
    parts = [board.moved((0, 0, k * h)) for k in range(rows + 1)]
    parts += [side.moved(((c - columns / 2) * w, 0, 0)) for c in range(columns + 1)]
    if rng.random() < 0.6:
        parts.append(surface(rng, (columns * w, 0.01, rows * h)).moved((0, d / 2, 0)))
    return parts


def cupboard(scene: Scene, x0: float, x1: float, y_back: float, z: float, size: tuple[float, float]) -> None:
    """Add a row of cupboards with doors or drawers and handles, all of it structure. size: depth and height."""
    rng = scene.rng
    depth, height = size
    front = y_back - depth
    parts = [surface(rng, (x1 - x0, depth - 0.02, height)).moved(((x0 + x1) / 2, y_back - depth / 2 + 0.01, 0))]
    template, count = surface(rng, (1, 1, 1)), max(1, int((x1 - x0) / rng.uniform(0.35, 0.65)))
    w, grip, drawers = (x1 - x0) / count, random_color(rng), rng.random() < 0.5
    for k in range(count):
        rows = int(rng.integers(2, 5)) if drawers and rng.random() < 0.5 else 1
        for r in range(rows):
            h = height / rows
            panel = box((w - 0.008, 0.02, h - 0.008), template.texture, template.color, tile_m=0.8)
            at = (x0 + (k + 0.5) * w, front, r * h + 0.004)
            parts.append(panel.moved(at))
            wide = rows > 1 or rng.random() < 0.2
            bar = box((0.14, 0.02, 0.012) if wide else (0.012, 0.02, 0.14), color=grip, finish=SHINY)
            parts.append(
                bar.moved(
                    (at[0] + (0 if wide else 0.4 * w * (-1) ** k), front - 0.022, at[2] + h * (0.75 if z < 1 else 0.2))
                )
            )
    scene.add(parts, (0, 0, z))


def papers(scene: Scene, region: Region, z: float) -> None:
    """Lay sheets, mats or cloths on a surface; they are ignored."""
    rng = scene.rng
    for _ in range(int(rng.integers(0, 4))):
        w, d = rng.uniform(0.1, 0.32, 2)
        sheet = box(
            (w, d, 0.0015),
            printed(rng, (0.95, 0.95, 0.93) if rng.random() < 0.6 else random_color(rng)),
            rectangles=WHOLE,
        )
        place = rng.uniform([region[0], region[2]], [region[1], region[3]])
        scene.add(Thing((sheet,), ()), (*place, z - 0.0005), IGNORE, rng.uniform(0, 360))


def cable(scene: Scene, region: Region, z: float) -> None:
    """Lay a cable on a surface; it is ignored and touches nothing."""
    rng = scene.rng
    corners = rng.uniform([region[0], region[2]], [region[1], region[3]], (5, 2))
    t = np.linspace(0, 4, 40)
    path = np.stack(
        [*(np.interp(t, range(5), corners[:, k]) + 0.02 * np.sin(t * 4 + k) for k in (0, 1)), np.full(40, z + 0.003)], 1
    )
    scene.add(Thing((tube(path, 0.003, random_color(rng), sides=6),), ()), (0, 0, 0), IGNORE)
