"""Kinds of scenes with little texture or few objects: toys in a box and on a floor, filled trays, an empty table."""

from __future__ import annotations

import numpy as np

from cuboid.lab.synthetic.clutter import add_cables, add_clutter, add_papers
from cuboid.lab.synthetic.draft import Draft, add_middle_table, circling
from cuboid.lab.synthetic.mesh import shift, turn
from cuboid.lab.synthetic.placement import Arrangement
from cuboid.lab.synthetic.rooms import add_home, add_plain_room, count_neither_way
from cuboid.lab.synthetic.scene import SceneObject, Surface
from cuboid.lab.synthetic.shapes import Model, build, choice, turned
from cuboid.lab.synthetic.shapes.table import PLATE_FLAT, PLATE_FLOOR_M, TRAY_FLOOR_M

# Walls and floor of a toy box, metres.
BOX_WALL_M, BOX_FLOOR_M = 0.005, 0.006
# Gap between things on a tray or a plate, and to its rim, metres.
TRAY_GAP_M = 0.006


def build_toybox(draft: Draft) -> None:
    """Build a plain box full of plain toys on a floor of the same color; the camera looks into it from above."""
    rng = draft.rng
    color = add_plain_room(draft)
    half = np.array([rng.uniform(0.25, 0.34), rng.uniform(0.19, 0.25)])
    height = float(rng.uniform(0.14, 0.24))
    body = draft.make("toy_box", half=half, height=height, color=color, wall=BOX_WALL_M, floor=BOX_FLOOR_M)
    angle = rng.uniform(0, np.pi)
    draft.add(body, turn(angle))
    draft.objects = Arrangement((Surface("toy box", BOX_FLOOR_M, np.zeros(2), half, angle),), rng)
    for number, model in enumerate(draft.models(14, "toys")):
        alone = [one for one in draft.objects.objects if not one.touches]
        if number % 4 != 3 or not alone:
            draft.objects.put(model, 0, rng.uniform(0.004, 0.015))
        else:
            draft.objects.put_beside(model, choice(rng, alone), 0.0, 0.004)
    count_neither_way(draft)
    draft.waypoints = circling(draft, 0, radius=rng.uniform(0.4, 0.7), height=rng.uniform(0.95, 1.15))


def build_floor(draft: Draft) -> None:
    """Build a plain floor with toys, shoes and bags; the camera walks along them and looks down."""
    rng = draft.rng
    add_plain_room(draft)
    half = np.array([rng.uniform(0.9, 1.2), rng.uniform(0.6, 0.8)])
    draft.objects = Arrangement((Surface("floor", 0.0, np.array([0.0, 0.5]), half),), rng)
    for model in draft.models(int(rng.integers(9, 14)), "on_floor"):
        placed = draft.objects.put(model, 0, 0.06)
        if placed is not None and placed.model.name == "shoe":
            draft.objects.put_beside(Model("shoe", model.parts), placed, 0.03, 0.06)
    count_neither_way(draft)
    add_clutter(draft, 0, cloths=int(rng.integers(0, 3)), leaflets=int(rng.integers(0, 2)))
    add_papers(draft, 0, int(rng.integers(0, 3)))
    add_cables(draft, 0, int(rng.integers(0, 3)))
    seat = draft.make(choice(rng, ("stool", "chair", "office_chair")))
    draft.add(seat, shift((rng.uniform(-0.8, 0.8), 0.5 + half[1] + 0.4, 0)) @ turn(rng.uniform(0, 6)), doubtful=True)
    side = choice(rng, (-1, 1))
    along = side * np.linspace(-1.0, 1.0, 9)
    eyes = np.column_stack([along, -0.75 + rng.uniform(-0.2, 0.2, 9), rng.uniform(1.15, 1.5, 9)])
    aims = np.column_stack([0.75 * along, 0.45 + rng.uniform(-0.15, 0.15, 9), np.full(9, 0.08)])
    draft.waypoints = np.column_stack([eyes, aims])


def build_tray(draft: Draft) -> None:
    """Build a table with trays and plates that hold things, and cutlery and dishes beside them."""
    rng = draft.rng
    add_home(draft)
    add_middle_table(draft)
    for place in ((-0.4, -0.25), (0.42, 0.2))[: int(rng.integers(1, 3))]:
        _filled_tray(draft, place)
    for _ in range(int(rng.integers(1, 3))):
        plate = draft.objects.put(draft.models(1, ("plate",))[0], 0, 0.03, within=0.85)
        if plate is not None:
            _filled_plate(draft, plate)
    draft.fill(0, int(rng.integers(4, 8)), "beside_tray", 0.025, 0.9)
    add_clutter(draft, 0, cloths=int(rng.random() < 0.5))
    top = draft.objects.surfaces[0].height_m
    draft.waypoints = circling(draft, 0, radius=rng.uniform(0.8, 1.05), height=top + rng.uniform(0.55, 0.85))


def _filled_tray(draft: Draft, place: tuple[float, float]) -> None:
    """Put a tray near a place, with two to four things on it."""
    rng = draft.rng
    x, y = rng.uniform(0.34, 0.44), rng.uniform(0.25, 0.3)
    angle = rng.uniform(0, np.pi)
    tray = draft.objects.put_near(turned(build("tray", rng, x=x, y=y), angle), 0, 0.03, place, (0.1, 0.1), 0.0)
    if tray is None:
        return
    inner = (x / 2 - 0.02) * np.array([1.0, y / x])
    floor = Surface("tray", _height(draft) + TRAY_FLOOR_M, tray.T_room_model[:2, 3], inner, angle)
    for model in draft.models(int(rng.integers(3, 6)), "on_tray"):
        draft.objects.put_in(model, tray, floor, TRAY_GAP_M)


def _filled_plate(draft: Draft, plate: SceneObject) -> None:
    """Put one to three things on a plate."""
    radius = PLATE_FLAT * float(np.ptp(plate.model.mesh().vertices[:, 0])) / 2
    middle = plate.T_room_model[:2, 3]
    floor = Surface("plate", _height(draft) + PLATE_FLOOR_M, middle, np.full(2, radius), round=True)
    for model in draft.models(int(draft.rng.integers(1, 4)), "on_plate"):
        draft.objects.put_in(model, plate, floor, 0.002)


def _height(draft: Draft) -> float:
    return draft.objects.surfaces[0].height_m


def build_alone(draft: Draft) -> None:
    """Build an empty table with one to three things."""
    rng = draft.rng
    add_home(draft)
    add_middle_table(draft)
    draft.fill(0, int(rng.integers(1, 4)), "single", 0.12, 0.6)
    draft.waypoints = circling(draft, 0, radius=rng.uniform(0.85, 1.2))
