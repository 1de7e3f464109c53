"""Scanned things of robosuite, brought to the size of the real things."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
from assets import robosuite_folder, shrunk
from meshes import Color, Image, Part, Rng
from thing import Thing, solid

# Factor from the size of a mesh to that of the real thing.
SCANS = {"cereal": 2.0, "can": 1.4, "milk": 1.5, "lemon": 1.3, "bread": 1.6, "bottle": 1.3}


def _image_of(model: Any, material: int) -> Image | None:
    """Return the image of a compiled material, or None."""
    texture = max(model.mat_texid[material]) if material >= 0 else -1
    if texture < 0:
        return None
    h, w, c = (int(a[texture]) for a in (model.tex_height, model.tex_width, model.tex_nchannel))
    first = model.tex_adr[texture]
    return shrunk(model.tex_data[first : first + h * w * c].reshape(h, w, c)[..., :3])


@functools.cache
def load_scan(name: str) -> tuple[Part, ...]:
    """Return the parts of a scanned thing, upright on z = 0 around the z axis."""
    model = mujoco.MjModel.from_xml_path(str(robosuite_folder() / "objects" / f"{name}.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    parts = []
    for g in range(model.ngeom):
        if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_MESH:
            continue
        k, material = model.geom_dataid[g], model.geom_matid[g]
        vertices = model.mesh_vert[model.mesh_vertadr[k] :][: model.mesh_vertnum[k]].astype(float)
        vertices = (vertices @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g]) * SCANS[name]
        faces = slice(model.mesh_faceadr[k], model.mesh_faceadr[k] + model.mesh_facenum[k])
        vertices, shared = np.unique(vertices.round(6), axis=0, return_inverse=True)
        uv = model.mesh_texcoord[model.mesh_texcoordadr[k] :][: model.mesh_texcoordnum[k]].astype(float)
        r, g_, b, _ = model.mat_rgba[material] if material >= 0 else model.geom_rgba[g]
        corners = model.mesh_facetexcoord[faces].copy() if len(uv) else None
        image = _image_of(model, material) if len(uv) else None
        parts.append(
            Part(vertices, shared[model.mesh_face[faces]], uv if len(uv) else None, corners, image, (r, g_, b))
        )
    low, high = (f([f(p.vertices, axis=0) for p in parts], axis=0) for f in (np.min, np.max))
    offset = -np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    return tuple(p.moved(offset) for p in parts)


def scan(rng: Rng, _: Color) -> Thing:
    """Return a scanned thing, larger or smaller than the real one by up to 15 percent."""
    name, factor = str(rng.choice(list(SCANS))), rng.uniform(0.85, 1.15)
    return solid(*(replace(p, vertices=p.vertices * factor) for p in load_scan(name)), flat=name == "can")
