from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_recordings import CAMERA, NO_TURN, Made, write_frames

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Intrinsics, SkippedFrame
from cuboid.inputs.readers import open_recording
from cuboid.inputs.readers.recording import PoseClock
from cuboid.inputs.readers.tum import associate


def make_tum(root, name="desk", frames=5, depth_later_s=0.01):
    folder = root / name
    made = Made(folder, lambda k: folder / "rgb" / f"{k}.png", lambda k: folder / "depth" / f"{k}.png", 5000.0)
    write_frames(made, frames)
    write_list(made, "rgb", [(k / 30, k) for k in range(frames)])
    write_list(made, "depth", [(k / 30 + depth_later_s, k) for k in range(frames)])
    (folder / "camera.json").write_text(json.dumps(CAMERA))
    return made


def write_list(made, kind, times):
    lines = [f"{time_s:.6f} {kind}/{k}.png" for time_s, k in times]
    (made.path / f"{kind}.txt").write_text("# timestamp filename\n" + "\n".join(lines) + "\n")


def write_poses(made, rows):
    text = "\n".join(" ".join(map(str, row)) if not isinstance(row, str) else row for row in rows)
    (made.path / "groundtruth.txt").write_text(f"# comment\n{text}\n")


def test_the_real_recording(data_dir):
    recording = open_recording(data_dir / "rgbd_dataset_freiburg1_xyz")
    assert (recording.format, len(recording)) == ("tum", 400)
    assert recording.intrinsics == Intrinsics(517.3, 516.5, 318.6, 255.3, 640, 480)
    assert recording.distortion == (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
    assert recording.has_poses
    assert recording.has_timestamps
    frame = recording.read(0)
    # Depth 1305031102.160407 belongs to color 1305031102.175304; poses lie at .1557 and .1658 around it.
    assert frame.timestamp_s == pytest.approx(1305031102.160407, abs=1e-6)
    truth = np.loadtxt(recording.path / "groundtruth.txt")
    around = truth[np.abs(truth[:, 0] - frame.timestamp_s) < 0.011, 1:4]
    T = frame.T_world_camera
    assert (T[:3, 3] >= around.min(axis=0) - 1e-9).all()
    assert (T[:3, 3] <= around.max(axis=0) + 1e-9).all()
    bad = [item for item in recording.iterate(every=20, limit=10) if isinstance(item, SkippedFrame)]
    assert not bad


def test_color_without_depth_nearby_is_a_bad_frame(data_dir):
    recording = open_recording(data_dir / "rgbd_dataset_freiburg1_xyz")
    with pytest.raises(FrameError, match=r"color without depth: none within 20 ms of rgb/1305031102\.243211\.jpg"):
        recording.read(2)


def test_time_and_pose_are_those_of_the_depth_image(tmp_path):
    made = make_tum(tmp_path)
    half_turn = (0, 0, 1, 0)
    write_poses(made, [(0.0, 0, 0, 0, 0, 0, 0, 1), (0.08, 0.8, 0, 0, *half_turn), (0.2, 2, 0, 0, *half_turn)])
    recording = open_recording(made.path)
    frame = recording.read(0)
    assert frame.timestamp_s == pytest.approx(0.01)
    T = frame.T_world_camera
    assert T[0, 3] == pytest.approx(0.1)
    assert np.degrees(np.arctan2(T[1, 0], T[0, 0])) == pytest.approx(180 / 8)


def test_frames_far_from_any_pose_in_time_have_none(tmp_path):
    made = make_tum(tmp_path)  # depth at 10, 43, 77, 110, 143 ms
    write_poses(made, [(-0.005, 1, 0, 0, *NO_TURN.split()), (0.15, 2, 0, 0, *NO_TURN.split())])
    recording = open_recording(made.path)
    assert recording.read(0).T_world_camera[0, 3] == 1
    assert recording.read(4).T_world_camera[0, 3] == 2
    reason = r"no camera pose at 0\.077 s: the nearest in groundtruth\.txt is 0\.073 s away \(at most 0\.02 s"
    with pytest.raises(FrameError, match=reason):
        recording.read(2)
    assert recording.without_poses().read(2).T_world_camera is None


def test_poses_that_are_none_are_gaps(tmp_path):
    made = make_tum(tmp_path)
    identity = "0 0 0 0 0 0 1"
    write_poses(made, [f"0.0 {identity}", "0.01 nan 0 0 0 0 0 1", "0.02 5 0 0 0 0 0 0", f"0.04 {identity}"])
    np.testing.assert_allclose(open_recording(made.path).read(0).T_world_camera, np.eye(4), atol=1e-12)


def test_color_at_twice_the_rate_gives_no_bad_frames(tmp_path):
    made = make_tum(tmp_path, frames=8, depth_later_s=0)
    write_list(made, "depth", [(k / 30, k) for k in range(0, 8, 2)])
    items = list(open_recording(made.path).iterate())
    assert [item.color[0, 0, 1] for item in items] == [10, 12, 14, 16]


def test_intrinsics_of_another_camera_must_be_given(tmp_path):
    made = make_tum(tmp_path)
    (made.path / "camera.json").unlink()
    with pytest.raises(InputError, match="the intrinsics are not known; give them with --intrinsics"):
        open_recording(made.path)
    (made.path / "camera-intrinsics.txt").write_text("50 0 32\n0 51 24\n0 0 1\n")
    assert open_recording(made.path).intrinsics == Intrinsics(50, 51, 32, 24, 64, 48)


times = st.lists(st.integers(0, 300).map(lambda ms: ms / 1000), max_size=12)


@given(times, times)
def test_association_is_one_to_one_near_and_misses_nobody(a, b):
    pairs = associate(a, b, 0.02)
    assert len(set(pairs.values())) == len(pairs)
    assert all(abs(a[i] - b[j]) <= 0.02 + 1e-9 for i, j in pairs.items())
    lonely_a = [t for i, t in enumerate(a) if i not in pairs]
    lonely_b = [t for j, t in enumerate(b) if j not in pairs.values()]
    assert all(abs(x - y) > 0.02 - 1e-9 for x in lonely_a for y in lonely_b)


def test_the_nearest_in_time_find_each_other():
    assert associate([0.0, 0.033], [0.015, 0.031], 0.02) == {0: 0, 1: 1}
    assert associate([0.0, 0.012], [0.013], 0.02) == {1: 0}


def test_an_offset_is_added_to_the_times_of_poses(tmp_path):
    """Poses 12 ms later: each frame gets the pose of 12 ms before its time, from the poses' own times."""
    made = make_tum(tmp_path)
    write_poses(made, [(k / 100, k / 100, 0, 0, 0, 0, 0, 1) for k in range(-3, 30)])
    recording = open_recording(made.path)
    moved = recording.with_pose_clock(PoseClock(added_s=0.012))
    for k in range(5):
        assert moved.read(k).T_world_camera[0, 3] == pytest.approx(recording.timestamp_s(k) - 0.012)
        assert recording.read(k).T_world_camera[0, 3] == pytest.approx(recording.timestamp_s(k))
    with pytest.raises(FrameError, match=r"no camera pose at .* s: the nearest in groundtruth.txt"):
        recording.with_pose_clock(PoseClock(added_s=0.2)).read(0)
