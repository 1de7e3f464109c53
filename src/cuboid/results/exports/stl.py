"""STL: a file an object for printers and CAD, millimetres, z up, the origin in the middle of its foot; and the scene.

- ``object_003_cup.stl``: binary; its guessed faces too, which STL cannot mark
- ``scene.stl``: all objects where they stand, without supports
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry import se3
from cuboid.results.exports.shapes import shape_scene
from cuboid.results.files import Results

MM_PER_M = 1000.0
TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")])


def write(run: Results, folder: Path, **options: Any) -> list[str]:
    """Write the files into a folder."""
    made = shape_scene(run, **options)
    parts = []
    for body in made.bodies:
        corners_m = body.mesh.vertices[body.mesh.faces]
        (folder / f"{body.name}.stl").write_bytes(stl_bytes(corners_m))
        parts.append(se3.transform(body.T_scene_body, corners_m.reshape(-1, 3)).reshape(-1, 3, 3))
    (folder / "scene.stl").write_bytes(stl_bytes(np.concatenate([np.zeros((0, 3, 3)), *parts])))
    return made.notes


def stl_bytes(corners_m: Float64Array) -> bytes:
    """Return triangles (F, 3, 3), metres, as a binary STL in millimetres."""
    rows: npt.NDArray[np.void] = np.zeros(len(corners_m), TRIANGLE)
    normal = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    rows["normal"] = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    rows["corners"] = corners_m * MM_PER_M
    return b"Cuboid: millimetres, z up".ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()
