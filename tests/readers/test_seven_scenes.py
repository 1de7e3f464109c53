from __future__ import annotations

import cv2
import numpy as np
import pytest
from made_recordings import Made, depth_image, write_frames, write_image

from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.readers import open_recording

MATRIX = "60 0 31.5\n0 61 23.5\n0 0 1\n"


def make_sequence(folder, frames=4, shape=(48, 64)):
    made = Made(
        folder,
        lambda k: folder / f"frame-{k:06d}.color.png",
        lambda k: folder / f"frame-{k:06d}.depth.png",
        1000.0,
    )
    write_frames(made, frames, shape)
    for k in range(frames):
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


def test_rounding_of_a_matrix_is_mended(tmp_path):
    made = make_sequence(tmp_path)
    (tmp_path / "camera-intrinsics.txt").write_text(MATRIX)
    turned = np.eye(4)
    turned[:3, :3] = cv2.Rodrigues(np.array([0.3, -0.5, 0.2]))[0]
    np.savetxt(pose_file(made, 0), turned, fmt="%.3f")
    T = open_recording(tmp_path).read(0).T_world_camera
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(T, turned, atol=1e-3)
