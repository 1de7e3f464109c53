"""Procedural models of things: each maker is a function of a random generator."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from cuboid.lab.synthetic.shapes.model import Maker, Model, choice, turned
from cuboid.lab.synthetic.shapes.table import build, families, sets

# All makers by name; the first kinds of scenes draw from `MAKERS` alone.
CATALOGUE: Mapping[str, Maker] = {name: partial(build, name) for names in families().values() for name in names}
MAKERS: Mapping[str, Maker] = {name: CATALOGUE[name] for name in families()["basic"]}

__all__ = ["CATALOGUE", "MAKERS", "Maker", "Model", "build", "choice", "sets", "turned"]
