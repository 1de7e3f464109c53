from __future__ import annotations

import json
import struct
from pathlib import Path
from xml.etree import ElementTree as Xml

import mujoco
import numpy as np
import pytest
import trimesh
from pxr import Usd, UsdGeom, UsdPhysics

import cuboid
import made_shapes
from cuboid.cli import main
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.results import TrackedObject
from cuboid.method.shapes.mesh import ObjectMesh
from cuboid.results.exports import EXPORTS, export
from cuboid.results.exports.shapes import HULL_VERTICES, collision_of, upright
from cuboid.results.files import Results
from made_scenes import upright as upright_box
from made_shapes import BOXES

NAMES = {1: "object_001", 2: "object_002_tea_box"}
SHAPES = ("glb", "obj", "stl", "urdf", "usd")
SUFFIXES = {name: form.suffix for name, form in EXPORTS.items()}
MM = 1e-3


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Results:
    place = tmp_path_factory.mktemp("shapes")
    return cuboid.open_results(made_shapes.finished(place / "results", place / "recording"))


def corners_of(points: np.ndarray) -> np.ndarray:
    return np.array([points.min(0), points.max(0)])


def true_corners(label: int) -> np.ndarray:
    return corners_of(BOXES[label].corners())


def y_up(corners: np.ndarray) -> np.ndarray:
    """Bounds in a world whose y is up."""
    return corners_of(corners @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]).T)


@pytest.mark.parametrize("name", SHAPES)
def test_the_same_results_are_the_same_bytes(run: Results, tmp_path: Path, name: str) -> None:
    for folder in "ab":
        (tmp_path / folder).mkdir()
        export(run, name, tmp_path / folder / f"out{SUFFIXES[name]}")
    one, two = (sorted(path for path in (tmp_path / folder).rglob("*") if path.is_file()) for folder in "ab")
    assert [path.name for path in one] == [path.name for path in two]
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]


def test_glb_is_metric_with_y_up_and_a_node_an_object(run: Results, tmp_path: Path) -> None:
    path = tmp_path / "scene.glb"
    export(run, "glb", path, close=True, collision="hull")
    scene = trimesh.load(path)
    for label, name in NAMES.items():
        matrix, _ = scene.graph[name]
        foot = BOXES[label].center - (0, 0, BOXES[label].size[2] / 2)
        np.testing.assert_allclose(matrix[:3, 3], (foot[0], foot[2], -foot[1]), atol=1e-5)
        for part in (f"{name}_surface", f"{name}_collision_0"):
            placed, geometry = scene.graph[part]
            points = trimesh.transform_points(scene.geometry[geometry].vertices, placed)
            np.testing.assert_allclose(corners_of(points), y_up(true_corners(label)), atol=9 * MM)
        assert scene.graph[f"{name}_guessed"] is not None
        assert len(scene.geometry[f"{name}_collision_0"].vertices) <= HULL_VERTICES
        assert scene.geometry[f"{name}_collision_0"].is_convex
    np.testing.assert_allclose(scene.geometry["plane_0"].bounds, [[-0.6, 0, -0.6], [0.6, 0, 0.6]], atol=1e-6)
    content = path.read_bytes()
    document = json.loads(content[20 : 20 + struct.unpack("<I", content[12:16])[0]])
    extras = {node["name"]: node.get("extras", {}) for node in document["nodes"]}
    assert extras[NAMES[2]]["label"] == 2
    assert extras[NAMES[2]]["name"] == "tea / box"


def test_obj_has_a_group_an_object(run: Results, tmp_path: Path) -> None:
    export(run, "obj", tmp_path / "scene.obj")
    lines = (tmp_path / "scene.obj").read_text().splitlines()
    assert [line[2:] for line in lines if line.startswith("o ")] == [*NAMES.values(), "plane_0"]
    for label, name in NAMES.items():
        begin = lines.index(f"o {name}") + 1
        group = lines[begin : next(k for k in range(begin, len(lines)) if lines[k].startswith("f "))]
        places = np.array([[float(word) for word in line.split()[1:4]] for line in group])
        np.testing.assert_allclose(corners_of(places), y_up(true_corners(label)), atol=9 * MM)
    whole = trimesh.load(tmp_path / "scene.obj", process=False)
    meshes = [run.mesh(label) for label in NAMES]
    assert len(whole.faces) == sum(len(mesh.faces) for mesh in meshes) + 2
    colors = whole.visual.vertex_colors[: len(meshes[0].vertices), :3]
    np.testing.assert_allclose(colors, meshes[0].rgb, atol=1)


def test_stl_is_in_millimetres_on_its_foot(run: Results, tmp_path: Path) -> None:
    export(run, "stl", tmp_path / "parts", complete=True)
    written = {path.name for path in (tmp_path / "parts").iterdir()}
    assert written == {*(f"{name}.stl" for name in NAMES.values()), "scene.stl"}
    for label, name in NAMES.items():
        mesh = trimesh.load(tmp_path / "parts" / f"{name}.stl")
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(BOXES[label].volume * 1e9, rel=0.06)
        assert mesh.bounds[0][2] == pytest.approx(0.0, abs=0.1)
    whole = corners_of(np.concatenate([BOXES[label].corners() for label in BOXES]))
    np.testing.assert_allclose(trimesh.load(tmp_path / "parts" / "scene.stl").bounds, whole * 1e3, atol=9.0)


def test_usd_says_its_units_and_has_colliders(run: Results, tmp_path: Path) -> None:
    export(run, "usd", tmp_path / "scene.usd", close=True, collision="box")
    stage = Usd.Stage.Open(str(tmp_path / "scene.usd"))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetDefaultPrim().GetPath() == "/World"
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
    for label, name in NAMES.items():
        prim = stage.GetPrimAtPath(f"/World/{name}")
        assert prim.GetCustomDataByKey("label") == label
        bounds = cache.ComputeWorldBound(prim.GetChild("surface")).ComputeAlignedRange()
        np.testing.assert_allclose([[*bounds.GetMin()], [*bounds.GetMax()]], true_corners(label), atol=9 * MM)
        assert prim.GetChild("guessed")
        collider = prim.GetChild("collision_0")
        assert collider.HasAPI(UsdPhysics.CollisionAPI)
        assert UsdGeom.Imageable(collider).ComputePurpose() == "guide"
    assert stage.GetPrimAtPath("/World/plane_0").HasAPI(UsdPhysics.CollisionAPI)


def test_urdf_is_loaded_by_a_simulator_and_an_object_rests_on_its_foot(run: Results, tmp_path: Path) -> None:
    export(run, "urdf", tmp_path / "sim", collision="hull")
    scene = mujoco.MjModel.from_xml_path(str(tmp_path / "sim" / "scene.urdf"))
    data = mujoco.MjData(scene)
    mujoco.mj_forward(scene, data)
    for label, name in NAMES.items():
        foot = BOXES[label].center - (0, 0, BOXES[label].size[2] / 2)
        np.testing.assert_allclose(data.body(name).xpos, foot, atol=1 * MM)
        np.testing.assert_allclose(data.body(name).xmat.reshape(3, 3), BOXES[label].rotation, atol=1e-3)
    # Alone, as a free body above a floor, it falls by a centimetre and comes to rest.
    spec = mujoco.MjSpec.from_file(str(tmp_path / "sim" / f"{NAMES[2]}.urdf"))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1])
    body = spec.body(NAMES[2])
    body.add_freejoint()
    body.pos = [0, 0, 0.01]
    model = spec.compile()
    state = mujoco.MjData(model)
    for _ in range(1000):
        mujoco.mj_step(model, state)
    assert state.body(NAMES[2]).xpos[2] == pytest.approx(0.0, abs=8 * MM)
    assert state.body(NAMES[2]).xmat[8] > 0.999
    robot = Xml.parse(tmp_path / "sim" / f"{NAMES[2]}.urdf").getroot()
    mass = float(next(robot.iter("mass")).get("value", ""))
    assert mass == pytest.approx(BOXES[2].volume * 400.0, rel=0.1)


def test_parts_are_convex_and_cover_the_object() -> None:
    plan = [(0, 0), (0.2, 0), (0.2, 0.1), (0.1, 0.1), (0.1, 0.2), (0, 0.2)]  # an L
    vertices = np.array([(x, y, z) for z in (0.0, 0.1) for x, y in plan])
    foot = np.array([(0, 2, 1), (0, 3, 2), (0, 4, 3), (0, 5, 4)])
    sides = [(k, (k + 1) % 6, (k + 1) % 6 + 6) for k in range(6)] + [(k, (k + 1) % 6 + 6, k + 6) for k in range(6)]
    faces = np.vstack([foot, foot[:, ::-1] + 6, sides]).astype(np.int32)
    mesh = ObjectMesh(1, None, vertices, faces, np.zeros((12, 3), np.uint8), np.zeros(len(faces), bool), 1)
    box = upright_box((0.1, 0.1), (0.2, 0.2, 0.1))
    item = TrackedObject(1, box, 0.9, 0.8, 0, 1, 2, 40, np.zeros(3), 0)
    parts = [trimesh.Trimesh(*part) for part in collision_of(mesh, item, "parts")]
    assert len(parts) == 2
    assert all(part.is_convex for part in parts)
    assert sum(part.volume for part in parts) == pytest.approx(3e-3, rel=0.01)


def test_up_becomes_z_by_the_smallest_turn() -> None:
    for up in ([0, 0, 1.0], [0, 0, -1.0], [0, -1.0, 0], [0.6, 0.0, 0.8]):
        T = upright(np.array(up))
        np.testing.assert_allclose(T[:3, :3] @ up, [0, 0, 1], atol=1e-9)
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(T) == pytest.approx(1.0)
    np.testing.assert_array_equal(upright(None), np.eye(4))


def test_the_command_takes_the_options_of_shapes_and_refuses_others(
    run: Results, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["export", str(run.folder), "--output"]
    assert main([*call, str(tmp_path / "a.glb"), "--to", "glb", "--close"]) == 0
    assert "glb written to" in capsys.readouterr().out
    assert main([*call, str(tmp_path / "a.csv"), "--to", "csv", "--close"]) == 2
    assert "'csv' has no option close; of the exports these have: glb, obj, stl, urdf, usd" in capsys.readouterr().err
    with pytest.raises(InputError, match="collision must be one of none, box, hull, parts"):
        export(run, "glb", tmp_path / "b.glb", collision="sphere")
    assert not (tmp_path / "b.glb").exists()
    with pytest.raises(OutputError, match="--force"):
        export(run, "glb", tmp_path / "a.glb")
