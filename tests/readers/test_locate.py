from __future__ import annotations

import os
from importlib.metadata import EntryPoint, EntryPoints

import numpy as np
import pytest
from made_recordings import color_image, depth_image, make_plain, write_image

from cuboid.ground.core.errors import FrameError, InputError, OutputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.readers import READERS, Calibration, FrameEntry, Listing, Reader, open_recording
from cuboid.inputs.readers.calibration import write_camera


def read_npz(path):
    """List the frames of a recording that is one file; the second one is broken."""
    arrays = np.load(path)

    def broken():
        raise FrameError("block 2 is damaged")

    frames = [FrameEntry(lambda: arrays["color"], lambda: arrays["depth"], timestamp_s=5.0, pose=lambda: np.eye(4))]
    frames.append(FrameEntry(broken, lambda: arrays["depth"], timestamp_s=6.0))
    return Listing(frames, 1000.0, Calibration(60, 60, 32, 24, None, "the file"))


NPZ_READER = Reader("one .npz file", lambda path: path.suffix == ".npz", read_npz)


@pytest.fixture
def foreign_reader(monkeypatch):
    """A reader "npz" that another package names in its entry points."""
    point = EntryPoint("npz", f"{__name__}:NPZ_READER", "cuboid.readers")
    monkeypatch.setattr(
        "cuboid.ground.core.registry.entry_points", lambda group: EntryPoints([point]).select(group=group)
    )
    monkeypatch.setattr(READERS, "_scanned", False)
    monkeypatch.setattr(READERS, "_items", dict(READERS._items))


@pytest.mark.usefixtures("foreign_reader")
def test_a_reader_of_another_package_takes_part(tmp_path):
    file = tmp_path / "scan.npz"
    np.savez(file, color=color_image(1), depth=depth_image(1, 1000))
    recording = open_recording(file)
    assert (recording.format, len(recording), recording.has_timestamps) == ("npz", 2, True)
    frame = recording.read(0)
    assert frame.depth_m[0, 1] == pytest.approx(1.01)
    assert frame.timestamp_s == 5.0
    with pytest.raises(FrameError, match="the frame has no camera pose"):
        recording.read(1)
    with pytest.raises(FrameError, match="block 2 is damaged"):
        recording.without_poses().read(1)
    with pytest.raises(InputError, match=r"unknown format 'nothing'; there are: .*, npz, "):
        open_recording(file, format="nothing")


def _empty(tmp_path):
    folder = tmp_path / "empty"
    folder.mkdir()
    return folder


def test_absent_empty_and_unrecognised(tmp_path):
    with pytest.raises(InputError, match="nowhere does not exist"):
        open_recording(tmp_path / "nowhere")
    expected = r"a recording in one of \d+ forms is expected, such as plain .*; docs/rec.*"
    with pytest.raises(InputError, match=f"empty is empty; {expected}"):
        open_recording(_empty(tmp_path))
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(InputError, match=f"holds no recording; {expected}"):
        open_recording(tmp_path)
    with pytest.raises(InputError, match=f"notes.txt is a file; {expected}") as raised:
        open_recording(tmp_path / "notes.txt")
    assert "\n" not in str(raised.value)


def test_what_was_seen_and_which_layouts_are_near(plain):
    for k in range(5):
        plain.depth(k).rename(plain.path / f"{k}.tiff")
    (plain.path / "depth").rmdir()
    with pytest.raises(InputError, match="holds no recording") as raised:
        open_recording(plain.path)
    seen, *near = raised.value.__notes__
    assert seen == "seen: 5 .tiff, 1 .json, 1 .txt, 5 .png in color/"
    assert near[0] == "near: plain, but it lacks depth/ or depths/"
    assert near[1].startswith("near: open3d, but it lacks depth/, camera_intrinsic.json or trajectory.log")
    assert not any("tum" in note for note in near)  # nothing of it is there


@pytest.mark.parametrize("inside", ["color", "color/000001.png", "poses.txt"])
def test_a_part_of_a_recording_points_to_the_whole(plain, inside):
    with pytest.raises(InputError, match=f"is a part of a recording; name {plain.path}$"):
        open_recording(plain.path / inside)


def test_relative_paths_and_links(plain, tmp_path, monkeypatch):
    monkeypatch.chdir(plain.path)
    assert open_recording(".").path == plain.path
    (tmp_path / "link").symlink_to(plain.path)
    assert open_recording(os.fspath(tmp_path / "link")).path == tmp_path / "link"


def test_format_by_name(plain):
    assert open_recording(plain.path, format="plain").format == "plain"
    with pytest.raises(
        InputError, match=r"a recording of one of these forms is expected: tum \(rgb\.txt, depth\.txt\)\n"
    ):
        open_recording(plain.path, format="tum")
    with pytest.raises(InputError, match="unknown format 'bag'; there are: 3rscan, 7-scenes, "):
        open_recording(plain.path, format="bag")


def test_a_folder_of_two_forms_asks_which(plain):
    for name in ("rgb.txt", "depth.txt"):
        (plain.path / name).write_text("0 0.png\n")
    with pytest.raises(InputError, match="looks like 'plain' and 'tum'; say which with --format"):
        open_recording(plain.path)
    assert open_recording(plain.path, format="plain").format == "plain"


def test_many_recordings_are_cut_short(tmp_path):
    for k in range(10):
        make_plain(tmp_path / f"day-{k}", frames=1)
    with pytest.raises(InputError, match=r"holds 10 recordings, name one of them: day-0/mine.*day-7/mine and 2 more$"):
        open_recording(tmp_path)


def test_the_user_has_the_last_word(plain):
    recording = open_recording(plain.path, intrinsics=(50, 51, 30, 20), depth_scale=2000)
    assert (recording.intrinsics.fx, recording.intrinsics.cy) == (50, 20)
    assert recording.depth_units_per_metre == 2000
    assert recording.read(0).depth_m[0, 1] == pytest.approx(0.5)


def test_intrinsics_come_from_a_file_with_its_depth_scale(plain, tmp_path):
    file = tmp_path / "mine.json"
    write_camera(file, Intrinsics(51.5, 52.5, 30.25, 20.0, 64, 48), 4000.0)
    recording = open_recording(plain.path, intrinsics=file)
    assert recording.intrinsics == Intrinsics(51.5, 52.5, 30.25, 20.0, 64, 48)
    assert recording.depth_units_per_metre == 4000
    assert open_recording(plain.path, intrinsics=str(file), depth_scale=2000).depth_units_per_metre == 2000
    matrix = tmp_path / "matrix.txt"
    matrix.write_text("60 0 31\n0 61 22\n0 0 1\n")
    assert open_recording(plain.path, intrinsics=matrix).intrinsics.fy == 61
    with pytest.raises(InputError, match=r"none\.json: cannot be read"):
        open_recording(plain.path, intrinsics=tmp_path / "none.json")
    write_camera(file, Intrinsics(51.5, 52.5, 30.25, 20.0, 128, 96), 4000.0)
    with pytest.raises(InputError, match=r"are 64x48, but the intrinsics \(mine\.json\) are for 128x96"):
        open_recording(plain.path, intrinsics=file)


def test_a_camera_that_cannot_be_written_is_one_line(tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        write_camera(tmp_path / "no" / "camera.json", Intrinsics(1, 1, 0, 0, 2, 2), 1000)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"intrinsics": (1, 2, 3)}, "intrinsics must be four numbers fx, fy, cx, cy"),
        ({"intrinsics": (0, 2, 3, 3)}, "fx, fy > 0"),
        ({"intrinsics": (60, 60, float("nan"), 3)}, "four numbers"),
        (
            {"intrinsics": (500, 500, 320, 240)},
            r"principal point \(320, 240\), from the user, lies outside the 64x48",
        ),
        ({"intrinsics": (1e-320, 60, 30, 20)}, r"focal lengths .*, from the user, are no camera's"),
        ({"intrinsics": (60, 1e6, 30, 20)}, r"expected 0.005 to 1000 times the width of the images, 64 pixels"),
        ({"depth_scale": 0}, "depth scale must be 0.1 to 1e[+]07 units per metre, got 0"),
        ({"depth_scale": float("inf")}, "depth scale must be"),
    ],
)
def test_nonsense_given_by_the_user(plain, given, reason):
    with pytest.raises(InputError, match=reason):
        open_recording(plain.path, **given)


def test_a_recording_is_not_searched_for_more(plain):
    """Pictures that lie inside a recording's folder are no second recording."""
    write_image(plain.path / "extra" / "00000-color.png", color_image(0))
    assert open_recording(plain.path.parent).path == plain.path
