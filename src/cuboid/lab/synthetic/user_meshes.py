"""The user's own meshes as objects of a scene."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import require
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.formats.reading import opened
from cuboid.lab.synthetic.footprint import hull, smallest_rectangle
from cuboid.lab.synthetic.material import PAINTS, Color, Material, Texture
from cuboid.lab.synthetic.mesh import Mesh, shift, turn
from cuboid.lab.synthetic.shapes import Model

EXTENSIONS = (".obj", ".glb", ".ply")
# A mesh whose longest side is in this range is in metres; if a thousandth of it is, in millimetres. A mesh in neither
# unit is scaled to 18 cm.
LONGEST_M = (0.04, 0.6)
OTHERWISE_M = 0.18
# Maximum number of faces: more would slow the ray casting and add nothing at this distance.
MAX_FACES = 200_000
# Maximum file size (larger files have more faces than allowed), and maximum coordinate (of a mesh in micrometres).
MAX_MESH_BYTES = 256 << 20
LARGEST_COORDINATE = 1e9
# Minimum thickness, metres: below it a body has no volume and its outline no area.
THINNEST_M = 0.004


def load_meshes(folder: PathLike) -> list[Model]:
    """Return a model for each mesh file of a folder, in the order of names.

    ``.glb`` files are turned from y up (which that format prescribes) to z up; the others are taken as z up.

    Raises
    ------
    InputError
        The folder cannot be read or holds no mesh, or a file is no usable mesh.
    """
    folder = as_path(folder)
    try:
        names = sorted(name for name in os.listdir(folder) if name.lower().endswith(EXTENSIONS))
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror}") from None
    if not names:
        raise InputError(f"{folder}: no mesh in it (expected {', '.join(EXTENSIONS)})")
    return [load_mesh(folder / name) for name in names]


def load_mesh(path: Path) -> Model:
    """Return a mesh file as a model that stands on z = 0, with the color in the file if there is one.

    Raises
    ------
    InputError
        The file cannot be read, has no faces or too many, has numbers that are not finite, or is flat.
    """
    trimesh = require("trimesh", "cuboid synth --meshes", "synth")

    with opened(path, MAX_MESH_BYTES) as file:
        try:
            beside = trimesh.resolvers.FilePathResolver(str(path))  # materials and textures
            loaded = trimesh.load(file, file_type=path.suffix[1:].lower(), resolver=beside, force="mesh")
        except Exception as error:  # the readers of a dozen formats raise many kinds of errors
            raise InputError(f"{path}: cannot be read as a mesh: {str(error)[:80]}") from None
    vertices = np.asarray(getattr(loaded, "vertices", np.empty((0, 3))), np.float64)
    faces = np.asarray(getattr(loaded, "faces", np.empty((0, 3))), np.int32)
    if len(faces) == 0:
        raise InputError(f"{path}: no triangles in it")
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise InputError(f"{path}: expected vertices of three numbers, got {vertices.shape}")
    if len(faces) > MAX_FACES:
        raise InputError(f"{path}: {len(faces)} triangles, expected at most {MAX_FACES}")
    if not (np.abs(vertices) <= LARGEST_COORDINATE).all():
        raise InputError(f"{path}: a vertex is NaN, infinite, or above {LARGEST_COORDINATE:g}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{path}: a triangle has a corner that is none of the {len(vertices)} vertices")
    mesh = Mesh(vertices, faces)
    mesh = mesh.moved(turn(np.pi / 2, axis=0)) if path.suffix.lower() == ".glb" else mesh
    mesh = _standing(_scaled(mesh), path)
    color = _color(loaded)
    material = Material(color, _other(color), Texture.MARBLE, 0.03, 0.2)
    return Model(path.stem, ((mesh, material),))


def _scaled(mesh: Mesh) -> Mesh:
    longest = float(np.ptp(mesh.vertices, axis=0).max())
    low, high = LONGEST_M
    factor = 1.0
    if not low <= longest <= high:
        factor = 0.001 if low <= longest / 1000 <= high else OTHERWISE_M / max(longest, 1e-12)
    return Mesh(mesh.vertices * factor, mesh.faces)


def _standing(mesh: Mesh, path: Path) -> Mesh:
    sides = np.ptp(mesh.vertices, axis=0)
    if sides.min() < THINNEST_M:
        raise InputError(f"{path}: is flat, its thinnest side is {sides.min():.3g} m")
    try:
        middle, _, _ = smallest_rectangle(hull(mesh.vertices[:, :2]))
    except (RuntimeError, ValueError, IndexError):  # Qhull has its own error class
        raise InputError(f"{path}: is flat, seen from above it has no area") from None
    return mesh.moved(shift((-middle[0], -middle[1], -mesh.vertices[:, 2].min())))


def _color(loaded: object) -> Color:
    """Return the mean color of a mesh, or a paint if it has no color."""
    visual = getattr(loaded, "visual", None)
    try:
        if visual is not None and hasattr(visual, "to_color"):
            visual = visual.to_color()
        if visual is None or not getattr(visual, "defined", False):
            return PAINTS[6]
        rgb: Float64Array = np.asarray(visual.vertex_colors, np.float64)[:, :3].mean(axis=0) / 255
    except (AttributeError, ValueError, IndexError, TypeError, ImportError):
        return PAINTS[6]
    return float(rgb[0]), float(rgb[1]), float(rgb[2])


def _other(color: Color) -> Color:
    """Return a darker or brighter color, for the texture."""
    factor = 0.55 if sum(color) > 1.2 else 1.6
    return min(color[0] * factor, 1.0), min(color[1] * factor, 1.0), min(color[2] * factor, 1.0)
