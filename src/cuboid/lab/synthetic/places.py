"""Kinds of scenes for robots: a table from above, a tote, a counter along a wall, flush stacks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.lab.synthetic.draft import Draft, add_middle_table, add_room, circling, on_floor
from cuboid.lab.synthetic.mesh import shift
from cuboid.lab.synthetic.paths import STILL
from cuboid.lab.synthetic.placement import Arrangement
from cuboid.lab.synthetic.scene import SceneObject, Surface
from cuboid.lab.synthetic.shapes import Model


def build_overhead(draft: Draft) -> None:
    """Build a table under a fixed camera that looks down with random roll; the table extends beyond the image."""
    rng = draft.rng
    add_room(draft)
    add_middle_table(draft)
    draft.fill(0, int(rng.integers(5, 9)), "small", 0.04, 0.6)
    top = draft.objects.surfaces[0]
    aim = np.array([*top.at(*rng.uniform(-0.35, 0.35, 2)), top.height_m])
    eye = aim + np.array([*rng.uniform(-0.12, 0.12, 2), rng.uniform(0.75, 1.05)])
    draft.waypoints = np.array([[*eye, *aim], [*(eye + 1e-4), *aim]])
    draft.style, draft.roll_rad, draft.whole = STILL, float(rng.uniform(-np.pi, np.pi)), True


def build_bin(draft: Draft) -> None:
    """Build a tote with objects that touch and lie on each other; the camera looks into it from above."""
    rng = draft.rng
    add_room(draft)
    half, height = np.array([rng.uniform(0.24, 0.3), rng.uniform(0.17, 0.2)]), rng.uniform(0.14, 0.2)
    floor_m = 0.42
    draft.add(draft.make("crate", x=0.9, y=0.7, z=floor_m - 0.01), np.eye(4), doubtful=True)
    draft.add(draft.make("tote", half=half, height=height), shift((0, 0, floor_m - 0.01)))
    draft.objects = Arrangement((Surface("tote", floor_m, np.zeros(2), half),), rng)
    first = draft.objects.put(draft.models(1, "in_tote")[0], 0, 0.02, within=0.3)
    assert first is not None, "an empty tote has room"
    for number, model in enumerate(draft.models(7, "in_tote")):
        for k in rng.permutation(len(draft.objects.objects)):
            if draft.objects.put_beside(model, draft.objects.objects[int(k)], 0.0 if number % 2 else 0.01, 0.004):
                break
    draft.waypoints = circling(draft, 0, radius=rng.uniform(0.6, 0.75), height=floor_m + rng.uniform(0.7, 0.9))


def build_counter(draft: Draft) -> None:
    """Build a counter at a wall with thin upright objects, seen from two to three and a half metres."""
    rng = draft.rng
    half_m = 2.6
    add_room(draft, half=half_m)
    height, deep, long = rng.uniform(0.86, 0.94), rng.uniform(0.26, 0.31), rng.uniform(0.9, 1.3)
    surface = Surface("counter", height, np.array([0.0, half_m - deep - 0.01]), np.array([long, deep]))
    draft.add(draft.make("crate", x=2 * long, y=2 * deep, z=height), on_floor(surface))
    draft.objects = Arrangement((surface,), rng)
    draft.fill(0, int(rng.integers(6, 10)), "upright", 0.05, 0.95)
    far = rng.uniform(2.0, 3.2)
    middle = np.array([*surface.center, height + 0.1])
    along = np.linspace(-0.8, 0.8, 9) * (1 if rng.random() < 0.5 else -1)
    eyes = middle + np.column_stack([along, np.full(9, -far), rng.uniform(0.35, 0.6, 9)])
    aims = middle + np.column_stack([0.4 * along, np.zeros(9), np.zeros(9)])
    draft.waypoints = np.column_stack([eyes, aims])


def build_shelf(draft: Draft) -> None:
    """Build shelf compartments with boards that mirror the objects on them; the camera looks in from close by."""
    rng = draft.rng
    half_m, deep, wide = 2.6, 0.36, 0.9
    add_room(draft, half=half_m)
    low, high = rng.uniform(0.7, 0.85), rng.uniform(0.36, 0.42)
    boards = (low, low + high)
    y = half_m - deep / 2 - 0.02
    draft.add(draft.make("bay", x=wide, y=deep, height=low + 2 * high, boards=boards), shift((0, y, 0)))
    surfaces = tuple(
        Surface(f"compartment {k + 1}", board, np.array([side * wide / 4, y]), np.array([wide / 4 - 0.02, deep / 2]))
        for k, (board, side) in enumerate((board, side) for board in boards for side in (-1, 1))
    )
    draft.objects = Arrangement(surfaces, rng)
    for surface in range(len(surfaces)):
        draft.fill(surface, int(rng.integers(2, 4)), "small_and_flat", 0.02, 0.9)
    middle = np.array([0.0, y, low + high / 2])
    along = np.linspace(-0.4, 0.4, 9) * (1 if rng.random() < 0.5 else -1)
    eyes = middle + np.column_stack([along, np.full(9, -rng.uniform(0.8, 1.0)), rng.uniform(0.1, 0.35, 9)])
    aims = middle + np.column_stack([0.6 * along, np.zeros(9), np.zeros(9)])
    draft.waypoints = np.column_stack([eyes, aims])


def build_stacks(draft: Draft) -> None:
    """Build stacks of books, and of flush blocks with equal depth that differ only in color."""
    rng = draft.rng
    add_room(draft)
    add_middle_table(draft)
    books = draft.models(3, ("book",))
    for number, place in enumerate(((-0.45, -0.3), (0.45, -0.25), (0.0, 0.4), (-0.5, 0.45))):
        if number % 2 == 0:
            _pile(draft, place, [books[int(k)] for k in rng.permutation(3)[: int(rng.integers(2, 4))]])
        else:
            x, y = rng.uniform(0.1, 0.18, 2)
            blocks = [draft.make("flush_block", x=x, y=y, z=rng.uniform(0.06, 0.12)) for _ in range(2)]
            _pile(draft, place, blocks)
    draft.waypoints = circling(draft, 0, radius=rng.uniform(0.95, 1.2))


def _pile(draft: Draft, place: tuple[float, float], models: Sequence[Model]) -> None:
    """Stack models on each other."""
    below: SceneObject = draft.objects.put_at(models[0], 0, place)
    for model in models[1:]:
        below = draft.objects.put_on(model, below)
