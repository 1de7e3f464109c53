from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import cuboid
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.formats.table_validation import data_lines
from cuboid.ground.geometry import se3
from cuboid.lab.evaluation.truth import read_truth
from cuboid.lab.synthetic import KINDS, demo_scene, make_scene, render_recording
from cuboid.lab.synthetic.raycast import pixel_rays
from cuboid.lab.synthetic.view import SceneView
from cuboid.results.files.ply import read_map


def fractions(truth: dict, body: int) -> np.ndarray:
    """Unfold the visibility of an object."""
    return np.concatenate([np.full(count, value) for value, count in truth["visibility"]["objects"][str(body)]])


def truth_of(path: Path) -> dict:
    return json.loads((path / "truth.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_makes_a_recording_that_opens_and_its_truth(kind, tmp_path):
    scene = make_scene(kind, 1, frames=3)
    render_recording(scene, tmp_path / "made", size=(64, 48))
    recording = cuboid.open_recording(tmp_path / "made")
    assert (recording.format, len(recording), recording.has_poses) == ("plain", 3, True)
    frame = recording.read(0)
    assert frame.color.shape == (48, 64, 3)
    assert (frame.depth_m > 0).mean() > 0.5
    assert frame.color.std() > 5
    truth = truth_of(tmp_path / "made")
    assert [row["name"] for row in truth["objects"]] == [one.model.name for one in scene.objects]
    assert any(row["judged"] and row["frames_present"] == 3 for row in truth["objects"])
    assert len(truth["planes"]) == len(scene.surfaces)
    assert {row["name"] for row in truth["ignore"]} == {one.model.name for one in scene.furniture if one.doubtful}


def test_points_seen_on_an_object_lie_in_its_box(small):
    """Depth, pose, intrinsics and box of the files together, to the resolution of the depth image."""
    scene, recording, truth = make_scene("table", 1, frames=12), cuboid.open_recording(small), truth_of(small)
    view = SceneView(scene, recording.intrinsics)
    seen = 0
    for k in (0, 11):
        frame = recording.read(k)
        labels = view.labels(view.render(k, "clean").hits)
        points = pixel_rays(recording.intrinsics, np.eye(4)) * frame.depth_m[..., None]
        world = se3.transform(frame.T_world_camera, points)
        for body in truth["objects"]:
            own = (world[labels == body["id"]] - body["center"]) @ np.array(body["rotation"])
            assert (np.abs(own) <= np.array(body["size"]) / 2 + 0.001).all()
            seen += len(own)
    assert seen > 300


def test_points_seen_on_the_table_lie_in_its_plane(small):
    recording, truth = cuboid.open_recording(small), truth_of(small)
    (plane,) = truth["planes"]
    frame = recording.read(5)
    points = se3.transform(frame.T_world_camera, pixel_rays(recording.intrinsics, np.eye(4)) * frame.depth_m[..., None])
    height = points @ np.array(plane["normal"]) + plane["offset"]
    assert (np.abs(height) < 0.001).mean() > 0.15


def test_truth_has_the_form_of_truth_files(small, data_dir):
    real = json.loads((data_dir / "rgbd-scenes-v2" / "ground_truth" / "01.json").read_text(encoding="utf-8"))
    made = truth_of(small)
    assert real.keys() | {"walls", "relations"} == made.keys()
    assert (made["format"], made["version"]) == (real["format"], real["version"])
    needed = {"id", "name", "judged", "center", "size", "rotation", "frames_present"}
    assert needed <= made["objects"][0].keys() & real["objects"][0].keys()
    assert real["planes"][0].keys() <= made["planes"][0].keys()
    assert made["visibility"]["frames"] == made["frames"] == 12
    for body in made["objects"]:
        assert len(fractions(made, body["id"])) == 12


def test_visible_share_follows_the_camera(small):
    truth = truth_of(small)
    for body in truth["objects"]:
        values = fractions(truth, body["id"])
        assert (np.abs(values * 20 - np.rint(values * 20)) < 1e-9).all()
        assert 0.3 < values.max() <= 1


def test_what_is_out_of_view_or_hidden_has_share_zero(tmp_path):
    scene = make_scene("leave", 1, frames=40)
    view = SceneView(scene, scene.intrinsics(96, 72))
    values = np.array([view.visible_fractions(k, view.render(k, "clean").hits) for k in (0, 20, 39)])
    assert (values[0] > 0.2).sum() >= 4
    assert (values[2] > 0.2).sum() >= 4
    assert not values[1].any(), "the camera looks aside"
    demo = demo_scene()
    view = SceneView(demo, demo.intrinsics(96, 72))
    values = np.array([view.visible_fractions(k, view.render(k, "clean").hits) for k in range(0, 60, 6)])
    hidden = (values == 0).any(axis=0) & (values.max(axis=0) > 0.3)
    assert hidden.sum() >= 3, "objects pass behind the screen"


def test_the_labelled_cloud_lies_on_the_objects(small):
    cloud, truth = read_map(small / "true_cloud.ply"), truth_of(small)
    np.testing.assert_array_equal(cloud.heat, cloud.label > 0)
    assert set(cloud.label.tolist()) == {0, *(body["id"] for body in truth["objects"])}
    for body in truth["objects"]:
        own = (cloud.xyz[cloud.label == body["id"]] - body["center"]) @ np.array(body["rotation"])
        assert (np.abs(own) <= np.array(body["size"]) / 2 + 1e-4).all()


@pytest.mark.parametrize(
    ("kind", "style", "sensor"), [("table", "plain", "structured-light"), ("clutter", "real", "realsense-d435")]
)
def test_same_seed_same_bytes_whatever_the_number_of_workers(kind, style, sensor, tmp_path, contents):
    for name, workers in (("one", 1), ("two", 2)):
        scene = make_scene(kind, 3, frames=4, style=style)
        render_recording(scene, tmp_path / name, sensor=sensor, size=(64, 48), workers=workers, pose_noise="drift")
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    assert len(contents(tmp_path / "one")) == 2 * 4 + 5


@pytest.mark.parametrize("noise", ["drift", "jumps"])
def test_written_poses_are_off_and_the_truth_is_not(noise, tmp_path):
    scene = make_scene("table", 2, frames=80)
    render_recording(scene, tmp_path / "made", size=(64, 48), pose_noise=noise, sensor="clean")
    recording = cuboid.open_recording(tmp_path / "made")
    written = np.array([frame.T_world_camera for frame in recording.iterate()])
    off = np.linalg.norm((written - scene.T_world_camera)[:, :3, 3], axis=1)
    assert off[0] < 1e-6
    true = [[float(word) for word in line.split()] for _, line in data_lines(tmp_path / "made" / "true_trajectory.txt")]
    np.testing.assert_allclose(np.array(true)[:, 1:4], scene.T_world_camera[:, :3, 3], atol=1e-6)
    np.testing.assert_allclose(np.array(true)[:, 0], np.arange(80) / 30, atol=1e-6)
    if noise == "drift":
        assert 0.002 < off[-10:].mean() < 0.05
    else:
        assert 0.009 < off.max() < 0.04
        assert (off < 1e-6).mean() > 0.3
        assert (off > 0.009).mean() > 0.05


def test_progress_is_told_frame_by_frame(tmp_path):
    told = []
    render_recording(
        make_scene("table", 1, frames=3), tmp_path / "made", size=(64, 48), progress=lambda *a: told.append(a)
    )
    assert told == [(0, 3), (1, 3), (2, 3), (3, 3)]


def test_only_a_made_recording_is_replaced(small, tmp_path):
    scene = make_scene("table", 1, frames=2)
    with pytest.raises(OutputError, match="exists; --force"):
        render_recording(scene, small, size=(64, 48))
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "notes.txt").write_text("mine")
    with pytest.raises(OutputError):
        render_recording(scene, precious, size=(64, 48), force=True)
    assert (precious / "notes.txt").read_text() == "mine"
    for frames in (3, 2):
        render_recording(make_scene("table", 1, frames=frames), tmp_path / "made", size=(64, 48), force=True)
    assert len(cuboid.open_recording(tmp_path / "made")) == 2


def test_wrong_arguments_are_told_before_work(tmp_path):
    scene = make_scene("table", 1, frames=2)
    for argument, message in (
        ({"sensor": "radar"}, "no sensor is called 'radar'; there are structured-light"),
        ({"pose_noise": "much"}, "no pose noise is called 'much'; there are none"),
        ({"size": (10, 10)}, "at least 64x48, got 10x10"),
        ({"faults": ["rain"]}, "no fault is called 'rain'; there are all, truncated-color"),
    ):
        with pytest.raises(InputError, match=message):
            render_recording(scene, tmp_path / "made", **argument)
    assert not list(tmp_path.iterdir())


def test_the_evaluator_reads_the_truth(small):
    truth = read_truth(small / "truth.json")
    scene = make_scene("table", 1, frames=12)
    assert (truth.frames, truth.region) == (12, None)
    for read, body in zip(truth.objects, scene.objects, strict=True):
        np.testing.assert_allclose(read.box.corners(), scene.box(body).corners(), atol=1e-5)
    assert truth.visibility.shape == (12, len(scene.objects))
