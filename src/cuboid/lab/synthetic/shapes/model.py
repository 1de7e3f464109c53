"""A model of a body: meshes with materials, made by a function of a random generator.

A model stands on z = 0 around the origin; sizes are those of household objects, metres.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from cuboid.lab.synthetic.material import Material
from cuboid.lab.synthetic.mesh import Mesh, merged, shift, turn


@dataclass(frozen=True, slots=True)
class Model:
    """A body of parts, each with a material, standing on z = 0.

    Attributes
    ----------
    name : str
    parts : tuple of (Mesh, Material)
    """

    name: str
    parts: tuple[tuple[Mesh, Material], ...]

    def mesh(self) -> Mesh:
        """Return all parts as one mesh."""
        return merged(mesh for mesh, _ in self.parts)

    def moved(self, T: npt.ArrayLike) -> Model:
        """Return the model transformed by a (4, 4) motion."""
        return Model(self.name, tuple((mesh.moved(T), look) for mesh, look in self.parts))


Maker = Callable[[np.random.Generator], Model]


def turned(model: Model, angle_rad: float) -> Model:
    """Return the model rotated about its vertical axis."""
    return model.moved(turn(angle_rad))


def standing(name: str, *parts: tuple[Mesh, Material]) -> Model:
    """Return a model of these parts, shifted so that it stands on z = 0 with its middle above the origin."""
    vertices = np.concatenate([mesh.vertices for mesh, _ in parts])
    low, high = vertices.min(0), vertices.max(0)
    return Model(name, parts).moved(shift((*(-(low + high)[:2] / 2), -low[2])))


Option = TypeVar("Option")


def choice(rng: np.random.Generator, options: Sequence[Option]) -> Option:
    """Return one of the options."""
    return options[int(rng.integers(len(options)))]
