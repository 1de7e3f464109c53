"""URDF: what simulators of robots load (PyBullet, MuJoCo, ROS): metres, z up, a body an object.

- ``object_003_cup.urdf``: the object alone, the origin in the middle of its foot, to be put anywhere and pushed
- ``scene.urdf``: all objects fixed where they stand, and their supports
- ``object_003_cup.obj``: the visual mesh; ``object_003_cup_collision_0.obj``: a collision mesh

A mass is guessed from the volume of the collision bodies, `DENSITY_KG_M3`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.extras import require
from cuboid.ground.core.palette import UNLABELLED
from cuboid.method.shapes.mesh import EXTRA
from cuboid.results.exports.obj import obj_text
from cuboid.results.exports.shapes import HULL, NONE, Body, ShapeScene, shape_scene
from cuboid.results.files import Results

# Household things between an empty carton and a full can; nothing that a camera sees tells it.
DENSITY_KG_M3 = 400.0
# Simulators refuse bodies without mass, or almost none, kilograms.
LIGHTEST_KG = 0.005
# Supports are slabs of this thickness, metres: things fall through sheets.
SLAB_M = 0.02
WORLD = "world"


def write(run: Results, folder: Path, *, collision: str = HULL, **options: Any) -> list[str]:
    """Write the files into a folder."""
    made = shape_scene(run, collision=HULL if collision == NONE else collision, **options)
    scene = _robot("scene")
    Xml.SubElement(scene, "link", name=WORLD)
    for body in made.bodies:
        _write_meshes(body, folder)
        alone = _robot(body.name)
        _link(alone, body)
        _save(alone, folder / f"{body.name}.urdf")
        _link(scene, body)
        _fixed(scene, body.name, body.T_scene_body)
    _add_supports(scene, made, folder)
    _save(scene, folder / "scene.urdf")
    return made.notes


def _write_meshes(body: Body, folder: Path) -> None:
    mesh = body.mesh
    (folder / f"{body.name}.obj").write_text(obj_text([(body.name, mesh.vertices, mesh.faces, mesh.rgb)]), "ascii")
    for k, (vertices, faces) in enumerate(body.collision):
        name = f"{body.name}_collision_{k}"
        (folder / f"{name}.obj").write_text(obj_text([(name, vertices, faces, None)]), "ascii")


def _robot(name: str) -> Xml.Element:
    robot = Xml.Element("robot", name=name)
    # By default MuJoCo drops visual meshes and merges fixed links: these options keep both.
    mujoco = Xml.SubElement(robot, "mujoco")
    Xml.SubElement(mujoco, "compiler", discardvisual="false", fusestatic="false", balanceinertia="true")
    return robot


def _link(robot: Xml.Element, body: Body) -> None:
    link = Xml.SubElement(robot, "link", name=body.name)
    _inertia(link, body)
    visual = Xml.SubElement(link, "visual")
    Xml.SubElement(Xml.SubElement(visual, "geometry"), "mesh", filename=f"{body.name}.obj")
    material = Xml.SubElement(visual, "material", name=f"{body.name}_color")
    red, green, blue = (value / 255.0 for value in body.item.mean_color)
    Xml.SubElement(material, "color", rgba=_text(np.array([red, green, blue, 1.0])))
    for k in range(len(body.collision)):
        geometry = Xml.SubElement(Xml.SubElement(link, "collision"), "geometry")
        Xml.SubElement(geometry, "mesh", filename=f"{body.name}_collision_{k}.obj")


def _inertia(link: Xml.Element, body: Body) -> None:
    """Add mass, centre and inertia: those of the collision bodies, of one density."""
    trimesh = require("trimesh", "--to urdf", EXTRA)
    parts = [trimesh.Trimesh(vertices, faces) for vertices, faces in body.collision]
    masses = np.array([max(LIGHTEST_KG / len(parts), DENSITY_KG_M3 * abs(float(part.volume))) for part in parts])
    centers = np.array([part.bounds.mean(axis=0) for part in parts])
    center, mass = masses @ centers / masses.sum(), float(masses.sum())
    # That of the box around it: parts may be so thin that their own has no digits.
    x, y, z = body.size_m**2
    inertial = Xml.SubElement(link, "inertial")
    Xml.SubElement(inertial, "origin", xyz=_text(center), rpy="0 0 0")
    Xml.SubElement(inertial, "mass", value=f"{mass:.4f}")
    moments = mass / 12.0 * np.array([y + z, x + z, x + y])
    ixx, iyy, izz = (f"{value:.3e}" for value in moments)
    Xml.SubElement(inertial, "inertia", ixx=ixx, iyy=iyy, izz=izz, ixy="0", ixz="0", iyz="0")


def _add_supports(scene: Xml.Element, made: ShapeScene, folder: Path) -> None:
    for k, (ring, _) in enumerate(made.planes):
        name = f"plane_{k}"
        trimesh = require("trimesh", "--to urdf", EXTRA)
        slab = trimesh.convex.convex_hull(np.concatenate([ring, ring - (0.0, 0.0, SLAB_M)]))
        (folder / f"{name}.obj").write_text(obj_text([(name, slab.vertices, slab.faces, None)]), "ascii")
        link = Xml.SubElement(scene, "link", name=name)
        for kind in ("visual", "collision"):
            shape = Xml.SubElement(link, kind)
            Xml.SubElement(Xml.SubElement(shape, "geometry"), "mesh", filename=f"{name}.obj")
            if kind == "visual":
                color = np.array([*UNLABELLED, 255.0]) / 255.0
                Xml.SubElement(Xml.SubElement(shape, "material", name=f"{name}_color"), "color", rgba=_text(color))
        _fixed(scene, name, np.eye(4))


def _fixed(scene: Xml.Element, child: str, T_scene_child: Float64Array) -> None:
    joint = Xml.SubElement(scene, "joint", name=f"{child}_fixed", type="fixed")
    Xml.SubElement(joint, "parent", link=WORLD)
    Xml.SubElement(joint, "child", link=child)
    Xml.SubElement(joint, "origin", xyz=_text(T_scene_child[:3, 3]), rpy=_text(roll_pitch_yaw(T_scene_child)))


def roll_pitch_yaw(T: Float64Array) -> Float64Array:
    """Return the turns of a motion (4, 4) about the fixed x, y and z axes, one after the other, radians."""
    R = T[:3, :3]
    return np.array(
        [np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(np.clip(R[2, 0], -1.0, 1.0)), np.arctan2(R[1, 0], R[0, 0])]
    )


def _text(values: Float64Array) -> str:
    return " ".join(f"{value:z.6f}" for value in values)


def _save(robot: Xml.Element, path: Path) -> None:
    Xml.indent(robot)
    path.write_text('<?xml version="1.0"?>\n' + Xml.tostring(robot, "unicode") + "\n", encoding="utf-8")
