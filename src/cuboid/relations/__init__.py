"""Spatial relations between objects and surfaces: on, in, beside, under, against and supports, each with a score."""

from __future__ import annotations

from cuboid.core.results import Wall
from cuboid.relations.finding import find_relations
from cuboid.relations.tree import Branch, place_tree
from cuboid.relations.walls import find_walls

__all__ = ["Branch", "Wall", "find_relations", "find_walls", "place_tree"]
