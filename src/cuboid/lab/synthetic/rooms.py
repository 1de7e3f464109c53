"""Rooms with fittings, and cameras in front of a wall, which several kinds share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic.draft import ROOM_HALF_M, Draft, add_shell
from cuboid.lab.synthetic.material import Color
from cuboid.lab.synthetic.mesh import shift, turn
from cuboid.lab.synthetic.paths import around
from cuboid.lab.synthetic.shapes.model import Model, choice

# Colors of plain floors and boxes.
PLAIN: tuple[Color, ...] = ((0.92, 0.92, 0.91), (0.78, 0.78, 0.77), (0.80, 0.75, 0.66), (0.62, 0.64, 0.66))
# Names of models that may count as one object or as several: they count neither way.
UNDECIDED = ("row of books", "pile of books", "pile of plates", "toy blocks", "letter trays")


def add_home(draft: Draft, *, pictures: bool = True) -> None:
    """Add a room with a door and sockets; `pictures` tells whether its wall at +y has any."""
    _add_fitted(draft, draft.make("floor", half=ROOM_HALF_M + 0.1), pictures)


def add_plain_room(draft: Draft) -> Color:
    """Add a room with a door and sockets whose floor has one color, and return the color."""
    color = choice(draft.rng, PLAIN)
    _add_fitted(draft, draft.make("plain_floor", half=ROOM_HALF_M + 0.1, color=color), pictures=True)
    return color


def _add_fitted(draft: Draft, floor: Model, pictures: bool) -> None:
    rng, half = draft.rng, ROOM_HALF_M
    add_shell(draft, floor, half, pictures=pictures)
    side = choice(rng, (1, 3))
    draft.add(draft.make("door"), turn(side * np.pi / 2) @ shift((rng.uniform(-0.3, 0.3), half, 0)))
    for k in (0, 1, 3):
        place = shift((rng.uniform(1.0, 2.0) * choice(rng, (-1, 1)), half, rng.uniform(0.25, 0.35)))
        draft.add(draft.make("socket"), turn(k * np.pi / 2) @ place)


def count_neither_way(draft: Draft) -> None:
    """Mark the placed objects of the names `UNDECIDED` as counting neither way."""
    draft.objects.not_judged(*(body.id for body in draft.objects.objects if body.model.name in UNDECIDED))


def in_front(
    draft: Draft, middle: Sequence[float] | Float64Array, distance: float, level: float, spread_rad: float
) -> Float64Array:
    """Return waypoints on an arc in front of a place (3,) at a wall at +y, of a hand that also goes up, down and near.

    `level` is the mean height above the floor.
    """
    rng, count = draft.rng, 10
    angles = -np.pi / 2 + np.linspace(-spread_rad, spread_rad, count) * choice(rng, (-1, 1))
    waypoints = around(
        middle, angles, distance + rng.uniform(-0.12, 0.12, count), level + rng.uniform(-0.1, 0.1, count)
    )
    waypoints[:, 3] += 0.35 * (waypoints[:, 0] - middle[0])
    return waypoints
