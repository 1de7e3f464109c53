"""The style of a scene: its geometry with materials, light and color camera of real households."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic import room_materials
from cuboid.lab.synthetic.footprint import hull, is_round, smallest_rectangle
from cuboid.lab.synthetic.light import draw_camera, draw_light
from cuboid.lab.synthetic.material import Color, Material, Texture
from cuboid.lab.synthetic.mesh import Mesh
from cuboid.lab.synthetic.palette import Extent, finish, near, object_material, trim
from cuboid.lab.synthetic.scene import Furniture, Scene, SceneObject
from cuboid.lab.synthetic.shapes import Model

STYLES = ("plain", "real")
# Fraction of scenes with objects in the color of their support, and fraction of these objects.
SIMILAR_SCENES, SIMILAR_OBJECTS = 0.35, 0.5
# A part of an object with less than this fraction of its surface is a trim: lid, handle, rim.
TRIM_FRACTION = 0.3
# A surface is the top of a part whose upper end is at most this far from it, metres.
TOP_M = 0.03
# The numbers of the generators of materials, of light and camera, of furniture.
_OBJECT, _LIGHT, _ROOM = 11, 12, 13


def dressed(scene: Scene, seed: int, kept: Collection[Material] = ()) -> Scene:
    """Return a scene in the style `real`: the same geometry with other materials, light and color camera.

    Parameters
    ----------
    scene : Scene
    seed : int
        Materials depend on this number, on the kind and on the id of the object; light and camera on the seed of the
        scene.
    kept : collection of Material
        Materials that do not change: those of the user's meshes.
    """
    place = (seed, *scene.kind.encode())
    rng = np.random.default_rng([*place, _ROOM])
    walls = room_materials.wall(rng)
    furniture = tuple(_furnished(body, walls, rng) for body in scene.furniture)
    objects = tuple(_painted(body, scene, furniture, place, kept) for body in scene.objects)
    rng = np.random.default_rng([scene.seed, *scene.kind.encode(), _LIGHT])
    half_m = max(
        (float(np.ptp(b.mesh().vertices[:, 0])) / 2 for b in furniture if b.model.name == "floor"), default=2.5
    )
    light = draw_light(rng, half_m)
    return replace(scene, objects=objects, furniture=furniture, light=light, color_camera=draw_camera(rng, light))


def materials_of(models: Sequence[Model]) -> frozenset[Material]:
    """Return all materials of models."""
    return frozenset(look for model in models for _, look in model.parts)


def _furnished(body: Furniture, walls: Material, rng: np.random.Generator) -> Furniture:
    """Return furniture with other materials; parts with the same texture stay alike."""
    name, parts = body.model.name, body.model.parts
    drawn: dict[tuple[Texture, float], Material] = {}
    materials: list[Material] = []
    for k, (mesh, old) in enumerate(parts):
        key = old.texture, old.scale_m
        if name == "wall":
            new = walls if k == 0 else old if k == 1 else room_materials.picture(rng)
        elif name == "ceiling":
            new = old
        elif key in drawn:
            new = drawn[key]
        elif name == "floor":
            new = room_materials.floor(rng)
        elif name in ("curtain", "sofa"):
            new = room_materials.cloth(rng)
        else:
            new = room_materials.frame(rng) if drawn else room_materials.top(rng, _extent(mesh))
        drawn[key] = new
        materials.append(_aligned(replace(new, mirror=old.mirror), mesh))
    return replace(body, model=_with(body.model, materials))


def _painted(
    body: SceneObject, scene: Scene, furniture: Sequence[Furniture], place: Sequence[int], kept: Collection[Material]
) -> SceneObject:
    """Return an object with other materials: its main parts get rich ones, small parts plain ones."""
    rng = np.random.default_rng([*place, _OBJECT, body.id])
    similar = np.random.default_rng([*place, _ROOM, 1]).random() < SIMILAR_SCENES and rng.random() < SIMILAR_OBJECTS
    below = _top_color(scene, body.surface, furniture)
    color = near(rng, below, 0.05) if similar and below is not None else None
    areas = [float(np.linalg.norm(mesh.area_normals(), axis=1).sum()) for mesh, _ in body.model.parts]
    main: Material | None = None
    materials: list[Material] = []
    for k in np.argsort(areas)[::-1].tolist():
        mesh, old = body.model.parts[k]
        if old in kept:
            new = old
        elif main is None:
            new = main = object_material(rng, _extent(mesh), color)
        elif areas[k] > TRIM_FRACTION * sum(areas):
            new = object_material(rng, _extent(mesh), color)
        else:
            new = finish(rng, old) if rng.random() < 0.35 else trim(rng, main.color)
        materials.append(_aligned(new, mesh) if new is not old else old)
    order = np.argsort(np.argsort(areas)[::-1])
    return replace(body, model=_with(body.model, [materials[int(k)] for k in order]))


def _top_color(scene: Scene, surface: int, furniture: Sequence[Furniture]) -> Color | None:
    """Return the color of the part whose top is a surface, or None."""
    top = scene.surfaces[surface]
    for body in furniture:
        for mesh, look in body.model.parts:
            points = mesh.moved(body.T_room_model).vertices
            low, high = points.min(axis=0), points.max(axis=0)
            covers = (low[:2] <= top.center).all() and (top.center <= high[:2]).all()
            if covers and abs(high[2] - top.height_m) < TOP_M:
                return look.color
    return None


def _extent(mesh: Mesh) -> Extent:
    outline = hull(mesh.vertices[:, :2])
    _, size, _ = smallest_rectangle(outline)
    low, high = float(mesh.vertices[:, 2].min()), float(mesh.vertices[:, 2].max())
    return Extent(low, high, (float(size[0]) / 2, float(size[1]) / 2), is_round(outline))


def _aligned(look: Material, mesh: Mesh) -> Material:
    """Return a material that follows the axis and the sides of a part."""
    outline: Float64Array = hull(mesh.vertices[:, :2])
    center, size, angle = smallest_rectangle(outline)
    around = is_round(outline)
    return replace(
        look,
        axis=(float(center[0]), float(center[1])),
        yaw_rad=0.0 if around else float(angle),
        radius_m=float(size[0]) / 2 if around else 0.0,
    )


def _with(model: Model, materials: Sequence[Material]) -> Model:
    return replace(model, parts=tuple((mesh, look) for (mesh, _), look in zip(model.parts, materials, strict=True)))
