"""glTF (binary): all objects with their supports in one scene; metres, y up, colors a vertex.

::

    scene                           extras: T_scene_world (16 numbers, row by row), up, unit
      object_003_cup                its own frame: origin in the middle of its foot; extras: label, name, size_m
        object_003_cup_guessed      faces that no camera saw, with `--close` or `--complete`
        object_003_cup_collision_0  with `--collision`: convex, see-through
      plane_0                       the convex outline of a supporting plane
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.extras import require
from cuboid.ground.core.palette import UNLABELLED, color_of
from cuboid.ground.geometry import se3
from cuboid.method.shapes.mesh import EXTRA
from cuboid.results.exports.shapes import Y_UP, Body, shape_scene
from cuboid.results.files import Results

COLLISION_ALPHA = 80


def write(run: Results, path: Path, **options: Any) -> list[str]:
    """Write the file."""
    trimesh = require("trimesh", "--to glb", EXTRA)
    made = shape_scene(run, **options)
    scene = trimesh.Scene(base_frame="scene")
    scene.metadata.update({"T_scene_world": (Y_UP @ made.T_scene_world).ravel().tolist(), "up": "y", "unit": "metre"})
    for body in made.bodies:
        _add(scene, trimesh, body)
    for k, (vertices, faces) in enumerate(made.planes):
        color = np.array([*UNLABELLED, 255], np.uint8)
        plane = trimesh.Trimesh(se3.transform(Y_UP, vertices), faces, process=False, face_colors=color)
        scene.add_geometry(plane, node_name=f"plane_{k}", geom_name=f"plane_{k}")
    path.write_bytes(scene.export(file_type="glb"))
    return made.notes


def _add(scene: Any, trimesh: Any, body: Body) -> None:
    """Add the node of an object, and those below it."""
    turned = Y_UP @ body.T_scene_body @ np.linalg.inv(Y_UP)
    extras = {"label": body.item.label, "name": body.item.name, "size_m": body.size_m.tolist()}
    scene.graph.update(frame_from="scene", frame_to=body.name, matrix=turned, metadata=extras)

    def put(name: str, vertices: Float64Array, faces: Any, colors: Any) -> None:
        mesh = trimesh.Trimesh(se3.transform(Y_UP, vertices), faces, process=False, vertex_colors=colors)
        scene.add_geometry(mesh, node_name=name, geom_name=name, parent_node_name=body.name)

    for suffix, part in body.parts():
        put(f"{body.name}{suffix or '_surface'}", part.vertices, part.faces, part.rgb)
    for k, (vertices, faces) in enumerate(body.collision):
        color = np.array([*color_of(body.item.label), COLLISION_ALPHA], np.uint8)
        put(f"{body.name}_collision_{k}", vertices, faces, np.tile(color, (len(vertices), 1)))
