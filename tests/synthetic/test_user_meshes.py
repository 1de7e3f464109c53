from __future__ import annotations

import numpy as np
import pytest
import trimesh

from cuboid.ground.core.errors import InputError
from cuboid.lab.synthetic import make_scene
from cuboid.lab.synthetic.user_meshes import load_mesh, load_meshes


@pytest.fixture
def folder(tmp_path):
    cone = trimesh.creation.cone(0.05, 0.12)
    cone.apply_translation((3, 4, 5))
    cone.export(tmp_path / "a_cone.obj")
    brick = trimesh.creation.box((200, 100, 60))
    brick.visual.vertex_colors = np.tile(np.array([200, 30, 40, 255], np.uint8), (8, 1))
    brick.export(tmp_path / "b_brick.ply")
    trimesh.creation.box((0.1, 0.2, 0.05)).export(tmp_path / "c_upright.glb")
    (tmp_path / "readme.txt").write_text("no mesh")
    return tmp_path


def test_meshes_stand_on_zero_in_metres_z_up(folder):
    models = load_meshes(folder)
    assert [model.name for model in models] == ["a_cone", "b_brick", "c_upright"]
    sizes = [np.ptp(model.mesh().vertices, axis=0) for model in models]
    np.testing.assert_allclose(sizes[0][2], 0.12, rtol=1e-6)
    np.testing.assert_allclose(sizes[1], (0.2, 0.1, 0.06), rtol=1e-6)
    np.testing.assert_allclose(sizes[2], (0.1, 0.05, 0.2), rtol=1e-6)
    for model in models:
        low, high = model.mesh().vertices.min(axis=0), model.mesh().vertices.max(axis=0)
        assert abs(low[2]) < 1e-9
        np.testing.assert_allclose((low + high)[:2], 0, atol=0.01)
    np.testing.assert_allclose(models[1].parts[0][1].color, np.array([200, 30, 40]) / 255, atol=0.01)


def test_a_scene_takes_the_users_objects_first(folder):
    scene = make_scene("table", 1, frames=2, meshes=load_meshes(folder))
    assert {"a_cone", "b_brick", "c_upright"} <= {o.model.name for o in scene.objects}


def test_faults_of_files_are_one_line(tmp_path):
    with pytest.raises(InputError, match=r"nowhere: cannot be read: No such file"):
        load_meshes(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"no mesh in it \(expected \.obj, \.glb, \.ply\)"):
        load_meshes(tmp_path)
    (tmp_path / "bad.glb").write_bytes(b"nonsense")
    with pytest.raises(InputError, match=r"bad\.glb: "):
        load_mesh(tmp_path / "bad.glb")
    (tmp_path / "empty.obj").write_text("v 0 0 0\n")
    with pytest.raises(InputError, match=r"empty\.obj: "):
        load_mesh(tmp_path / "empty.obj")
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"flat\.obj: is flat"):
        load_mesh(tmp_path / "flat.obj")
