from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from cuboid.ground.core.errors import InputError
from cuboid.ground.geometry import se3
from cuboid.lab.synthetic import KINDS, demo_scene, make_scene
from cuboid.lab.synthetic.footprint import gap_m, hull
from cuboid.lab.synthetic.paths import CAMERAS
from cuboid.lab.synthetic.placement import TOUCH_M

# Smallest gap of objects that do not touch, metres, where it is less than 2 cm.
LEAST_GAP_M = {"bin": 0.003, "containers": 0.011, "sideboard": 0.011, "toybox": 0.003, "tray": 0.0015}
LEAST_GAP_M |= {"desk": 0.009, "kitchen": 0.014, "bookshelf": 0.009}


def outlines(scene):
    return {o.id: hull(o.mesh().vertices[:, :2]) for o in scene.objects}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_objects_stand_on_their_surface_without_overlap(kind, seed):
    scene = make_scene(kind, seed, frames=30)
    assert len(scene.objects) >= (1 if kind == "alone" else 4)
    plan = outlines(scene)
    heights = {o.id: o.mesh().vertices[:, 2] for o in scene.objects}
    least = LEAST_GAP_M.get(kind, 0.019)
    for o in scene.objects:
        surface = scene.surfaces[o.surface]
        assert surface.contains(plan[o.id], 0.0)
        bottom = o.mesh().vertices[:, 2].min()
        assert abs(bottom - surface.height_m) < 1e-9 or o.touches
        for other in scene.objects:
            above = heights[o.id].min() > heights[other.id].max()
            if other.id < o.id and other.surface == o.surface and other.id not in o.touches and not above:
                assert gap_m(plan[o.id], plan[other.id]) >= least


@pytest.mark.parametrize("seed", [1, 2])
def test_clutter_has_narrow_gaps_and_objects_that_touch(seed):
    scene = make_scene("clutter", seed, frames=10)
    plan = outlines(scene)
    nearest = [min(gap_m(plan[a], plan[b]) for b in plan if b != a) for a in plan]
    assert len(plan) >= 9
    assert sum(0.019 < gap < 0.0405 for gap in nearest) >= len(plan) / 2
    beside = [o for o in scene.objects if o.touches and o.judged]
    assert len(beside) >= 2
    for o in beside:
        assert any(0 < gap_m(plan[o.id], plan[other]) < TOUCH_M for other in o.touches)


def test_worlds_are_turned_any_way_and_another_seed_is_another_scene():
    ups = np.array([make_scene("table", seed, frames=2).T_world_room[:3, 2] for seed in range(12)])
    assert np.abs(ups).max(axis=1).min() < 0.9
    assert (ups.min(axis=0) < -0.3).all()
    assert (ups.max(axis=0) > 0.3).all()


# Every camera with the first kind, and one of them with each of the others.
CARRIED = [("table", camera) for camera in CAMERAS]
CARRIED += [(kind, list(CAMERAS)[k % len(CAMERAS)]) for k, kind in enumerate(KINDS) if kind != "table"]


@pytest.mark.parametrize(("kind", "camera"), CARRIED)
def test_the_camera_moves_like_one_that_is_carried(kind, camera):
    """At 30 frames a second: below 0.8 m/s and 60 degrees/s, upright but for a little roll."""
    poses = make_scene(kind, 5, camera=camera).T_room_camera
    steps = [se3.inverse(a) @ b for a, b in pairwise(poses)]
    assert max(np.linalg.norm(step[:3, 3]) for step in steps) < 0.027
    turns = [np.degrees(np.arccos(np.clip((np.trace(step[:3, :3]) - 1) / 2, -1, 1))) for step in steps]
    assert max(turns) < 2.0
    assert kind == "overhead" or np.abs(poses[:, 2, 0]).max() < 0.25
    assert all(se3.is_rigid(T, 1e-9) for T in poses)
    assert poses[:, 2, 3].min() > 0.8
    assert poses[:, 2, 3].max() < 2.4


def test_the_box_of_an_object_is_tight_and_rests_on_its_plane():
    scene = make_scene("tables", 2, frames=2)
    for o in scene.objects:
        box = scene.box(o)
        vertices = se3.transform(scene.T_world_room, o.mesh().vertices)
        own = (vertices - box.center) @ box.rotation
        np.testing.assert_allclose(own.min(axis=0), -box.size / 2, atol=1e-9)
        np.testing.assert_allclose(own.max(axis=0), box.size / 2, atol=1e-9)
        np.testing.assert_allclose(box.rotation.T @ box.rotation, np.eye(3), atol=1e-12)
        assert np.linalg.det(box.rotation) > 0
        assert box.size[0] >= box.size[1]
        normal, offset = scene.plane(o.surface)
        np.testing.assert_allclose(box.up, normal)
        np.testing.assert_allclose(normal @ (box.center - box.up * box.size[2] / 2), -offset, atol=1e-9)


def test_the_demo_begins_in_the_first_cameras_frame():
    scene = demo_scene()
    np.testing.assert_allclose(scene.T_world_camera[0], np.eye(4), atol=1e-12)
    assert {o.model.name for o in scene.objects} >= {"box", "can", "mug", "bowl", "cap"}


def test_unknown_names_are_told():
    with pytest.raises(InputError, match="no kind of scene is called 'garage'; there are table,"):
        make_scene("garage", 1)
    with pytest.raises(InputError, match="no camera is called 'crane'; there are orbit,"):
        make_scene("table", 1, camera="crane")
