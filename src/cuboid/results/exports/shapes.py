"""The scene that all exports of shapes write: one mesh per object, its collision bodies and its name; z is up."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import require
from cuboid.ground.core.palette import UNLABELLED
from cuboid.ground.core.results import SupportPlane, TrackedObject
from cuboid.ground.geometry import se3
from cuboid.method.shapes.mesh import EXTRA, ObjectMesh
from cuboid.results.files import Results

NONE, BOX, HULL, PARTS = "none", "box", "hull", "parts"
# Values of `--collision`.
COLLISION = (NONE, BOX, HULL, PARTS)
# Vertices of a convex part: simulators allow 64 and more.
HULL_VERTICES = 64
# `parts`: coacd's own measure of how concave a part may stay, and a limit of their number.
CONCAVITY, MAX_PARTS = 0.05, 16
# Color of faces that are guessed: no object is like it.
GUESSED_RGB = (230, 60, 230)
# Turns z up into y up.
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """An object with its mesh, in its own frame: the origin in the middle of its foot, z up, axes along its box.

    Attributes
    ----------
    item : TrackedObject
    name : str
        Node name: "object_003_cup".
    T_scene_body : (4, 4) float64
    mesh : ObjectMesh
        In its own frame, metres.
    collision : list of ((V, 3) float64, (F, 3) int)
        Convex meshes in its own frame.
    """

    item: TrackedObject
    name: str
    T_scene_body: Float64Array
    mesh: ObjectMesh
    collision: list[tuple[Float64Array, npt.NDArray[np.int64]]]

    @property
    def size_m(self) -> Float64Array:
        """Size of its box, (3,)."""
        return self.item.box.size

    def parts(self) -> Iterator[tuple[str, ObjectMesh]]:
        """Iterate over the parts of its mesh that have faces, by what is added to the node's name: seen, guessed."""
        guessed = self.mesh.guessed_faces
        if not guessed.all():
            yield "", self.mesh.part(~guessed)
        if guessed.any():
            part = self.mesh.part(guessed)
            yield "_guessed", replace(part, rgb=_tiled(GUESSED_RGB, len(part.vertices)))


@dataclass(frozen=True, slots=True, eq=False)
class ShapeScene:
    """All objects with a mesh, and their supports, in a world whose z is up; metres.

    Attributes
    ----------
    T_scene_world : (4, 4) float64
        The turn from the world of the results.
    bodies : list of Body
    planes : list of ((V, 3) float64, (F, 3) int)
        The convex outline of each supporting plane.
    notes : list of str
        What the user should read.
    """

    T_scene_world: Float64Array
    bodies: list[Body]
    planes: list[tuple[Float64Array, npt.NDArray[np.int64]]]
    notes: list[str]


def shape_scene(run: Results, *, close: bool = False, complete: bool = False, collision: str = NONE) -> ShapeScene:
    """Return the meshes of all objects of results, ready to be written.

    Parameters
    ----------
    run : Results
    close, complete : bool
        As of `MapQueries.mesh`.
    collision : str
        Of `COLLISION`: bodies for simulators beside each mesh.

    Raises
    ------
    InputError
        There are no views of the objects, or `collision` is none of these words.
    MissingExtraError
        scikit-image, trimesh or coacd is not installed.
    """
    if collision not in COLLISION:
        raise InputError(f"collision must be one of {', '.join(COLLISION)}, got '{collision}'")
    T_scene_world = upright(run.up)
    bodies, without_surface = [], []
    digits = max(3, len(str(max((item.label for item in run.found.objects), default=0))))
    for item in run.found.objects:
        mesh = run.mesh(item.label, close=close, complete=complete)
        if not len(mesh.faces):
            without_surface.append(f"#{item.label}")
            continue
        T_world_body = np.eye(4)
        T_world_body[:3, :3] = item.box.rotation
        T_world_body[:3, 3] = item.box.center - item.box.up * item.box.size[2] / 2.0
        local = mesh.moved(se3.inverse(T_world_body))
        name = node_name(item, digits)
        bodies.append(Body(item, name, T_scene_world @ T_world_body, local, collision_of(local, item, collision)))
    notes = [f"no view shows a surface of {', '.join(without_surface)}: left out"] if without_surface else []
    return ShapeScene(T_scene_world, bodies, [_outline(plane, T_scene_world) for plane in run.planes], notes)


def node_name(item: TrackedObject, digits: int = 3) -> str:
    """Return the name of an object's node: its label, and its name in letters that every format allows."""
    plain = re.sub(r"[^A-Za-z0-9]+", "_", item.name or "").strip("_")
    return f"object_{item.label:0{digits}d}" + (f"_{plain}" if plain else "")


def upright(up: Float64Array | None) -> Float64Array:
    """Return the smallest turn (4, 4) that makes up the z axis; none where up is unknown."""
    T = np.eye(4)
    if up is None:
        return T
    axis = np.cross(up, (0.0, 0.0, 1.0))
    sine, cosine = float(np.linalg.norm(axis)), float(up[2])
    if sine < 1e-9:
        return T if cosine > 0 else np.diag([1.0, -1.0, -1.0, 1.0])
    motion = np.concatenate([np.zeros(3), axis / sine * np.arctan2(sine, cosine)])
    return se3.exp(motion)


def collision_of(mesh: ObjectMesh, item: TrackedObject, kind: str) -> list[tuple[Float64Array, npt.NDArray[np.int64]]]:
    """Return the convex bodies of an object in its own frame: its box, the hull of its mesh, or several parts."""
    if kind == NONE:
        return []
    trimesh = require("trimesh", "--collision", EXTRA)
    if kind == BOX:
        box = trimesh.creation.box(item.box.size)
        foot = np.array([0.0, 0.0, item.box.size[2] / 2.0])
        return [(np.asarray(box.vertices) + foot, np.asarray(box.faces))]
    if kind == HULL:
        return [_hull(mesh.vertices)]
    coacd = require("coacd", "--collision parts", EXTRA)
    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.faces),
        threshold=CONCAVITY,
        max_convex_hull=MAX_PARTS,
        max_ch_vertex=HULL_VERTICES,
        decimate=True,
        seed=1,
    )
    return [(np.asarray(vertices, np.float64), np.asarray(faces, np.int64)) for vertices, faces in parts]


def _hull(vertices: Float64Array) -> tuple[Float64Array, npt.NDArray[np.int64]]:
    """Return the convex hull of points, of no more vertices than simulators take."""
    trimesh = require("trimesh", "--collision", EXTRA)
    hull = trimesh.convex.convex_hull(vertices)
    if len(hull.vertices) > HULL_VERTICES:
        corners = np.asarray(hull.vertices)
        # The farthest in directions spread evenly over a sphere (a golden spiral).
        k = np.arange(HULL_VERTICES) + 0.5
        polar, turn = np.arccos(1 - 2 * k / HULL_VERTICES), np.pi * (1 + 5**0.5) * k
        ways = np.column_stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)])
        hull = trimesh.convex.convex_hull(corners[np.unique(np.argmax(ways @ corners.T, axis=1))])
    return np.asarray(hull.vertices, np.float64), np.asarray(hull.faces, np.int64)


def _outline(plane: SupportPlane, T_scene_world: Float64Array) -> tuple[Float64Array, npt.NDArray[np.int64]]:
    """Return the convex outline of a plane as triangles, seen from above counter-clockwise."""
    from scipy.spatial import ConvexHull

    points = se3.transform(T_scene_world, plane.extent)
    normal = T_scene_world[:3, :3] @ plane.normal
    first = np.linalg.svd(normal[None])[2][1]
    flat = np.column_stack([points @ first, points @ np.cross(normal, first)])
    ring = points[ConvexHull(flat).vertices]
    k = np.arange(1, len(ring) - 1)
    return ring, np.column_stack([np.zeros_like(k), k, k + 1])


def grey(count: int) -> UInt8Array:
    """Return the colors (N, 3) of the vertices of a support."""
    return _tiled(UNLABELLED, count)


def _tiled(rgb: tuple[int, int, int], count: int) -> UInt8Array:
    return np.tile(np.array(rgb, np.uint8), (count, 1))
