from __future__ import annotations

import json

import numpy as np
import pytest
from made_recordings import CAMERA, NO_TURN, color_image, make_plain

from cuboid.errors import FrameError, InputError
from cuboid.frame import Intrinsics
from cuboid.readers import open_recording


def test_a_whole_recording(plain):
    recording = open_recording(plain.path)
    assert (recording.format, recording.path, len(recording)) == ("plain", plain.path, 5)
    assert recording.intrinsics == Intrinsics(**CAMERA)
    assert recording.has_poses
    assert not recording.has_timestamps
    frame = recording.read(3)
    assert (frame.index, frame.timestamp_s) == (3, pytest.approx(0.1))
    np.testing.assert_array_equal(frame.color, color_image(3))
    np.testing.assert_allclose(frame.depth_m[5, [0, 1, 40]], [0, 1.03, 2.0], rtol=1e-6)
    assert frame.depth_m.dtype == np.float32
    np.testing.assert_allclose(frame.T_world_camera[:3, 3], [0.3, 0, 0])


def test_no_poses_file_is_a_recording_without_poses(tmp_path):
    recording = open_recording(make_plain(tmp_path, poses=False).path)
    assert not recording.has_poses
    assert recording.read(0).T_world_camera is None


def test_numbers_put_files_together(plain):
    """Frame 1's images are gone, depth has names of its own: the numbers decide, not the order."""
    plain.color(1).unlink()
    plain.depth(1).unlink()
    plain.depth(2).rename(plain.depth(2).with_name("depth_2.png"))
    recording = open_recording(plain.path)
    assert len(recording) == 4
    frame = recording.read(1)
    assert frame.color[0, 0, 1] == 12
    assert frame.depth_m[0, 1] == pytest.approx(1.02)
    assert frame.T_world_camera[0, 3] == pytest.approx(0.2)


def test_times_from_a_file_or_from_the_names(plain):
    times = plain.path / "timestamps.txt"
    times.write_text("".join(f"{k} {100 + 0.5 * k}\n" for k in range(5)))
    recording = open_recording(plain.path)
    assert recording.has_timestamps
    assert recording.read(2).timestamp_s == 101.0

    times.unlink()
    lines = []
    for k in range(5):
        for file in (plain.color(k), plain.depth(k)):
            file.rename(file.with_name(f"{7 + k / 4}.png"))
        lines.append(f"{7 + k / 4} {k} 0 0 {NO_TURN}")
    (plain.path / "poses.txt").write_text("\n".join(lines))
    frame = open_recording(plain.path).read(3)
    assert frame.timestamp_s == 7.75
    assert frame.T_world_camera[0, 3] == 3


def test_fewer_pose_lines_than_frames(plain):
    poses = plain.path / "poses.txt"
    poses.write_text("\n".join(poses.read_text().splitlines()[:4]))
    recording = open_recording(plain.path)
    recording.read(2)
    with pytest.raises(FrameError, match=r"poses\.txt has no line for frame number 3 \(3 lines, 5 frames\)"):
        recording.read(3)
    assert recording.without_poses().read(3).T_world_camera is None


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("2 nan 0 0 0 0 0 1", "line 3: the pose has NaN or infinite numbers"),
        ("2 0 0 0 0 0 0 inf", "line 3: the pose has NaN or infinite numbers"),
        ("2 0 0 0 0 0 0 0", "line 3: the quaternion has length 0, expected 1"),
        ("2 0 0 0 0.5 0.5 0 1.5", "quaternion has length 1.66"),
    ],
)
def test_a_bad_pose_is_a_bad_frame(plain, line, reason):
    poses = plain.path / "poses.txt"
    lines = poses.read_text().splitlines()[1:]
    poses.write_text("\n".join([*lines[:2], line, *lines[3:]]))
    recording = open_recording(plain.path)
    with pytest.raises(FrameError, match=reason):
        recording.read(2)
    recording.read(3)


def test_rounded_quaternions_are_normalised(plain):
    (plain.path / "poses.txt").write_text("0 0 0 0 0.7071 0 0 0.7072")
    R = open_recording(plain.path).read(0).T_world_camera[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R @ [0, 1, 0], [0, 0, 1], atol=2e-4)


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("poses.txt", "0 0 0 0 0 0 1", r"poses\.txt line 1: expected number tx ty tz qx qy qz qw, got '0 0"),
        ("poses.txt", "zero 0 0 0 0 0 0 1", r"poses\.txt line 1: expected number"),
        ("poses.txt", "0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1", "line 2: a second line for frame number 0"),
        ("poses.txt", "99.5 0 0 0 0 0 0 1", r"no line begins with the number of a frame; .* 99\.5.*are 0"),
        ("poses.txt", "# nothing\n", "it has no lines"),
        ("timestamps.txt", "0 1.0\n", "no line for frame number 1"),
        ("camera.json", "{", r"camera\.json: is not JSON: truncated"),
        ("camera.json", "[]", "expected an object with fx, fy"),
        ("camera.json", json.dumps(CAMERA), r"the depth scale is not known.*--depth-scale"),
        ("camera.json", json.dumps(CAMERA | {"fy": 0}), "fy: expected a number of at least 0.001, got 0"),
        ("camera.json", json.dumps(CAMERA | {"cx": "left"}), "cx: expected a number, got 'left'"),
        ("camera.json", json.dumps(CAMERA | {"width": 64.5}), "width: expected a whole number, got 64.5"),
        ("camera.json", json.dumps(CAMERA | {"depth_scale": 1}), "field 'depth_scale' is unknown, expected fx"),
        ("camera.json", json.dumps({"fx": 60}), "'fy' is missing"),
    ],
)
def test_faulty_files_are_named(plain, name, text, reason):
    (plain.path / name).write_text(text)
    with pytest.raises(InputError, match=reason) as raised:
        open_recording(plain.path)
    assert "\n" not in str(raised.value)


def test_names_without_number_or_with_the_same_one(plain):
    odd = plain.color(0).with_name("left.png")
    plain.color(0).rename(odd)
    with pytest.raises(InputError, match=r"left\.png: the name must end with the frame's number"):
        open_recording(plain.path)
    odd.rename(odd.with_name("1.png"))
    with pytest.raises(InputError, match=r"000001\.png and 1\.png have the same number"):
        open_recording(plain.path)


def test_folders_without_images(tmp_path):
    (tmp_path / "color").mkdir()
    (tmp_path / "depth").mkdir()
    with pytest.raises(InputError, match="hold no images"):
        open_recording(tmp_path)
