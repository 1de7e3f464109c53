"""USD: all objects with their supports in one stage; metres, z up, colors a vertex, collision by UsdPhysics.

::

    /World                                 customData: T_scene_world
      object_003_cup                       Xform, origin in the middle of its foot; customData: label, name
        surface, guessed                   Mesh; guessed with `--close` or `--complete`
        collision_0                        Mesh, purpose guide, a convex collider
      plane_0                              Mesh, a collider
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.core.extras import require
from cuboid.results.exports.shapes import Body, grey, shape_scene
from cuboid.results.files import Results


def write(run: Results, path: Path, **options: Any) -> list[str]:
    """Write the file."""
    pxr = {name: require(f"pxr.{name}", "--to usd", "usd") for name in ("Usd", "UsdGeom", "UsdPhysics", "Gf", "Vt")}
    made = shape_scene(run, **options)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".cuboid-", suffix=".partial") as work:
        file = Path(work) / "scene.usd"  # its library goes by the name's ending
        stage = pxr["Usd"].Stage.CreateNew(str(file))
        pxr["UsdGeom"].SetStageUpAxis(stage, pxr["UsdGeom"].Tokens.z)
        pxr["UsdGeom"].SetStageMetersPerUnit(stage, 1.0)
        world = pxr["UsdGeom"].Xform.Define(stage, "/World").GetPrim()
        stage.SetDefaultPrim(world)
        world.SetCustomDataByKey("T_scene_world", pxr["Gf"].Matrix4d(*made.T_scene_world.ravel().tolist()))
        for body in made.bodies:
            _add(stage, pxr, body)
        for k, (vertices, faces) in enumerate(made.planes):
            plane = _mesh(stage, pxr, f"/World/plane_{k}", vertices, faces, grey(len(vertices)))
            pxr["UsdPhysics"].CollisionAPI.Apply(plane.GetPrim())
        stage.GetRootLayer().Save()
        del stage
        path.write_bytes(file.read_bytes())
    return made.notes


def _add(stage: Any, pxr: dict[str, Any], body: Body) -> None:
    root = f"/World/{body.name}"
    node = pxr["UsdGeom"].Xform.Define(stage, root)
    # USD's matrices act on rows.
    node.AddTransformOp().Set(pxr["Gf"].Matrix4d(*body.T_scene_body.T.ravel().tolist()))
    node.GetPrim().SetCustomDataByKey("label", body.item.label)
    node.GetPrim().SetCustomDataByKey("name", body.item.name or "")
    for suffix, part in body.parts():
        _mesh(stage, pxr, f"{root}/{'guessed' if suffix else 'surface'}", part.vertices, part.faces, part.rgb)
    for k, (vertices, faces) in enumerate(body.collision):
        mesh = _mesh(stage, pxr, f"{root}/collision_{k}", vertices, faces, None)
        mesh.CreatePurposeAttr(pxr["UsdGeom"].Tokens.guide)
        pxr["UsdPhysics"].CollisionAPI.Apply(mesh.GetPrim())
        pxr["UsdPhysics"].MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr("convexHull")


def _mesh(stage: Any, pxr: dict[str, Any], path: str, vertices: Any, faces: Any, rgb: Any) -> Any:
    usd, array = pxr["UsdGeom"], pxr["Vt"]
    mesh = usd.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(array.Vec3fArray.FromNumpy(np.ascontiguousarray(vertices, np.float32)))
    mesh.CreateFaceVertexCountsAttr(array.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(array.IntArray.FromNumpy(np.ascontiguousarray(faces, np.int32).ravel()))
    mesh.CreateSubdivisionSchemeAttr(usd.Tokens.none)
    low, high = np.min(vertices, axis=0), np.max(vertices, axis=0)
    mesh.CreateExtentAttr(array.Vec3fArray.FromNumpy(np.array([low, high], np.float32)))
    if rgb is not None:
        colors = array.Vec3fArray.FromNumpy(np.ascontiguousarray(rgb / 255.0, np.float32))
        mesh.CreateDisplayColorPrimvar(usd.Tokens.vertex).Set(colors)
    return mesh
