"""The table of exports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cuboid.ground.core.registry import Registry
from cuboid.method.shapes.mesh import EXTRA
from cuboid.results.exports import (
    boxer,
    coco,
    csv_table,
    glb,
    graphml,
    kitti,
    mcap,
    obj,
    plain_json,
    ply,
    rerun_file,
    stl,
    urdf,
    usd,
)


@dataclass(frozen=True, slots=True)
class Export:
    """A form that results can be given.

    Attributes
    ----------
    suffix : str
        What the name of its file ends with; empty where it is a folder of files.
    purpose : str
        The programs that it is for, and what it holds.
    write : callable
        (run, path) -> lines that the user should read. It writes the file, or files into the folder, at the path.
    names : str
        For a folder: regular expression of the names of its files.
    extra : str
        The extra that it needs.
    options : tuple of str
        Names of the options that `write` takes besides.
    one_camera : bool
        Whether a file is for one camera: of a rig, each camera gets a file, whose name ends with that of the camera.
    """

    suffix: str
    purpose: str
    write: Callable[..., list[str]]
    names: str = ""
    extra: str = ""
    options: tuple[str, ...] = ()
    one_camera: bool = False


EXPORTS: Registry[Export] = Registry("export", "cuboid.exports")

# Options of the exports of shapes.
CLOSED, SHAPE = ("close", "complete"), ("close", "complete", "collision")
POINTS = "MeshLab, CloudCompare, Blender: one file per object with its points, and all boxes as a mesh"
BODIES = "PyBullet, MuJoCo, ROS: one body per object, with visual and collision meshes, and the whole scene"
MESHES = "3D printers and CAD: one file per object with its surface, in millimetres"
SCENE = "browsers, Blender, AR: the surface of each object on its support, with colors"
BAG = "Foxglove, RViz, `ros2 bag play`: one bag with images, `tf`, markers, detections"
COCO = "detection and tracking tools: rectangles in the images, with track ids"
BOXER = "Boxer and tools that read its table of boxes: one row per object"
STAGE = "Isaac Sim, Omniverse, Blender: the same as `glb`, with colliders"
GRAPH = "networkx, Gephi, yEd: which object is on, in or beside what"

for _name, _form in {
    "boxer": Export(".csv", BOXER, boxer.write),
    "coco": Export(".json", COCO, coco.write, one_camera=True),
    "csv": Export(".csv", "spreadsheets: one row per object", csv_table.write),
    "glb": Export(".glb", SCENE, glb.write, "", EXTRA, SHAPE),
    "graphml": Export(".graphml", GRAPH, graphml.write),
    "json": Export(".json", "other programs: footprints and sizes in centimetres", plain_json.write),
    "kitti": Export(".txt", "3D tracking tools and evaluators (AB3DMOT, TrackEval)", kitti.write, one_camera=True),
    "mcap": Export(".mcap", BAG, mcap.write, extra="ros"),
    "obj": Export(".obj", "Blender, MeshLab, Unity: the same as `glb`, as text", obj.write, "", EXTRA, SHAPE),
    "ply": Export("", POINTS, ply.write, r"object_\d{3,}\.ply|boxes\.ply"),
    "rerun": Export(".rrd", "the rerun viewer", rerun_file.write, extra="rerun"),
    "stl": Export("", MESHES, stl.write, r"object_\d{3,}\w*\.stl|scene\.stl", EXTRA, CLOSED),
    "urdf": Export("", BODIES, urdf.write, r"(object_\d{3,}\w*|plane_\d+|scene)\.(urdf|obj)", EXTRA, SHAPE),
    "usd": Export(".usd", STAGE, usd.write, "", "usd", SHAPE),
}.items():
    EXPORTS.register(_name)(_form)
