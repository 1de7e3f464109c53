from __future__ import annotations

import json

import numpy as np
import pytest
from made_recordings import Made, color_image, depth_image, write_frames, write_image

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.readers import open_recording

MATRIX = [60.0, 0, 0, 0, 61.0, 0, 31.5, 23.5, 1]


def log_of(count, skip=()):
    groups = []
    for k in range(count):
        if k not in skip:
            T = np.eye(4)
            T[0, 3] = 0.1 * k
            groups.append(f"{k} {k} {k + 1}\n" + "\n".join(" ".join(f"{v:.8f}" for v in row) for row in T))
    return "\n".join(groups) + "\n"


def make(folder, frames=4, log=True, color="color", intrinsic="camera_intrinsic.json"):
    made = Made(folder, lambda k: folder / color / f"{k:06d}.jpg", lambda k: folder / "depth" / f"{k:06d}.png", 1000.0)
    write_frames(made, frames)
    if intrinsic:
        document = {"width": 64, "height": 48, "intrinsic_matrix": MATRIX}
        (folder / intrinsic).write_text(json.dumps(document))
    if log:
        (folder / "scene").mkdir()
        (folder / "scene" / "trajectory.log").write_text(log_of(frames))
    return made


def test_open3d_s_own_folder(data_dir):
    recording = open_recording(data_dir / "containers" / "open3d")
    assert (recording.format, len(recording), recording.has_poses) == ("open3d", 30, True)
    assert recording.intrinsics == Intrinsics(525, 525, 319.5, 239.5, 640, 480)
    assert recording.depth_units_per_metre == 1000
    np.testing.assert_allclose(recording.pose(0), np.eye(4), atol=1e-9)
    np.testing.assert_allclose(recording.pose(1)[:3, 3], [0.00118646, -0.02351636, -0.00144057], atol=1e-8)
    frame = recording.read(29)
    assert frame.color.shape == (480, 640, 3)
    assert 0.4 < np.median(frame.depth_m[frame.depth_m > 0]) < 4


@pytest.mark.parametrize(("color", "intrinsic"), [("color", "camera_intrinsic.json"), ("image", "intrinsic.json")])
def test_a_made_folder(tmp_path, color, intrinsic):
    make(tmp_path / "scan", color=color, intrinsic=intrinsic)
    recording = open_recording(tmp_path / "scan")
    assert (recording.format, recording.intrinsics) == ("open3d", Intrinsics(60, 61, 31.5, 23.5, 64, 48))
    assert recording.read(3).T_world_camera[0, 3] == pytest.approx(0.3)
    assert recording.read(3).depth_m[0, 1] == pytest.approx(1.03)


def test_names_of_redwood_with_a_time_behind_the_number(tmp_path):
    for k in range(3):
        write_image(tmp_path / "rgb" / f"{k + 1:05d}-{33333 * k:012d}.jpg", color_image(k))
        write_image(tmp_path / "depth" / f"{k + 1:05d}-{33100 * k:012d}.png", depth_image(k, 1000))
    (tmp_path / "trajectory.log").write_text(log_of(3))
    recording = open_recording(tmp_path, intrinsics=(60, 61, 31.5, 23.5))
    assert len(recording) == 3
    assert recording.read(2).T_world_camera[0, 3] == pytest.approx(0.2)


def test_a_camera_json_makes_it_a_plain_folder(tmp_path):
    made = make(tmp_path / "scan")
    camera = {"fx": 50, "fy": 50, "cx": 32, "cy": 24, "width": 64, "height": 48, "depth_units_per_metre": 1000}
    (made.path / "camera.json").write_text(json.dumps(camera))
    assert open_recording(made.path).format == "plain"


def test_a_frame_without_a_pose_is_skipped(tmp_path):
    made = make(tmp_path / "scan")
    (made.path / "scene" / "trajectory.log").write_text(log_of(4, skip=(2,)))
    recording = open_recording(made.path)
    with pytest.raises(FrameError, match=r"trajectory\.log has no pose of frame 2 \(3 poses\)"):
        recording.read(2)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("camera_intrinsic.json", "{", r"camera_intrinsic\.json line 1: not valid JSON"),
        ("camera_intrinsic.json", "[]", "expected a JSON object"),
        ("camera_intrinsic.json", '{"width": 64, "height": 48}', "expected 'intrinsic_matrix' with 9 numbers"),
        ("camera_intrinsic.json", json.dumps({"width": 64, "intrinsic_matrix": MATRIX}), "'height' must be a number"),
        ("scene/trajectory.log", "0 0 1\n1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1\n", r"trajectory\.log line 1: expected four"),
        ("scene/trajectory.log", "", "holds no pose"),
    ],
)
def test_faulty_files_are_named(tmp_path, name, text, says):
    made = make(tmp_path / "scan")
    (made.path / name).write_text(text)
    with pytest.raises(InputError, match=says):
        open_recording(made.path)
