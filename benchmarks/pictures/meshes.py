"""Triangle meshes with texture coordinates: boxes, lathe shapes, ellipsoids, tubes.

A shape stands on z = 0 in its own frame, metres, z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]
Rng = np.random.Generator
T = TypeVar("T")
# Three numbers.
Vector = Sequence[float] | Floats
Color = tuple[float, float, float]
# Light is computed at the vertices of a mesh: large sides are divided into cells of about this size, metres.
CELL_M = 0.25
# What a depth sensor makes of a material.
MATT, DARK, SHINY, SCREEN, GLASS = range(5)


def pick(rng: Rng, options: Sequence[T]) -> T:
    """Return one of some options."""
    return options[int(rng.integers(len(options)))]


@dataclass(frozen=True)
class Part:
    """A textured mesh of one material.

    Attributes
    ----------
    vertices, faces : arrays, shape (n, 3), metres, and (m, 3), indices
    uv, uv_faces : arrays, shape (k, 2) and (m, 3), or None
        Texture coordinates and, for each corner of a face, its index in `uv` (None: the index of the vertex).
    texture : array, shape (h, w, 3), RGB, or None
    color : tuple of float
        RGB factor, 0 to 1.
    finish : int
        MATT, DARK, SHINY, SCREEN or GLASS.
    """

    vertices: Floats
    faces: npt.NDArray[np.int64]
    uv: Floats | None = None
    uv_faces: npt.NDArray[np.int64] | None = None
    texture: Image | None = None
    color: Color = (1.0, 1.0, 1.0)
    finish: int = MATT

    def moved(self, offset: Vector = (0, 0, 0), rotation: Floats | None = None) -> Part:
        """Return the part turned by a rotation (3, 3), then moved by an offset in metres."""
        turned = self.vertices if rotation is None else self.vertices @ rotation.T
        return replace(self, vertices=turned + np.asarray(offset, float))


def rotation(axis: str, degrees: float) -> Floats:
    """Return the rotation (3, 3) about an axis "x", "y" or "z"."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    plane = [k for k in range(3) if k != "xyz".index(axis)]
    matrix = np.eye(3)
    matrix[np.ix_(plane, plane)] = [[c, s], [-s, c]] if axis == "y" else [[c, -s], [s, c]]
    return matrix


def _grid_faces(rows: int, columns: int) -> npt.NDArray[np.int64]:
    """Return the triangles of a grid of vertices; the columns run counter-clockwise, the rows upward."""
    i, j = (x.ravel() for x in np.mgrid[: rows - 1, : columns - 1])
    a, b = i * columns + j, i * columns + j + 1
    return np.concatenate([np.stack([a, b, b + columns], 1), np.stack([a, b + columns, a + columns], 1)])


Rectangle = tuple[float, float, float, float]
# Texture rectangle (u0, v0, u1, v1) of the sides along x, y and z: a package's, and the whole texture on each side.
PRINT = ((0.7, 0.0, 1.0, 1.0), (0.0, 0.0, 0.7, 1.0), (0.71, 0.02, 0.99, 0.2))
WHOLE = ((0.0, 0.0, 1.0, 1.0),) * 3


def box(
    size: Vector,
    texture: Image | None = None,
    color: Color = (1, 1, 1),
    finish: int = MATT,
    rectangles: Sequence[Rectangle] = PRINT,
    tile_m: float | None = None,
) -> Part:
    """Return a box on z = 0 around z; its sides show rectangles of a texture, or repeat it every `tile_m` metres."""
    half = np.asarray(size, float) / 2
    vertices, faces, uv, first = [], [], [], 0
    for axis in range(3):
        a, b = ((1, 2), (0, 2), (0, 1))[axis]
        u0, v0, u1, v1 = rectangles[axis]
        cells = [int(np.clip(np.ceil(2 * half[k] / CELL_M), 1, 16)) for k in (a, b)]
        t, s = np.meshgrid(*(np.linspace(0, 1, n + 1) for n in cells[::-1]), indexing="ij")
        for sign in (1, -1):
            outward = sign * (-1 if axis == 1 else 1)
            corners = np.empty((s.size, 3))
            corners[:, axis] = sign * half[axis]
            corners[:, a], corners[:, b] = ((2 * x.ravel() - 1) * half[k] for x, k in ((s, a), (t, b)))
            across = s if outward > 0 else 1 - s
            if tile_m:
                uv.append(np.stack([across * 2 * half[a] / tile_m, t * 2 * half[b] / tile_m], -1).reshape(-1, 2))
            else:
                uv.append(np.stack([u0 + across * (u1 - u0), v1 - t * (v1 - v0)], -1).reshape(-1, 2))
            vertices.append(corners + np.array([0, 0, half[2]]))
            faces.append(first + _grid_faces(cells[1] + 1, cells[0] + 1)[:, ::outward])
            first += len(corners)
    return Part(np.concatenate(vertices), np.concatenate(faces), np.concatenate(uv), None, texture, color, finish)


def lathe(
    profile: Sequence[tuple[float, float]],
    texture: Image | None = None,
    color: Color = (1, 1, 1),
    finish: int = MATT,
    sides: int = 28,
) -> Part:
    """Return a surface of revolution about z of a profile of (radius, z), metres, from the bottom along the outside."""
    r, z = np.array(profile, float).T
    r = np.maximum(r, 2e-4)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    rows = np.stack([r[:, None] * np.cos(angle), r[:, None] * np.sin(angle), np.repeat(z[:, None], sides + 1, 1)], -1)
    length = np.r_[0, np.cumsum(np.hypot(np.diff(r), np.diff(z)))]
    uv = np.stack(np.meshgrid(angle / (2 * np.pi), 1 - length / length[-1]), -1)
    return Part(rows.reshape(-1, 3), _grid_faces(len(r), sides + 1), uv.reshape(-1, 2), None, texture, color, finish)


def ellipsoid(
    radii: Vector,
    texture: Image | None = None,
    color: Color = (1, 1, 1),
    finish: int = MATT,
    dents: float = 0.0,
    rng: Rng | None = None,
) -> Part:
    """Return an ellipsoid on z = 0; `dents` is the relative depth of smooth deformations."""
    t = np.linspace(-np.pi / 2, np.pi / 2, 15)
    ball = lathe([(float(np.cos(x)), float(np.sin(x))) for x in t], texture, color, finish)
    vertices = ball.vertices
    if dents and rng is not None:
        waves = rng.normal(0, 2.0, (3, 4))
        vertices = vertices * (1 + dents * np.sin(vertices @ waves + rng.uniform(0, 6, 4)).mean(1, keepdims=True))
    vertices = vertices * np.asarray(radii)
    return replace(ball, vertices=vertices - [0, 0, vertices[:, 2].min()])


def tube(
    path: npt.ArrayLike,
    radius: npt.ArrayLike,
    color: Color = (1, 1, 1),
    finish: int = MATT,
    texture: Image | None = None,
    sides: int = 12,
) -> Part:
    """Return a tube with round ends along a path (n, 3), metres, with one radius or one for each point."""
    points = np.asarray(path, float)
    radii = np.broadcast_to(np.asarray(radius, float), len(points))
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-9
    side = np.cross(along, [0.0, 0, 1] if abs(along[:, 2]).max() < 0.9 else [0.31, 0.95, 0.05])
    side /= np.linalg.norm(side, axis=1, keepdims=True) + 1e-9
    other = np.cross(along, side)
    caps = ((-0.9, 0.4), (-0.5, 0.85))
    rings = [(points[0] + along[0] * radii[0] * a, radii[0] * b, 0) for a, b in ((-1.0, 0.01), *caps)]
    rings += [(points[k], radii[k], k) for k in range(len(points))]
    rings += [
        (points[-1] - along[-1] * radii[-1] * a, radii[-1] * b, len(points) - 1) for a, b in (*caps[::-1], (-1.0, 0.01))
    ]
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    rows = [p + r * (np.cos(angle)[:, None] * side[k] + np.sin(angle)[:, None] * other[k]) for p, r, k in rings]
    uv = np.stack(np.meshgrid(angle / 6.29, np.linspace(0, 1, len(rings))), -1).reshape(-1, 2)
    faces = _grid_faces(len(rings), sides + 1)[:, ::-1]
    return Part(np.concatenate(rows), faces, uv, None, texture, color, finish)


def hull(parts: Sequence[Part]) -> Floats:
    """Return the corners of the convex hull of parts, shape (n, 3)."""
    points = np.concatenate([p.vertices for p in parts])
    return points[ConvexHull(points, qhull_options="QJ").vertices]
