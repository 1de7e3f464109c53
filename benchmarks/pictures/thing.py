"""A thing: what is drawn of it, and the convex bodies by which it touches others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from meshes import DARK, MATT, SHINY, Color, Floats, Part, Rng, hull

# Plastic and metal in dark colors that a depth sensor reads badly.
BLACK: Color = (0.05, 0.05, 0.055)
STEEL: Color = (0.62, 0.63, 0.65)


@dataclass(frozen=True)
class Thing:
    """Parts of one thing and the convex bodies by which it touches others.

    Attributes
    ----------
    parts : tuple of Part
    colliders : tuple of array, shape (n, 3)
        Corners of convex bodies, metres, in the frame of the parts.
    inside : tuple of float, or None
        Half width, half depth, floor and rim height of the space in a container, metres.
    flat : bool
        Others can stand on it.
    """

    parts: tuple[Part, ...]
    colliders: tuple[Floats, ...]
    inside: tuple[float, float, float, float] | None = None
    flat: bool = False

    def points(self) -> Floats:
        """Return the corners of all colliders, shape (n, 3)."""
        return np.concatenate(self.colliders)

    def size(self) -> Floats:
        """Return the extent along x, y and z, metres."""
        points = self.points()
        return np.asarray(points.max(0) - points.min(0))


# A function that makes a thing of a color.
Maker = Callable[[Rng, Color], Thing]


def solid(*parts: Part, flat: bool = False) -> Thing:
    """Return a thing that touches others by its convex hull."""
    return Thing(parts, (hull(parts),), None, flat)


def compound(*parts: Part, flat: bool = False) -> Thing:
    """Return a thing that touches others by the convex hull of each part."""
    return Thing(parts, tuple(hull([p]) for p in parts), None, flat)


def random_finish(rng: Rng, color: Color) -> int:
    if max(color) < 0.16:
        return DARK if rng.random() < 0.6 else MATT
    return SHINY if rng.random() < 0.12 else MATT
