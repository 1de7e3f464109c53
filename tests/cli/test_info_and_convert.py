from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "readers"))

from made_recordings import CAMERA, make_plain, write_image

from cuboid.cli import main
from cuboid.cli.info import rows
from cuboid.inputs.readers import open_recording
from cuboid.inputs.recordings.inspecting import inspect_recording
from fakes import write_recording


def test_info_says_what_was_recognised_and_what_will_be_skipped(tmp_path, capsys):
    made = make_plain(tmp_path, frames=40)
    made.depth(7).write_bytes(b"")
    lines = (made.path / "poses.txt").read_text().splitlines()
    (made.path / "poses.txt").write_text("\n".join(lines[:-2]) + "\n")
    assert main(["info", str(made.path), "--all"]) == 0
    out = capsys.readouterr().out
    for said in (
        "plain",
        "40 of 64 x 48 pixels",
        "the recording has no times: 30 Hz assumed",
        "fx 60.00 fy 61.00 cx 31.50 cy 23.50 (camera.json)",
        "1000 units per metre",
        "depth taken as aligned to color",
        "38 of 40 frames, camera to world",
        "frame 7: depth image depth/000007.png is empty",
        "frame 38 and 1 more like it: poses.txt has no line for frame number 38",
    ):
        assert said in out


def test_info_as_json(tmp_path, capsys):
    made = make_plain(tmp_path, frames=5, poses=False)
    assert main(["info", str(made.path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["format"], found["frames"], found["poses"], found["skipped"]) == ("plain", 5, 0, [])
    assert found["size"] == [64, 48]
    assert found["holes"] == pytest.approx(1 / 64)


@pytest.mark.parametrize(
    ("off_px", "says"),
    [
        (None, "depth taken as aligned to color: no clear displacement (edges compared in 5 views)"),
        (0.9, "displaced by 1 px, too little to be registered without --register on"),
        (3.0, "by 3 px (edges compared in 5 views): 'cuboid track' registers it, if that is plausible, unless"),
    ],
)
def test_info_says_what_is_done_about_depth_beside_color(tmp_path, off_px, says):
    found = inspect_recording(open_recording(make_plain(tmp_path, frames=3).path))
    text = dict(rows(replace(found, depth_off_px=off_px, depth_views=5)))["registration"]
    assert says in text
    assert not (off_px == 3.0 and "aligned" in text), "one verdict"
    assert "not checked" in dict(rows(replace(found, depth_off_px=None, depth_views=0)))["registration"]


def test_info_warns_about_a_depth_scale_that_is_not_plausible(tmp_path, capsys):
    made = make_plain(tmp_path, frames=3)
    (made.path / "camera.json").write_text(json.dumps(CAMERA | {"depth_units_per_metre": 20000}))
    assert main(["info", str(made.path)]) == 0
    assert "warning: the depth scale of 20000 units per metre is probably wrong" in capsys.readouterr().out


def test_info_on_real_recordings(data_dir, capsys):
    assert main(["info", str(data_dir / "containers" / "azure-kinect")]) == 0
    out = capsys.readouterr().out
    assert "azure-kinect" in out
    assert "registered to color from 640 x 576, fx 504.61, 32 mm away" in out


@pytest.mark.parametrize("form", ["plain", "tum", "mcap"])
def test_what_is_converted_reads_back_the_same(tmp_path, form, capsys):
    if form == "mcap":
        pytest.importorskip("rosbags", reason="bags are written with rosbags: pip install '.[ros]'")
    made = make_plain(tmp_path, frames=9)
    made.color(4).write_bytes(b"x")
    output = tmp_path / "converted"
    words = ["convert", str(made.path), "--to", form, "--output", str(output), "--first", "2", "--last", "7"]
    assert main([*words, "--every", "2"]) == 0
    said = capsys.readouterr().out
    assert "frame 4 left out: color image color/000004.png" in said
    assert "2 of 9 frames in" in said
    before, after = open_recording(made.path), open_recording(output)
    assert after.format == {"mcap": "ros-bag"}.get(form, form)
    assert (len(after), after.intrinsics) == (2, before.intrinsics)
    for k, index in enumerate((2, 6)):
        one, other = before.read(index), after.read(k)
        np.testing.assert_array_equal(other.color, one.color)
        np.testing.assert_allclose(other.depth_m, one.depth_m, atol=1e-6)
        np.testing.assert_allclose(other.T_world_camera, one.T_world_camera, atol=1e-7)
        assert other.timestamp_s == pytest.approx(one.timestamp_s, abs=1e-5)
    assert main([*words]) == 2  # never over what is there
    assert "exists" in capsys.readouterr().err


def test_a_bag_keeps_depth_of_any_unit_without_loss(tmp_path):
    pytest.importorskip("rosbags", reason="bags are written with rosbags: pip install '.[ros]'")
    made = make_plain(tmp_path, frames=2)
    (made.path / "camera.json").write_text(json.dumps(CAMERA | {"depth_units_per_metre": 10000}))
    depth = np.random.default_rng(0).integers(5000, 60000, (48, 64)).astype(np.uint16)
    depth[0] = 65535
    for k in range(2):
        write_image(made.depth(k), depth)
    assert main(["convert", str(made.path), "--to", "mcap", "--output", str(tmp_path / "out")]) == 0
    before, after = open_recording(made.path).read(1), open_recording(tmp_path / "out").read(1)
    np.testing.assert_array_equal(after.depth_m, before.depth_m)


def test_depth_of_its_own_camera_is_written_registered(tmp_path):
    made = make_plain(tmp_path, frames=2)
    depth = {"fx": 50.0, "fy": 50.0, "cx": 39.5, "cy": 29.5, "width": 80, "height": 60}
    T = np.eye(4)
    T[0, 3] = -0.03
    document = CAMERA | {"depth_units_per_metre": 1000, "depth_camera": depth, "T_color_depth": T.tolist()}
    (made.path / "camera.json").write_text(json.dumps(document))
    for k in range(2):
        write_image(made.depth(k), np.full((60, 80), 1234 + k, np.uint16))
    assert main(["convert", str(made.path), "--output", str(tmp_path / "out")]) == 0
    before, after = open_recording(made.path), open_recording(tmp_path / "out")
    assert after.depth_camera is None
    np.testing.assert_allclose(after.read(1).depth_m, before.read(1).depth_m, atol=1.1e-4)


def test_a_range_without_frames_is_refused(tmp_path, capsys):
    made = make_plain(tmp_path)
    assert main(["convert", str(made.path), "--output", str(tmp_path / "out"), "--first", "9"]) == 2
    assert "has 5 frames, none of them from 9 to 4" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_only_an_earlier_conversion_is_replaced(tmp_path, capsys):
    made, other, output = (
        write_recording(tmp_path / "made", 6),
        write_recording(tmp_path / "other", 3),
        tmp_path / "out",
    )
    assert main(["convert", str(made), "-o", str(output)]) == 0
    before = contents(output)
    for words in ((str(other), "-o", str(output)), (str(other), "-o", str(made), "--force")):
        assert main(["convert", *words]) == 2
    said = capsys.readouterr().err.splitlines()
    assert "exists; --force" in said[0]
    assert "was not written by 'cuboid convert'" in said[1]
    assert main(["convert", str(tmp_path / "other"), "-o", str(output), "--first", "9", "--force"]) == 2
    assert contents(output) == before
    assert main(["convert", str(other), "-o", str(output), "--to", "tum", "--force"]) == 0
    assert len(open_recording(output)) == 3
    assert not (output / "color").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["made", "other", "out"]


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
