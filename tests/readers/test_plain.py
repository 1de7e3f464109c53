from __future__ import annotations

import numpy as np
import pytest
from made_recordings import CAMERA, NO_TURN, color_image, make_plain, write_image

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.readers import open_recording
from cuboid.inputs.readers.recording import PoseClock


def test_a_whole_recording(plain):
    recording = open_recording(plain.path)
    assert (recording.format, recording.path, len(recording)) == ("plain", plain.path, 5)
    assert recording.intrinsics == Intrinsics(**CAMERA)
    assert recording.has_poses
    assert not recording.has_timestamps
    assert recording.warnings == ()
    frame = recording.read(3)
    assert (frame.index, frame.timestamp_s) == (3, pytest.approx(0.1))
    np.testing.assert_array_equal(frame.color, color_image(3))
    np.testing.assert_allclose(frame.depth_m[5, [0, 1, 40]], [0, 1.03, 2.0], rtol=1e-6)
    assert frame.depth_m.dtype == np.float32
    np.testing.assert_allclose(frame.T_world_camera[:3, 3], [0.3, 0, 0])


@pytest.mark.parametrize("name", ["groundtruth.txt", "Poses.txt", "poses.csv", "pose/", "sparse/"])
def test_poses_in_another_place_are_not_left_out_in_silence(tmp_path, name):
    path = make_plain(tmp_path, poses=False).path
    if name.endswith("/"):
        (path / name).mkdir()
    else:
        (path / name).write_text("0 0 0 0 0 0 0 1\n")
    assert open_recording(path).warnings == (
        "the recording counts as one without poses: the layout 'plain' does not read "
        f"{name.rstrip('/')}; docs/recordings.md says where it expects poses",
    )


def test_other_pose_files_beside_the_poses_are_no_matter(plain):
    (plain.path / "trajectory.txt").write_text("")
    assert open_recording(plain.path).warnings == ()


def test_numbers_put_files_together(plain):
    """Frame 1's images are gone, depth has names of its own: the numbers decide, not the order."""
    plain.color(1).unlink()
    plain.depth(1).unlink()
    for k in (0, 2, 3, 4):
        plain.depth(k).rename(plain.depth(k).with_name(f"depth_{k}.png"))
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


def test_rounded_quaternions_are_normalised(plain):
    (plain.path / "poses.txt").write_text("0 0 0 0 0.7071 0 0 0.7072")
    R = open_recording(plain.path).read(0).T_world_camera[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R @ [0, 1, 0], [0, 0, 1], atol=2e-4)


@pytest.mark.parametrize("stray", ["._000000.png", "preview.png", "304.j.jpg", "000001 (1).png", "depth_2.png"])
def test_a_stray_image_is_left_out_and_named(plain, stray):
    write_image(plain.color(0).with_name(stray), color_image(0))
    for name in ("Thumbs.db", ".DS_Store"):
        plain.depth(0).with_name(name).write_bytes(b"no image")
    recording = open_recording(plain.path)
    assert len(recording) == 5
    assert recording.warnings == (f"1 image left out, whose name does not fit those of the others: color/{stray}",)


def test_two_names_with_the_same_number(plain):
    plain.color(0).rename(plain.color(0).with_name("1.png"))
    with pytest.raises(InputError, match=r"color: (000001\.png and 1|1\.png and 000001)\.png have the same number"):
        open_recording(plain.path)


def _renamed(plain, color, depth, name):
    """Move the images to folders of these names, and name image k of a folder `name(folder, k)`."""
    for old, new in (("color", color), ("depth", depth)):
        for k in range(5):
            (plain.path / old / f"{k:06d}.png").rename(plain.path / old / name(new, k))
        (plain.path / old).rename(plain.path / new)
    return plain.path


@pytest.mark.parametrize(
    ("color", "depth"),
    [("rgb", "depth"), ("images", "depths"), ("color", "depth"), ("RGB", "Depth"), ("img", "depth_maps")],
)
def test_folders_by_the_names_that_people_give_them(plain, color, depth):
    path = _renamed(plain, color, depth, lambda _, k: f"{k}.png")
    recording = open_recording(path)
    assert (recording.format, len(recording), recording.warnings) == ("plain", 5, ())
    assert recording.read(3).depth_m[5, 1] == pytest.approx(1.03)
    assert recording.read(3).T_world_camera[0, 3] == pytest.approx(0.3)


@pytest.mark.parametrize(
    "name",
    [
        lambda folder, k: f"{folder}_{k + 8}.png",  # 8, 9, 10: not the order of the characters
        lambda folder, k: f"cam1-{k:03d}-{folder}.png",
        lambda folder, k: f"2024-03-01_{k:06d}_{folder}.png",
        lambda folder, k: f"{k:07d}-{1000 * k + (7 if folder == 'rgb' else 0):012d}.png",
        lambda folder, k: f"{'abcde'[k]}.png",
    ],
)
def test_names_of_any_form_pair_color_with_its_depth(plain, name):
    (plain.path / "poses.txt").unlink()
    recording = open_recording(_renamed(plain, "rgb", "depth", name))
    assert (len(recording), recording.warnings) == (5, ())
    for k in range(5):
        frame = recording.read(k)
        assert (frame.color[0, 0, 1], frame.depth_m[5, 1]) == (10 + k, pytest.approx(1 + 0.01 * k))


def test_images_whose_numbers_never_agree_are_paired_by_order(plain):
    path = _renamed(plain, "rgb", "depth", lambda folder, k: f"{k + 100 * (folder == 'depth')}.png")
    recording = open_recording(path)
    assert recording.warnings == (
        "color and depth are paired by order, no number in their names agrees: rgb/0.png with depth/100.png, ...",
    )
    assert recording.read(3).depth_m[5, 1] == pytest.approx(1.03)
    assert recording.read(3).T_world_camera[0, 3] == pytest.approx(0.3)


def test_images_that_cannot_be_paired_are_named(plain):
    path = _renamed(plain, "rgb", "depth", lambda folder, k: f"{k + 100 * (folder == 'depth')}.png")
    (path / "depth" / "102.png").unlink()
    with pytest.raises(
        InputError, match=r"rgb/ \(5: 0\.png to 4\.png\) and depth/ \(4: 100\.png to 104\.png\) cannot be"
    ):
        open_recording(path)


@pytest.mark.parametrize("form", ["{:.6f}", "{:.0f}000000000"])
def test_times_in_the_names_pair_the_nearest(plain, form):
    (plain.path / "poses.txt").unlink()
    shift = {"rgb": 0.0, "depth": 0.004 if "6" in form else 0.0}
    path = _renamed(plain, "rgb", "depth", lambda folder, k: form.format(1305031102 + k + shift[folder]) + ".png")
    (path / "depth" / (form.format(1305031104 + shift["depth"]) + ".png")).unlink()
    recording = open_recording(path)
    assert (len(recording), recording.has_timestamps) == (5, True)
    assert recording.timestamp_s(3) - recording.timestamp_s(0) == pytest.approx(3)
    assert recording.read(3).depth_m[5, 1] == pytest.approx(1.03)
    with pytest.raises(FrameError, match="color without depth: rgb/"):
        recording.read(2)


def test_depth_in_other_files_says_what_is_there(plain):
    for k in range(5):
        plain.depth(k).rename(plain.depth(k).with_suffix(".npy"))
    with pytest.raises(InputError, match=r"depth/ holds no images \(\.png, \.jpg, \.jpeg\), but 5 \.npy$"):
        open_recording(plain.path)


def test_folders_without_images(tmp_path):
    (tmp_path / "color").mkdir()
    (tmp_path / "depth").mkdir()
    with pytest.raises(InputError, match="hold no images"):
        open_recording(tmp_path)


def test_poses_and_times_without_frame_numbers_are_in_the_order_of_the_frames(plain):
    for name in ("poses.txt", "timestamps.txt"):
        lines = (plain.path / name).read_text().splitlines() if (plain.path / name).is_file() else []
        if name == "timestamps.txt":
            lines = [f"{k} {0.25 * k}" for k in range(len(open_recording(plain.path)))]
        kept = [line.split(maxsplit=1)[1] for line in lines if not line.startswith("#")]
        before = open_recording(plain.path)
        (plain.path / name).write_text("\n".join(kept) + "\n")
        after = open_recording(plain.path)
        np.testing.assert_array_equal(after.pose(2), before.pose(2))
        assert any(f"{name}: its lines have no frame numbers" in warning for warning in after.warnings)
    assert after.timestamp_s(2) == 0.5
    (plain.path / "poses.txt").write_text("\n".join(["0 0 0 0 0 0 1"] * (len(after) - 1)))
    with pytest.raises(InputError, match="expected number tx ty tz"):
        open_recording(plain.path)


def test_an_offset_shifts_poses_without_times_along_their_path(tmp_path):
    """`poses.txt` has a pose for each frame: with an offset it is interpolated between those of two frames."""
    made = make_plain(tmp_path)
    recording = open_recording(made.path)
    moved = recording.with_pose_clock(PoseClock(added_s=0.5 / 30))
    poses = [recording.pose(k) for k in range(len(recording))]
    assert moved.pose(2)[:3, 3] == pytest.approx(0.5 * (poses[1] + poses[2])[:3, 3])
    assert moved.without_poses().pose(2) is None
