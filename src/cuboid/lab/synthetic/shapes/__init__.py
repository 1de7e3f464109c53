"""Procedural models of things, by family; each maker is a function of a random generator."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from cuboid.lab.synthetic.shapes import procedural
from cuboid.lab.synthetic.shapes.model import Maker, Model, choice, standing, turned
from cuboid.lab.synthetic.shapes.table import build, families


def _makers(names: list[str]) -> dict[str, Maker]:
    return {name: getattr(procedural, name, None) or partial(build, name) for name in names}


FAMILIES: Mapping[str, Mapping[str, Maker]] = {family: _makers(names) for family, names in families().items()}
# All makers by name; the first kinds of scenes draw from `MAKERS` alone.
MAKERS = FAMILIES["basic"]
CATALOGUE: Mapping[str, Maker] = {name: maker for makers in FAMILIES.values() for name, maker in makers.items()}

__all__ = ["CATALOGUE", "FAMILIES", "MAKERS", "Maker", "Model", "build", "choice", "standing", "turned"]
