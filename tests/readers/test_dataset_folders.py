"""Data sets: Replica, ScanNet, BOP, nerfstudio."""

from __future__ import annotations

import json
import struct
import zlib

import cv2
import numpy as np
import pytest
from made_recordings import color_image, depth_image, write_image

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Intrinsics, SkippedFrame
from cuboid.inputs.readers import open_recording


def matrix_at(x):
    T = np.eye(4)
    T[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
    T[0, 3] = x
    return T


def text_of(matrix):
    return "\n".join(" ".join(f"{value:.9f}" for value in row) for row in matrix) + "\n"


def make_replica(root, frames=3, scale=6553.5):
    scene = root / "Replica" / "office0"
    for k in range(frames):
        write_image(scene / "results" / f"frame{k:06d}.jpg", color_image(k))
        write_image(scene / "results" / f"depth{k:06d}.png", depth_image(k, scale))
    lines = [" ".join(f"{v:.9f}" for v in matrix_at(0.1 * k).ravel()) for k in range(frames)]
    (scene / "traj.txt").write_text("\n".join(lines) + "\n")
    camera = {"w": 64, "h": 48, "fx": 60.0, "fy": 61.0, "cx": 31.5, "cy": 23.5, "scale": scale}
    (root / "Replica" / "cam_params.json").write_text(json.dumps({"camera": camera}))
    return scene


def test_replica(tmp_path):
    recording = open_recording(make_replica(tmp_path))
    assert (recording.format, len(recording)) == ("replica", 3)
    assert recording.intrinsics == Intrinsics(60, 61, 31.5, 23.5, 64, 48)
    frame = recording.read(2)
    assert frame.depth_m[0, 1] == pytest.approx(1.02, abs=1e-4)
    np.testing.assert_allclose(frame.T_world_camera, matrix_at(0.2), atol=1e-8)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("../cam_params.json", "{}", "expected 'camera' with fx, fy"),
        ("../cam_params.json", '{"camera": {"fx": 1}}', r"'camera\.fy' must be a number above 0, got None"),
        ("traj.txt", "1 2 3\n", r"traj\.txt line 1: expected the 16 numbers"),
    ],
)
def test_faulty_files_of_replica_are_named(tmp_path, name, text, says):
    scene = make_replica(tmp_path)
    (scene / name).write_text(text)
    with pytest.raises(InputError, match=says):
        open_recording(scene)


def test_replica_with_fewer_poses_skips_frames(tmp_path):
    scene = make_replica(tmp_path)
    (scene / "traj.txt").write_text((scene / "traj.txt").read_text().splitlines()[0] + "\n")
    with pytest.raises(FrameError, match=r"traj\.txt has 1 lines, none for frame 2"):
        open_recording(scene).read(2)


def make_scannet(scene, frames=12):
    for k in range(frames):
        write_image(scene / "color" / f"{k}.jpg", color_image(k, (96, 128)))
        write_image(scene / "depth" / f"{k}.png", depth_image(k, 1000))
        (scene / "pose").mkdir(exist_ok=True)
        (scene / "pose" / f"{k}.txt").write_text(text_of(matrix_at(0.1 * k)))
    (scene / "intrinsic").mkdir()
    for name, f, cx, cy in (("color", 120, 63.5, 47.5), ("depth", 60, 31.5, 23.5)):
        K = np.diag([f, f, 1.0, 1.0])
        K[:2, 2] = cx, cy
        (scene / "intrinsic" / f"intrinsic_{name}.txt").write_text(text_of(K))
    return scene


def test_scannet_with_color_finer_than_depth(tmp_path):
    scene = make_scannet(tmp_path / "scene0000_00")
    (scene / "pose" / "5.txt").write_text(("-inf " * 4 + "\n") * 4)
    recording = open_recording(scene)
    assert (recording.format, len(recording)) == ("scannet", 12)
    assert recording.intrinsics == Intrinsics(120, 120, 63.5, 47.5, 128, 96)
    frame = recording.read(10)  # 10 comes behind 9, not behind 1
    np.testing.assert_allclose(frame.T_world_camera, matrix_at(1.0), atol=1e-8)
    assert frame.depth_m[40, 20] == pytest.approx(1.1)
    assert frame.depth_m[40, 120] == pytest.approx(2.0)
    assert (frame.depth_m[5:-5, 5:60] > 0).all()  # no holes though color has four times the pixels
    with pytest.raises(FrameError, match=r"5\.txt: the pose has NaN or infinite numbers"):
        recording.read(5)
    (scene / "pose" / "6.txt").unlink()
    with pytest.raises(FrameError, match=r"the camera pose is missing: 6\.txt"):
        open_recording(scene).read(6)


def test_faulty_intrinsics_of_scannet_are_named(tmp_path):
    scene = make_scannet(tmp_path / "scene0000_00", frames=1)
    (scene / "intrinsic" / "intrinsic_depth.txt").write_text("1 0\n0 1\n")
    with pytest.raises(InputError, match=r"intrinsic_depth\.txt: expected a 4x4 matrix, got 2 rows"):
        open_recording(scene)


def make_sens(path, frames=6):
    K, D = np.diag([120.0, 120, 1, 1]), np.diag([60.0, 60, 1, 1])
    K[:2, 2], D[:2, 2] = (63.5, 47.5), (31.5, 23.5)
    data = struct.pack("<IQ", 4, 5) + b"phone"
    for matrix in (K, np.eye(4), D, np.eye(4)):
        data += struct.pack("<16f", *matrix.ravel())
    data += struct.pack("<iiIIIIfQ", 2, 1, 128, 96, 64, 48, 1000.0, frames)
    for k in range(frames):
        jpeg = cv2.imencode(".jpg", np.ascontiguousarray(color_image(k, (96, 128))[..., ::-1]))[1].tobytes()
        depth = zlib.compress(depth_image(k, 1000).tobytes())
        T = matrix_at(0.1 * k) if k != 3 else np.full((4, 4), -np.inf)
        data += struct.pack("<16fQQQQ", *T.ravel(), 33_000 * k + 5, 33_000 * k, len(jpeg), len(depth)) + jpeg + depth
    path.write_bytes(data)
    return path


def test_a_sens_file_in_any_order(tmp_path):
    recording = open_recording(make_sens(tmp_path / "scene0000_00.sens"))
    assert (recording.format, len(recording)) == ("scannet-sens", 6)
    assert recording.intrinsics == Intrinsics(120, 120, 63.5, 47.5, 128, 96)
    for k in (5, 0, 2):
        frame = recording.read(k)
        np.testing.assert_allclose(frame.T_world_camera, matrix_at(0.1 * k), atol=1e-6)
        assert frame.depth_m[40, 20] == pytest.approx(1 + 0.01 * k)
        assert frame.timestamp_s == pytest.approx(0.033 * k, abs=1e-4)
        assert np.abs(frame.color[10, 10].astype(int) - (200, 10 + k, 30)).max() < 6
    with pytest.raises(FrameError, match="frame 3: the pose has NaN or infinite numbers"):
        recording.read(3)


def test_a_sens_file_cut_short_or_damaged(tmp_path):
    path = make_sens(tmp_path / "scene.sens")
    whole, rng = path.read_bytes(), np.random.default_rng(1)
    path.write_bytes(whole[: len(whole) - 100])
    assert len(open_recording(path)) == 5
    path.write_bytes(whole[:200])
    with pytest.raises(InputError, match=r"scene\.sens: ends within its header"):
        open_recording(path)
    for trial in range(60):
        data = bytearray(whole)
        for at in rng.integers(4, 400 if trial % 2 else len(data), 1 << (trial % 6)):
            data[at] = rng.integers(256)
        path.write_bytes(data)
        try:
            said = [one.reason for one in open_recording(path).iterate(prefetch=False) if isinstance(one, SkippedFrame)]
        except InputError as error:
            said = [str(error)]
        assert all("\n" not in one for one in said)


def make_bop(scene, frames=4):
    cameras = {}
    for k in range(frames):
        write_image(scene / "rgb" / f"{k:06d}.png", color_image(k))
        write_image(scene / "depth" / f"{k:06d}.png", depth_image(k, 10000))
        T = np.linalg.inv(matrix_at(0.1 * k))
        pose = {"cam_R_w2c": T[:3, :3].ravel().tolist(), "cam_t_w2c": (1000 * T[:3, 3]).tolist()}
        cameras[str(k)] = {"cam_K": [60.0, 0, 31.5, 0, 61.0, 23.5, 0, 0, 1], "depth_scale": 0.1} | pose
    (scene / "scene_camera.json").write_text(json.dumps(cameras))
    return scene


def test_bop(tmp_path):
    scene = make_bop(tmp_path / "000001")
    cameras = json.loads((scene / "scene_camera.json").read_text())
    cameras["1"]["cam_K"][0] = 99.0
    del cameras["2"]["cam_t_w2c"], cameras["3"]
    (scene / "scene_camera.json").write_text(json.dumps(cameras))
    recording = open_recording(scene)
    assert (recording.format, len(recording)) == ("bop", 4)
    assert recording.intrinsics == Intrinsics(60, 61, 31.5, 23.5, 64, 48)
    frame = recording.read(0)
    assert frame.depth_m[0, 1] == pytest.approx(1.0)
    np.testing.assert_allclose(frame.T_world_camera, matrix_at(0.0), atol=1e-9)
    for number, reason in (
        (1, "image 1 has a camera or a depth scale of its own"),
        (2, r"scene_camera\.json has no pose of image 2"),
        (3, r"scene_camera\.json has no (pose|camera) of image 3"),
    ):
        with pytest.raises(FrameError, match=reason):
            recording.read(number)
    (scene / "scene_camera.json").write_text('{"0": {"cam_K": [1]}}')
    with pytest.raises(InputError, match="image 0: expected 'cam_K' with 9 numbers, row by row"):
        open_recording(scene)


TRANSFORMS = {"fl_x": 60.0, "fl_y": 61.0, "cx": 32.0, "cy": 24.0, "w": 64, "h": 48}


def make_nerf(scene, frames=3, document=TRANSFORMS, shape=(48, 64)):
    listed = []
    for k in reversed(range(frames)):  # in any order
        write_image(scene / "images" / f"frame_{k:05d}.png", color_image(k))
        write_image(scene / "depth" / f"frame_{k:05d}.png", depth_image(k, 1000, shape))
        T = matrix_at(0.1 * k) @ np.diag([1.0, -1, -1, 1])
        name = f"frame_{k:05d}.png"
        paths = {"file_path": f"images/{name}", "depth_file_path": f"depth/{name}"}
        listed.append(paths | {"transform_matrix": T.tolist()})
    (scene / "transforms.json").write_text(json.dumps(document | {"frames": listed}))
    return scene


def test_nerfstudio(tmp_path):
    recording = open_recording(make_nerf(tmp_path / "scene"))
    assert (recording.format, len(recording)) == ("nerfstudio", 3)
    assert recording.intrinsics == Intrinsics(60, 61, 31.5, 23.5, 64, 48)
    frame = recording.read(2)
    np.testing.assert_allclose(frame.T_world_camera, matrix_at(0.2), atol=1e-8)
    assert frame.depth_m[0, 1] == pytest.approx(1.02)


def test_nerfstudio_with_coarse_depth_and_its_own_scale(tmp_path):
    document = TRANSFORMS | {"depth_unit_scale_factor": 0.0005}
    recording = open_recording(make_nerf(tmp_path / "scene", document=document, shape=(24, 32)))
    assert recording.depth_camera.size == (32, 24)
    depth_m = recording.read(0).depth_m
    assert depth_m.shape == (48, 64)
    assert depth_m[24, 10] == pytest.approx(0.5)
    assert (depth_m[2:-2, 4:28] > 0).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"frames": []}, "expected 'frames'"),
        ({"frames": [{"file_path": "images/0.png"}]}, "no frame has a 'depth_file_path': the scene is without depth"),
        ({"w": None}, "'width' must be a number above 0, got None"),
        ({"depth_unit_scale_factor": -1}, "'depth_unit_scale_factor' must be a number above 0"),
    ],
)
def test_faulty_transforms_are_named(tmp_path, change, says):
    scene = make_nerf(tmp_path / "scene")
    document = json.loads((scene / "transforms.json").read_text()) | change
    (scene / "transforms.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=says):
        open_recording(scene)


def test_a_frame_with_no_matrix_or_another_camera_is_skipped(tmp_path):
    scene = make_nerf(tmp_path / "scene")
    document = json.loads((scene / "transforms.json").read_text())
    document["frames"][0]["transform_matrix"] = "x"
    document["frames"][1]["fl_x"] = 99.0
    (scene / "transforms.json").write_text(json.dumps(document))
    recording = open_recording(scene)
    with pytest.raises(FrameError, match="'transform_matrix' is no 4x4 matrix"):
        recording.read(2)
    with pytest.raises(FrameError, match=r"has a camera of its own \(fl_x\)"):
        recording.read(1)
    recording.read(0)
