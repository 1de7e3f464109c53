from __future__ import annotations

import json

import numpy as np
import pytest
from made_recordings import CAMERA, Made, color_image, write_frames, write_image

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry import se3
from cuboid.inputs.readers import open_recording


def make_scene(root, number="01", frames=4, start=0, shape=(48, 64)):
    folder = root / "rgbd-scenes-v2" / "imgs" / f"scene_{number}"
    made = Made(
        folder,
        lambda k: folder / f"{start + k:05d}-color.png",
        lambda k: folder / f"{start + k:05d}-depth.png",
        10000.0,
    )
    write_frames(made, frames, shape)
    (folder / "camera.json").write_text(json.dumps(CAMERA))
    return made


def write_poses(made, text):
    file = made.path.parents[1] / "pc" / f"{made.path.name[-2:]}.pose"
    file.parent.mkdir(exist_ok=True)
    file.write_text(text)


@pytest.mark.parametrize("named", ["rgbd-scenes-v2", "rgbd-scenes-v2/imgs", "rgbd-scenes-v2/imgs/scene_01"])
def test_the_real_scene_by_whatever_folder_is_named(data_dir, named):
    recording = open_recording(data_dir / named)
    assert (recording.format, len(recording)) == ("uw-rgbd-scenes-v2", 888)
    assert recording.intrinsics == Intrinsics(534.8, 534.8, 320.9, 246.9, 640, 480)
    assert recording.has_poses
    frame = recording.read(0)
    np.testing.assert_allclose(frame.T_world_camera, np.eye(4), atol=1e-12)
    seen = frame.depth_m[frame.depth_m > 0]
    assert 0.4 < np.percentile(seen, 1) < np.percentile(seen, 99) < 4.0


def test_real_depth_of_one_frame_falls_on_that_of_another(data_dir):
    """Scale, intrinsics, and the order of a pose line are right when two views of the table agree."""
    recording = open_recording(data_dir / "rgbd-scenes-v2")
    K = recording.intrinsics
    a, b = recording.read(100), recording.read(130)
    v, u = np.mgrid[0 : K.height : 6, 0 : K.width : 6]
    z = a.depth_m[v, u]
    near = (z > 0) & (z < 1.5)
    in_b = se3.transform(se3.inverse(b.T_world_camera) @ a.T_world_camera, K.points(u, v, z)[near])
    column, row = np.rint(K.pixels(in_b)).astype(int).T
    inside = (column >= 0) & (column < K.width) & (row >= 0) & (row < K.height)
    measured = b.depth_m[row[inside], column[inside]]
    apart = np.abs(in_b[inside, 2] - measured)[measured > 0]
    moved = np.linalg.norm(a.T_world_camera[:3, 3] - b.T_world_camera[:3, 3])
    assert moved > 0.05
    assert len(apart) > 1000
    assert np.median(apart) < 0.01


def _alone(tmp_path):
    made = make_scene(tmp_path)
    (made.path / "camera.json").unlink()
    return made


def test_a_layout_that_only_the_names_of_images_tell_is_said(tmp_path):
    made = _alone(tmp_path)
    for k in range(4):
        write_image(made.depth(k), np.full((480, 640), 9000 + k, np.uint16))
        write_image(made.color(k), np.zeros((480, 640, 3), np.uint8))
    (warning,) = open_recording(made.path).warnings
    assert warning.startswith(
        "the layout was recognised by the names of the images alone: the camera is taken as fx 534"
    )
    assert "10000 depth units per metre" in warning
    assert open_recording(made.path, intrinsics=(500, 500, 320, 240), depth_scale=1000).warnings == ()
    write_poses(made, "1 0 0 0 0 0 0\n" * 4)
    assert open_recording(made.path).warnings == ()


@pytest.mark.parametrize(
    ("name", "document"),
    [
        ("camera_params.json", {"fx": 60, "fy": 61, "cx": 31.5, "cy": 23.5, "depth_scale": 0.001}),
        ("camera_info.json", {"color": {"K": [60, 0, 31.5, 0, 61, 23.5, 0, 0, 1]}, "depth_scale": 1000}),
        ("intrinsics.json", {"rgb": {"ppx": 31.5, "ppy": 23.5, "fx": 60, "fy": 61}, "depth": {"fx": 1, "fy": 1}}),
        ("camera_intrinsic.json", {"intrinsic_matrix": [60, 0, 0, 0, 61, 0, 31.5, 23.5, 1], "width": 64, "height": 48}),
    ],
)
def test_a_camera_file_of_another_program_is_read(tmp_path, name, document):
    made = _alone(tmp_path)
    (made.path / name).write_text(json.dumps(document))
    recording = open_recording(made.path)
    assert recording.intrinsics == Intrinsics(60.0, 61.0, 31.5, 23.5, 64, 48)
    assert recording.calibration.source == name
    has_scale = "depth_scale" in document
    assert recording.depth_units_per_metre == (1000.0 if has_scale else 10000.0)
    assert bool(recording.warnings) != has_scale


def test_poses_by_number_in_a_part_of_a_scene(tmp_path):
    made = make_scene(tmp_path, start=7)
    write_poses(made, "".join(f"1 0 0 0 {k} 0 0\n" for k in range(10)) + "\n")
    recording = open_recording(made.path)
    assert recording.read(0).T_world_camera[0, 3] == 7
    with pytest.raises(FrameError, match=r"01\.pose has 10 lines, none for frame number 10"):
        recording.read(3)


def test_jpg_counts_and_png_goes_before_it(tmp_path):
    made = make_scene(tmp_path)
    for k in range(2):
        write_image(made.color(k).with_suffix(".jpg"), color_image(100 + k))
    made.color(1).unlink()
    recording = open_recording(made.path)
    assert recording.read(0).color[0, 0, 1] == 10
    assert abs(int(recording.read(1).color[0, 0, 1]) - 111) < 5


def test_camera_file_goes_before_the_published_intrinsics_and_may_lie_above(tmp_path):
    made = make_scene(tmp_path)
    assert open_recording(made.path).intrinsics.fx == 60
    (made.path / "camera.json").rename(made.path.parents[1] / "camera.json")
    assert open_recording(made.path).intrinsics.fx == 60


def test_published_intrinsics_are_for_their_image_size_only(tmp_path):
    made = make_scene(tmp_path)
    (made.path / "camera.json").unlink()
    with pytest.raises(InputError, match=r"images are 64x48, but the intrinsics .* are for 640x480; give them with"):
        open_recording(made.path)
    assert open_recording(made.path, intrinsics=(50, 50, 32, 24)).intrinsics.fx == 50


def test_several_scenes_are_listed(tmp_path):
    for number in ("01", "02", "03"):
        make_scene(tmp_path, number, frames=1)
    with pytest.raises(InputError, match="holds 3 recordings, name one of them: imgs/scene_01, imgs/scene_02, imgs"):
        open_recording(tmp_path / "rgbd-scenes-v2")
