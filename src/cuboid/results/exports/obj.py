"""Wavefront OBJ: all objects in one file, a group each; metres, y up (as Blender and Unity read it), vertex colors."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.geometry import se3
from cuboid.results.exports.shapes import Y_UP, grey, shape_scene
from cuboid.results.files import Results

HEADER = "# Cuboid: metres, y up, vertex colors 0 to 1 behind the coordinates"


def write(run: Results, path: Path, **options: Any) -> list[str]:
    """Write the file."""
    made = shape_scene(run, **options)
    groups: list[tuple[str, Float64Array, Any, UInt8Array | None]] = []
    for body in made.bodies:
        T = Y_UP @ body.T_scene_body
        for suffix, part in body.parts():
            groups.append((body.name + suffix, se3.transform(T, part.vertices), part.faces, part.rgb))
        for k, (vertices, faces) in enumerate(body.collision):
            groups.append((f"{body.name}_collision_{k}", se3.transform(T, vertices), faces, None))
    for k, (vertices, faces) in enumerate(made.planes):
        groups.append((f"plane_{k}", se3.transform(Y_UP, vertices), faces, grey(len(vertices))))
    path.write_text(obj_text(groups), encoding="ascii")
    return made.notes


def obj_text(groups: Iterable[tuple[str, Float64Array, Any, UInt8Array | None]]) -> str:
    """Return meshes as text, each a group: name, vertices (V, 3) in metres, faces (F, 3), colors (V, 3) or None."""
    lines, count = [HEADER], 1
    for name, vertices, faces, rgb in groups:
        lines.append(f"o {name}")
        colors = [""] * len(vertices) if rgb is None else [" {:.3f} {:.3f} {:.3f}".format(*row) for row in rgb / 255.0]
        lines += ["v {:.5f} {:.5f} {:.5f}".format(*row) + color for row, color in zip(vertices, colors, strict=True)]
        lines += ["f {} {} {}".format(*row) for row in np.asarray(faces) + count]
        count += len(vertices)
    return "\n".join(lines) + "\n"
