"""Colors of a mesh's vertices: means over the views; near and frontal views have the largest weight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.tolerances import JUMP_M
from cuboid.ground.geometry import se3
from cuboid.method.shapes.mesh import ObjectMesh
from cuboid.method.shapes.views import ObjectView, pixels_of

# Exponent of the cosine of the viewing angle in a view's weight: frontal views dominate, grazing views count little.
SHARPNESS = 4


def colors_of(mesh: ObjectMesh, views: Sequence[ObjectView], otherwise: Float64Array) -> UInt8Array:
    """Return the colors (V, 3) of a mesh's vertices.

    Parameters
    ----------
    mesh : ObjectMesh
    views : sequence of ObjectView
    otherwise : (3,) float64
        The color, 0..255, of vertices that no view sees.
    """
    total, weights = np.zeros((len(mesh.vertices), 3)), np.zeros(len(mesh.vertices))
    normals = _normals(mesh)
    for view in views:
        _add(mesh.vertices, normals, view, total, weights)
    seen = weights > 0
    rgb = np.where(seen[:, None], total / np.maximum(weights, 1e-12)[:, None], otherwise)
    return np.rint(rgb).astype(np.uint8)


def _add(vertices: Float64Array, normals: Float64Array, view: ObjectView, total: Float64Array, w: Float64Array) -> None:
    x, y, z = se3.transform(se3.inverse(view.T_world_camera), vertices).T
    u, v, inside = pixels_of(view.camera, x, y, z)
    rows = np.flatnonzero(inside)
    u, v, z = u[rows], v[rows], z[rows]
    shown = np.abs(view.depth_m[v, u] - z) < JUMP_M
    u, v, rows = u[shown], v[shown], rows[shown]
    towards = view.T_world_camera[:3, 3] - vertices[rows]
    distance = np.linalg.norm(towards, axis=1)
    cosine = np.einsum("ij,ij->i", towards, normals[rows]) / np.maximum(distance, 1e-9)
    front = cosine > 0
    weight = cosine[front] ** SHARPNESS / distance[front] ** 2
    total[rows[front]] += weight[:, None] * view.color[v[front], u[front]]
    w[rows[front]] += weight


def _normals(mesh: ObjectMesh) -> Float64Array:
    """Return the unit normal of each vertex (V, 3): the area-weighted mean of its faces' normals."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    of_face = np.cross(b - a, c - a)
    normals = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(normals, mesh.faces[:, k], of_face)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    result: Float64Array = normals / np.maximum(length, 1e-12)
    return result
