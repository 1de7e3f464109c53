"""Procedural models of things, by family; each maker is a function of a random generator."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from cuboid.lab.synthetic.shapes.basic import MAKERS
from cuboid.lab.synthetic.shapes.model import Maker, Model, turned
from cuboid.lab.synthetic.shapes.office import OFFICE
from cuboid.lab.synthetic.shapes.paper import PAPER
from cuboid.lab.synthetic.shapes.soft import SOFT
from cuboid.lab.synthetic.shapes.tableware import TABLEWARE
from cuboid.lab.synthetic.shapes.toys import TOYS
from cuboid.lab.synthetic.shapes.vessels import VESSELS

# All makers by name; the first kinds of scenes draw from `MAKERS` alone.
CATALOGUE: Mapping[str, Maker] = MappingProxyType({**MAKERS, **VESSELS, **TABLEWARE, **OFFICE, **PAPER, **SOFT, **TOYS})

__all__ = ["CATALOGUE", "MAKERS", "Maker", "Model", "turned"]
