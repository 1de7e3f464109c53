"""Kinds of scenes as in homes and offices: a desk, a kitchen counter, a bookshelf."""

from __future__ import annotations

import numpy as np

from cuboid.lab.synthetic.clutter import add_cables, add_clutter, add_papers
from cuboid.lab.synthetic.draft import ROOM_HALF_M, Draft, on_floor
from cuboid.lab.synthetic.mesh import shift, turn
from cuboid.lab.synthetic.placement import Arrangement
from cuboid.lab.synthetic.rooms import add_home, count_neither_way, in_front
from cuboid.lab.synthetic.scene import Surface
from cuboid.lab.synthetic.shapes.model import choice

# Direction from a wall at +y into the room: the front of most models is at +x.
TO_ROOM = -np.pi / 2
# Clearance above an object in a shelf, metres.
SHELF_CLEARANCE_M = 0.03


def build_desk(draft: Draft) -> None:
    """Build a desk at a wall with screens, keyboard, lamp, books, papers and cables, seen from the chair's side."""
    rng = draft.rng
    add_home(draft)
    half = np.array([rng.uniform(0.72, 0.88), rng.uniform(0.36, 0.42)])
    middle = np.array([rng.uniform(-0.6, 0.6), ROOM_HALF_M - half[1] - 0.04])
    surface = Surface("desk", rng.uniform(0.7, 0.76), middle, half)
    draft.add(draft.make("table", x=2 * half[0], y=2 * half[1], height=surface.height_m), on_floor(surface))
    draft.objects = Arrangement((surface,), rng)
    _workplace(draft)
    draft.fill(0, int(rng.integers(7, 11)), "on_desk", 0.025)
    count_neither_way(draft)
    add_papers(draft, 0, int(rng.integers(2, 5)))
    add_clutter(draft, 0, leaflets=int(rng.integers(0, 2)), cloths=int(rng.random() < 0.3))
    add_cables(draft, 0, int(rng.integers(2, 5)))
    beside = shift((middle[0] + choice(rng, (-1, 1)) * (half[0] + 0.4), middle[1] - 0.1, 0))
    draft.add(draft.make("office_chair"), beside @ turn(rng.uniform(0, 2 * np.pi)), doubtful=True)
    draft.waypoints = in_front(
        draft, (*middle, surface.height_m + 0.1), rng.uniform(1.0, 1.25), surface.height_m + rng.uniform(0.4, 0.6), 0.85
    )


def _workplace(draft: Draft) -> None:
    """Put one or two monitors at the back of a desk, or a laptop, a keyboard in front and a mouse beside it."""
    rng = draft.rng

    def put(
        name: str, gap: float, place: tuple[float, float], spread: tuple[float, float], angle: float, turns: float = 0.0
    ) -> None:
        """Put a thing near a place, at this angle with a random difference of up to `turns`."""
        (model,) = draft.models(1, (name,))
        angle += rng.uniform(-turns, turns) if turns else 0.0
        draft.objects.put_near(model, 0, gap, place, spread, angle)

    aside = rng.uniform(-0.35, 0.35)
    screens = [aside] if rng.random() < 0.6 else [-0.42, 0.42]
    if rng.random() < 0.75:
        for x in screens:
            put("monitor", 0.01, (x, 0.5), (0.05, 0.1), TO_ROOM - 0.35 * x, 0.1)
        put("keyboard", 0.01, (screens[0], -0.5), (0.05, 0.15), TO_ROOM, 0.15)
        put("mouse", 0.01, (screens[0] + 0.42, -0.5), (0.08, 0.15), -TO_ROOM, 0.3)
        if rng.random() < 0.5:
            put("laptop", 0.02, (-0.6 * np.sign(aside), -0.1), (0.15, 0.2), TO_ROOM + 0.4 * np.sign(aside))
    else:
        put("laptop", 0.02, (aside, -0.1), (0.1, 0.15), TO_ROOM, 0.3)
        put("mouse", 0.01, (aside + 0.4, -0.4), (0.08, 0.15), -TO_ROOM, 0.3)


def build_kitchen(draft: Draft) -> None:
    """Build a kitchen counter with cabinets, tiles and a hob; appliances at the wall, pans, bottles and piles."""
    rng = draft.rng
    add_home(draft, pictures=False)
    long, deep, height = rng.uniform(0.95, 1.25), 0.31, rng.uniform(0.86, 0.94)
    at_wall = np.array([rng.uniform(-0.5, 0.5), ROOM_HALF_M])
    wall = shift((*at_wall, 0))
    surface = Surface("counter", height, at_wall - (0, deep + 0.012), np.array([long, deep - 0.005]))
    draft.add(draft.make("base_cabinets", length=2 * long, depth=2 * deep, height=height), on_floor(surface))
    draft.add(draft.make("splashback", length=2 * long, low=height), wall)
    draft.add(draft.make("wall_cabinets", length=2 * long), wall)
    for x in rng.uniform(-0.8, 0.8, 2):
        draft.add(draft.make("socket"), wall @ shift((x * long, -0.008, height + 0.22)))
    draft.objects = Arrangement((surface,), rng)
    hob = surface.at(rng.uniform(-0.6, 0.6), 0.05)
    draft.add(draft.make("hob"), shift((*hob, height - 0.003)))
    for model in draft.models(int(rng.integers(3, 5)), "appliances"):
        draft.objects.put_near(model, 0, 0.02, (rng.uniform(-0.9, 0.9), 0.45), (0.3, 0.4))
    _piles(draft)
    draft.fill(0, int(rng.integers(7, 11)), "on_counter", 0.015)
    count_neither_way(draft)
    add_clutter(draft, 0, cloths=int(rng.random() < 0.6), leaflets=int(rng.random() < 0.3))
    draft.waypoints = in_front(
        draft, (*surface.center, height + 0.08), rng.uniform(1.0, 1.35), height + rng.uniform(0.45, 0.65), 0.75
    )


def _piles(draft: Draft) -> None:
    """Put one or two piles of packages on the counter."""
    for _ in range(int(draft.rng.integers(1, 3))):
        first, second = draft.models(2, "piled")
        below = draft.objects.put(first, 0, 0.02, within=0.9)
        if below is not None:
            draft.objects.put_on(second, below)


def build_bookshelf(draft: Draft) -> None:
    """Build a shelf at a wall, full of things of all kinds; the camera looks at it from the front."""
    rng = draft.rng
    add_home(draft, pictures=False)
    wide, deep = rng.uniform(0.85, 1.15), rng.uniform(0.3, 0.36)
    steps = rng.uniform(0.33, 0.4, 4)
    boards = 0.3 + np.concatenate([[0.0], np.cumsum(steps)])[:4]
    x, y = rng.uniform(-0.6, 0.6), ROOM_HALF_M - deep / 2 - 0.02
    draft.add(
        draft.make("shelf", x=wide, y=deep, height=boards[-1] + steps[-1], boards=boards.tolist()), shift((x, y, 0))
    )
    surfaces = tuple(
        Surface(f"board {k + 1}", float(h), np.array([x, y]), np.array([wide / 2, deep / 2]))
        for k, h in enumerate(boards)
    )
    draft.objects = Arrangement(surfaces, rng)
    for board, step in enumerate(steps):
        for model in draft.models(int(rng.integers(9, 14)), "in_shelf"):
            if float(model.mesh().vertices[:, 2].max()) < step - 0.025 - SHELF_CLEARANCE_M:
                angle = TO_ROOM + rng.uniform(-0.12, 0.12) * (
                    1 if "book" in model.name or model.name == "binder" else 4
                )
                draft.objects.put_near(model, board, 0.01, (0.0, 0.0), (1.0, 0.5), angle)
    count_neither_way(draft)
    middle = (x, y - deep / 2, float(boards[1:3].mean()) + 0.1)
    draft.waypoints = in_front(draft, middle, rng.uniform(1.2, 1.5), rng.uniform(1.2, 1.45), 0.6)
