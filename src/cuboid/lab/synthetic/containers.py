"""Open boxes and trays on a table, with objects in them, on them and beside them."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic.draft import Draft, add_middle_table, add_room, circling, on_floor
from cuboid.lab.synthetic.material import CARD, two_paints
from cuboid.lab.synthetic.placement import Arrangement
from cuboid.lab.synthetic.scene import SceneObject, Surface
from cuboid.lab.synthetic.shapes import turned

# Thickness of the walls and the floor of a container, metres.
CONTAINER_WALL_M = 0.008
# Gap between objects in a container, and to its walls, metres.
CONTENT_GAP_M = 0.012
# Positions of containers, as fractions of the table's half sides.
PLACES = ((-0.5, -0.35), (0.5, -0.3), (0.0, 0.45))


def build_containers(draft: Draft) -> None:
    """Build a table with filled open boxes and trays, a pile, and objects between them."""
    rng = draft.rng
    add_room(draft)
    add_middle_table(draft)
    for place in PLACES[: int(rng.integers(2, 4))]:
        _filled(draft, place)
    flat = draft.objects.put(draft.models(1, ("book",))[0], 0, 0.04, within=0.85)
    if flat is not None:
        draft.objects.put_on(draft.models(1, ("can", "jar"))[0], flat)
    draft.fill(0, 3, "small", 0.04, 0.85)
    table = draft.objects.surfaces[0]
    draft.waypoints = circling(
        draft, 0, radius=rng.uniform(0.85, 1.05), height=table.height_m + rng.uniform(0.75, 0.95)
    )


def build_sideboard(draft: Draft) -> None:
    """Build a sideboard along a wall: objects against the wall, others in front, and a filled open box."""
    rng, half_m = draft.rng, 2.6
    add_room(draft, half=half_m)
    height, deep, long = rng.uniform(0.7, 0.9), rng.uniform(0.22, 0.28), rng.uniform(0.75, 0.9)
    surface = Surface("sideboard", height, np.array([0.0, half_m - deep]), np.array([long, deep]))
    draft.add(draft.make("crate", x=2 * long, y=2 * deep, z=height), on_floor(surface))
    draft.objects = Arrangement((surface,), rng)
    slots = rng.permutation(np.linspace(-0.8, 0.8, 6))
    _filled(draft, (float(slots[0]), -0.25), long_m=0.2)
    for number, slot in enumerate(slots[1:].tolist()):
        (model,) = draft.models(1, "small")
        reach_m = float(np.ptp(model.mesh().vertices[:, 1])) / 2.0
        gap_m = rng.uniform(0.004, 0.02) if number % 2 == 0 else rng.uniform(0.15, 0.2)
        draft.objects.put_at(model, 0, (slot, 1.0 - (gap_m + reach_m) / deep))
    middle = np.array([*surface.center, height + 0.08])
    along = np.linspace(-0.6, 0.6, 9) * (1 if rng.random() < 0.5 else -1)
    eyes = middle + np.column_stack([along, np.full(9, -rng.uniform(1.0, 1.2)), rng.uniform(0.55, 0.8, 9)])
    aims = middle + np.column_stack([0.5 * along, np.zeros(9), np.zeros(9)])
    draft.waypoints = np.column_stack([eyes, aims])


def _filled(draft: Draft, place: tuple[float, float], long_m: float = 0.29) -> None:
    """Place a container of about this length at a random free yaw angle, with objects in it."""
    rng = draft.rng
    inner = np.array([long_m + rng.uniform(-0.05, 0.05), 0.72 * long_m + rng.uniform(-0.03, 0.03)])
    height, angle = float(rng.uniform(0.04, 0.14)), float(rng.uniform(0, np.pi))
    colors = two_paints(rng) if rng.random() < 0.5 else CARD
    box = draft.make("open_box", inner=(*inner, height), wall=CONTAINER_WALL_M, colors=colors)
    container = draft.objects.put_at(turned(box, angle), 0, place)
    floor = _floor_of(container, draft.objects.surfaces[0].height_m, inner, angle)
    for model in draft.models(int(rng.integers(1, 4)), "in_container"):
        draft.objects.put_in(model, container, floor, CONTENT_GAP_M)


def _floor_of(container: SceneObject, table_m: float, inner: Float64Array, angle_rad: float) -> Surface:
    return Surface("container", table_m + CONTAINER_WALL_M, container.T_room_model[:2, 3], inner / 2.0, angle_rad)
