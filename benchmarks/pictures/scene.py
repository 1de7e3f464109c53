"""A scene: bodies with labels in a room, and the places to look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from meshes import Floats, Part, Rng, Vector, hull, rotation
from thing import Thing

# Label of pixels in masks: things are 1, 2, ...
STRUCTURE, IGNORE = 0, 65535


@dataclass
class Body:
    """A rigid body. `label` STRUCTURE, IGNORE or 1 (a thing, numbered later); `falls`: physics moves it."""

    parts: Sequence[Part]
    colliders: Sequence[Floats]
    label: int
    position: Floats
    turn: Floats
    falls: bool


@dataclass(frozen=True)
class Focus:
    """A place to look at.

    Attributes
    ----------
    point, radius_m : array, shape (3,), and float
        Targets lie around the point, within the radius in x and y.
    azimuth_deg : tuple of float
        Directions from the target to the camera: middle and half range; 0 is along +x.
    modes : dict
        Weight of each kind of view (see picture_scenes.VIEWS).
    """

    point: Floats
    radius_m: float
    azimuth_deg: tuple[float, float] = (0.0, 180.0)
    modes: dict[str, float] = field(
        default_factory=lambda: {"hand": 4, "overhead": 1.5, "grazing": 1.5, "close": 2, "far": 1}
    )


class Scene:
    """Bodies in a room with z up and the floor at z = 0, metres."""

    def __init__(self, rng: Rng) -> None:
        self.rng = rng
        self.bodies: list[Body] = []
        self.focuses: list[Focus] = []
        self.bounds = np.array([[-3.0, -3.0, 0.0], [3.0, 3.0, 2.5]])

    def add(
        self,
        thing: Thing | Sequence[Part],
        at: Vector,
        label: int = STRUCTURE,
        turn: Floats | float = 0.0,
        falls: bool = False,
    ) -> None:
        """Add a body at a position in metres, turned by a matrix (3, 3) or by degrees about z."""
        matrix = turn if isinstance(turn, np.ndarray) else rotation("z", turn)
        parts = thing.parts if isinstance(thing, Thing) else thing
        colliders = thing.colliders if isinstance(thing, Thing) else [hull([p]) for p in parts]
        self.bodies.append(Body(parts, colliders, label, np.asarray(at, float), matrix, falls))

    def put(self, thing: Thing, at: Vector, turn: Floats | float = 0.0, falls: bool = True) -> None:
        """Add a thing that gets a number of its own."""
        self.add(thing, at, 1, turn, falls)
