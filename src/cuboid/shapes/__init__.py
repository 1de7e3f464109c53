"""The surface of an object, from its views: depth fused around it, as a mesh with colors."""

from __future__ import annotations

from cuboid.shapes.building import object_mesh
from cuboid.shapes.mesh import ObjectMesh
from cuboid.shapes.views import ObjectView

__all__ = ["ObjectMesh", "ObjectView", "object_mesh"]
