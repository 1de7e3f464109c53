"""The surface of an object as a colored mesh, from the fused depth of its views."""

from __future__ import annotations

from cuboid.method.shapes.building import object_mesh
from cuboid.method.shapes.mesh import ObjectMesh
from cuboid.method.shapes.views import ObjectView

__all__ = ["ObjectMesh", "ObjectView", "object_mesh"]
