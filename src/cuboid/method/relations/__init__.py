"""Spatial relations between objects and surfaces: on, in, beside, under, against and supports, each with a score."""

from __future__ import annotations

from cuboid.ground.core.results import Wall
from cuboid.method.relations.finding import find_relations
from cuboid.method.relations.levels import SurfaceKind, surface_kinds
from cuboid.method.relations.tree import Branch, place_tree
from cuboid.method.relations.walls import find_walls

__all__ = ["Branch", "SurfaceKind", "Wall", "find_relations", "find_walls", "place_tree", "surface_kinds"]
