from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from made_recordings import CAMERA, Made, depth_image, write_frames, write_image

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.readers import open_recording

MATRIX = "60 0 31.5\n0 61 23.5\n0 0 1\n"


def make_sequence(folder, frames=4, poses=True, shape=(48, 64)):
    made = Made(
        folder,
        lambda k: folder / f"frame-{k:06d}.color.png",
        lambda k: folder / f"frame-{k:06d}.depth.png",
        1000.0,
    )
    write_frames(made, frames, shape)
    for k in range(frames if poses else 0):
        T = np.eye(4)
        T[0, 3] = k
        np.savetxt(pose_file(made, k), T)
    return made


def pose_file(made, k):
    return made.path / f"frame-{k:06d}.pose.txt"


@pytest.mark.parametrize("named", [".", "chess", "chess/seq-01"])
def test_a_sequence_by_whatever_folder_is_named(tmp_path, named):
    made = make_sequence(tmp_path / "chess" / "seq-01")
    (tmp_path / "chess" / "camera-intrinsics.txt").write_text(MATRIX)
    recording = open_recording(tmp_path / named)
    assert (recording.format, recording.path, len(recording)) == ("7-scenes", made.path, 4)
    assert recording.intrinsics == Intrinsics(60, 61, 31.5, 23.5, 64, 48)
    assert recording.read(2).T_world_camera[0, 3] == 2
    assert recording.read(2).depth_m[0, 1] == pytest.approx(1.02)


def test_as_published_depth_is_carried_into_color_and_poses_become_the_color_cameras(tmp_path):
    made = make_sequence(tmp_path, frames=2, shape=(480, 640))
    wall = np.full((480, 640), 2000, np.uint16)
    wall[200:280, 280:360] = 0  # a hole tells where things go
    for k in range(2):
        write_image(made.depth(k), wall)
    recording = open_recording(tmp_path)
    assert recording.intrinsics == Intrinsics(525, 525, 320, 240, 640, 480)
    frame = recording.read(1)
    rows, columns = np.nonzero(frame.depth_m[100:380, 100:540] == 0)
    # where color shows the edges of depth: u_depth = 1.11 u_color - 29, v_depth = 1.11 v_color - 24
    assert columns.min() + 100 == pytest.approx((280 + 29) / 1.11, abs=3)
    assert columns.max() + 100 == pytest.approx((359 + 29) / 1.11, abs=3)
    assert rows.min() + 100 == pytest.approx((200 + 24) / 1.11, abs=3)
    assert rows.max() + 100 == pytest.approx((279 + 24) / 1.11, abs=3)
    assert frame.depth_m[240, 150] == pytest.approx(2.0, abs=0.01)
    # the pose in the file is the depth camera's, at x = 1; the color camera is 2.5 cm to its right
    np.testing.assert_allclose(frame.T_world_camera[:3, 3], [1.025, 0, 0], atol=1e-9)
    seen, u, v = frame.depth_m[300, 400], 400, 300
    point = frame.T_world_camera @ [(u - 320) / 525 * seen, (v - 240) / 525 * seen, seen, 1]
    assert point[2] == pytest.approx(2.0, abs=0.002)  # the wall stands 2 m from where the depth camera was


@pytest.mark.parametrize("how", ["file", "user"])
def test_with_a_camera_of_its_own_it_counts_as_registered(tmp_path, how):
    made = make_sequence(tmp_path, frames=1, shape=(480, 640))
    if how == "file":
        (tmp_path / "camera-intrinsics.txt").write_text("585 0 320\n0 585 240\n0 0 1\n")
    recording = open_recording(tmp_path, intrinsics=(585, 585, 320, 240) if how == "user" else None)
    assert recording.depth_camera is None
    frame = recording.read(0)
    stored = cv2.imread(str(made.depth(0)), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(frame.depth_m, (stored / 1000).astype(np.float32))
    assert np.array_equal(frame.T_world_camera, np.eye(4))


def test_0_and_65535_are_no_reading(tmp_path):
    made = make_sequence(tmp_path)
    (tmp_path / "camera-intrinsics.txt").write_text(MATRIX)
    depth = depth_image(0, 1000)
    depth[:10, :10] = 65535
    write_image(made.depth(0), depth)
    depth_m = open_recording(tmp_path).read(0).depth_m
    assert (depth_m[:10, :10] == 0).all()
    assert depth_m[20, 0] == 0
    assert depth_m.max() == 2


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("inf inf inf inf\n" * 4, r"frame-000001\.pose\.txt: the pose has NaN or infinite numbers"),
        ("nan 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "the pose has NaN or infinite numbers"),
        ("2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n", r"frame-000001\.pose\.txt: the pose is not rigid"),
        ("-1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "the pose is not rigid"),
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n", "expected the 16 numbers of a 4x4 matrix"),
        ("", "expected the 16 numbers of a 4x4 matrix"),
        (None, r"the camera pose is missing: frame-000001\.pose\.txt"),
    ],
)
def test_a_lost_frame_is_a_bad_frame(tmp_path, text, reason):
    made = make_sequence(tmp_path)
    (tmp_path / "camera-intrinsics.txt").write_text(MATRIX)
    if text is None:
        pose_file(made, 1).unlink()
    else:
        pose_file(made, 1).write_text(text)
    recording = open_recording(tmp_path)
    with pytest.raises(FrameError, match=reason):
        recording.read(1)
    recording.read(2)
    recording.without_poses().read(1)


def test_rounding_of_a_matrix_is_mended(tmp_path):
    made = make_sequence(tmp_path)
    (tmp_path / "camera-intrinsics.txt").write_text(MATRIX)
    turned = np.eye(4)
    turned[:3, :3] = cv2.Rodrigues(np.array([0.3, -0.5, 0.2]))[0]
    np.savetxt(pose_file(made, 0), turned, fmt="%.3f")
    T = open_recording(tmp_path).read(0).T_world_camera
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(T, turned, atol=1e-3)


def test_no_pose_files_are_a_recording_without_poses(tmp_path):
    make_sequence(tmp_path, poses=False)
    recording = open_recording(tmp_path, intrinsics=(60, 60, 32, 24))
    assert not recording.has_poses
    assert recording.read(0).T_world_camera is None


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("60 0 31.5\n0 61 23.5\n", "expected a 3x3 camera matrix, got 2 rows"),
        ("60 0\n0 61\n", r"camera-intrinsics\.txt:1: expected first second third, got 2 values"),
        ("60 5 31.5\n0 61 23.5\n0 0 1\n", "expected the matrix fx 0 cx, 0 fy cy, 0 0 1"),
        (
            "600 0 320\n0 600 240\n0 0 1\n",
            r"principal point \(320, 240\), from camera-intrinsics\.txt, lies out",
        ),
    ],
)
def test_faulty_matrix_files_are_named(tmp_path, text, reason):
    make_sequence(tmp_path)
    (tmp_path / "camera-intrinsics.txt").write_text(text)
    with pytest.raises(InputError, match=reason):
        open_recording(tmp_path)


def test_camera_json_of_another_size(tmp_path):
    make_sequence(tmp_path)
    (tmp_path / "camera.json").write_text(json.dumps(CAMERA | {"width": 640, "height": 480}))
    with pytest.raises(InputError, match=r"images are 64x48, but the intrinsics \(camera\.json\) are for 640x480"):
        open_recording(tmp_path)
