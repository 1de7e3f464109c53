"""Triangle meshes and functions that generate them: lathe, prism, tube, grid; metres, z up."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry import se3

Faces = npt.NDArray[np.int32]

# Maximum angle between neighbouring faces that are shaded as one smooth surface, degrees.
CREASE_DEG = 38.0
# Corners closer than this are one vertex, metres.
WELD_M = 1e-6
# Corners of the cross-section of a tube.
TUBE_SEGMENTS = 14


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles.

    Attributes
    ----------
    vertices : (V, 3) float64
        Metres.
    faces : (F, 3) int32
        Rows of `vertices`, counter-clockwise seen from outside.
    """

    vertices: Float64Array
    faces: Faces

    def moved(self, T: npt.ArrayLike) -> Mesh:
        """Return the mesh transformed by a (4, 4) motion (or a scale without mirror)."""
        return Mesh(se3.transform(T, self.vertices), self.faces)

    def corners(self) -> Float64Array:
        """Return the corners of each face, (F, 3, 3)."""
        corners: Float64Array = self.vertices[self.faces]
        return corners

    def area_normals(self) -> Float64Array:
        """Return the normal of each face (F, 3), with twice the face's area (square metres) as length."""
        a, b, c = np.moveaxis(self.corners(), 1, 0)
        normals: Float64Array = np.cross(b - a, c - a)
        return normals


def merged(meshes: Iterable[Mesh]) -> Mesh:
    """Return several meshes as one."""
    vertices: list[Float64Array] = []
    faces: list[Faces] = []
    count = 0
    for mesh in meshes:
        vertices.append(mesh.vertices)
        faces.append((mesh.faces + count).astype(np.int32))
        count += len(mesh.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def box(size: Sequence[float], bottom_center: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Return a box of `size` (x, y, z) whose bottom face has its centre at `bottom_center`."""
    x, y = size[0] / 2, size[1] / 2
    return prism([(-x, -y), (x, -y), (x, y), (-x, y)], size[2]).moved(shift(bottom_center))


def prism(outline: npt.ArrayLike, height: float) -> Mesh:
    """Return an upright prism over a star-shaped outline (K, 2), counter-clockwise, around (0, 0)."""
    ring = np.asarray(outline, np.float64)
    count = len(ring)
    low = np.column_stack([ring, np.zeros(count)])
    high = np.column_stack([ring, np.full(count, height)])
    vertices = np.concatenate([low, high, [[0, 0, 0], [0, 0, height]]])
    k = np.arange(count)
    n = (k + 1) % count
    faces = np.concatenate(
        [
            np.column_stack([k, n, n + count]),
            np.column_stack([k, n + count, k + count]),
            np.column_stack([n, k, np.full(count, 2 * count)]),
            np.column_stack([k + count, n + count, np.full(count, 2 * count + 1)]),
        ]
    )
    return Mesh(vertices, faces.astype(np.int32))


def lathe(profile: npt.ArrayLike, segments: int = 48) -> Mesh:
    """Return the surface of revolution around z of a profile (K, 2) of radius and height.

    The outside lies to the right of the profile's direction: up on the outer wall, down on the inner one.
    """
    radius, height = np.asarray(profile, np.float64).T
    angle = np.arange(segments) * (2 * np.pi / segments)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    rings = np.empty((len(radius), segments, 3))
    rings[..., :2] = radius[:, None, None] * circle
    rings[..., 2] = height[:, None]
    return without_slivers(Mesh(rings.reshape(-1, 3), strip_faces(len(radius), segments, wrap=True)))


def tube(path: npt.ArrayLike, radius: npt.ArrayLike) -> Mesh:
    """Return a round tube along a path (K, 3) in the x-z plane; `radius` is a number or (K,)."""
    line, segments = np.asarray(path, np.float64), TUBE_SEGMENTS
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.array([0.0, 1.0, 0.0])
    other = np.cross(side, tangent)
    angle = np.arange(segments) * (2 * np.pi / segments)
    around = np.cos(angle)[:, None, None] * other + np.sin(angle)[:, None, None] * side
    radii = np.broadcast_to(np.asarray(radius, np.float64), len(line))
    rings = line[:, None] + radii[:, None, None] * np.moveaxis(around, 0, 1)
    first, last = np.broadcast_to(line[0], (segments, 3)), np.broadcast_to(line[-1], (segments, 3))
    vertices = np.concatenate([first, rings.reshape(-1, 3), last])
    return without_slivers(Mesh(vertices, strip_faces(len(line) + 2, segments, wrap=True)))


def grid(points: npt.ArrayLike) -> Mesh:
    """Return the sheet through a grid of points (A, B, 3); its outside is (direction of B) x (direction of A)."""
    sheet = np.asarray(points, np.float64)
    return Mesh(sheet.reshape(-1, 3), strip_faces(sheet.shape[0], sheet.shape[1], wrap=False))


def corner_normals(mesh: Mesh) -> Float64Array:
    """Return the shading normal of each corner of each face, (F, 3, 3), smooth up to creases.

    A corner's normal is the area-weighted mean over the faces around its vertex whose angle to the corner's own face is
    below `CREASE_DEG`.
    """
    normals = mesh.area_normals()
    units = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    keys = np.round(mesh.vertices / WELD_M).astype(np.int64)
    _, vertex = np.unique(keys, axis=0, return_inverse=True)
    at = vertex.reshape(-1)[mesh.faces].reshape(-1)  # the welded vertex of each corner
    order = np.argsort(at, kind="stable")
    starts = np.searchsorted(at[order], at)
    counts = np.bincount(at)[at]
    result = np.zeros((len(at), 3))
    face = np.arange(len(at)) // 3
    cosine = np.cos(np.radians(CREASE_DEG))
    for k in range(int(counts.max())):
        here = np.flatnonzero(counts > k)
        other = order[starts[here] + k] // 3
        smooth = np.einsum("ij,ij->i", units[face[here]], units[other]) > cosine
        result[here[smooth]] += normals[other[smooth]]
    length = np.linalg.norm(result, axis=1, keepdims=True)
    smooth_normals: Float64Array = np.where(length > 1e-30, result / np.maximum(length, 1e-30), units[face])
    return smooth_normals.reshape(-1, 3, 3)


def sample_surface(mesh: Mesh, count: int, rng: np.random.Generator) -> tuple[Float64Array, Float64Array]:
    """Return `count` points spread evenly over the surface (count, 3), and their normals (count, 3)."""
    normals = mesh.area_normals()
    area = np.linalg.norm(normals, axis=1)
    steps = (np.arange(count) + rng.random(count)) / count
    face = np.searchsorted(np.cumsum(area) / area.sum(), steps).clip(max=len(area) - 1)
    root, v = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    a, b, c = np.moveaxis(mesh.corners()[face], 1, 0)
    return (1 - root) * a + root * (1 - v) * b + root * v * c, normals[face] / area[face, None]


def shift(translation: Sequence[float] | Float64Array) -> Float64Array:
    """Return the translation by (3,) metres as a (4, 4) motion."""
    T = np.eye(4)
    T[:3, 3] = translation
    return T


def turn(angle_rad: float, axis: int = 2) -> Float64Array:
    """Return the (4, 4) rotation about the x (0), y (1) or z (2) axis."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    T = np.eye(4)
    T[a, a] = T[b, b] = np.cos(angle_rad)
    T[b, a] = np.sin(angle_rad)
    T[a, b] = -np.sin(angle_rad)
    return T


def strip_faces(rows: int, columns: int, *, wrap: bool) -> Faces:
    """Return the faces of a grid of vertices; with `wrap` the last column is joined to the first."""
    a, b = np.meshgrid(np.arange(rows - 1), np.arange(columns if wrap else columns - 1), indexing="ij")
    right = (b + 1) % columns
    low, low_right = a * columns + b, a * columns + right
    high, high_right = low + columns, low_right + columns
    first = np.stack([low, low_right, high_right], axis=-1).reshape(-1, 3)
    second = np.stack([low, high_right, high], axis=-1).reshape(-1, 3)
    return np.concatenate([first, second]).astype(np.int32)


def without_slivers(mesh: Mesh) -> Mesh:
    """Remove faces without area, which a ring shrunk to a point leaves, and unused vertices."""
    kept = mesh.faces[np.linalg.norm(mesh.area_normals(), axis=1) > 1e-14]
    used, faces = np.unique(kept, return_inverse=True)
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3).astype(np.int32))
