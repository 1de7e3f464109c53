from __future__ import annotations

import struct
import sys

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="bags are read with rosbags: pip install '.[ros]'")

from made_bags import START_NS, STEP_NS, encoded, make_bag, time_of, writing
from made_recordings import CAMERA, color_image, depth_image, make_plain

from cuboid.cli import main
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.readers import open_recording

KINDS = ["bag", "db3", "mcap"]
OPTICAL = "optical"


def bag_path(root, kind):
    return root / ("walk.bag" if kind == "bag" else "walk")


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_gives_what_the_plain_folder_gives(tmp_path, kind):
    plain = open_recording(make_plain(tmp_path).path)
    bag = open_recording(make_bag(bag_path(tmp_path, kind), kind))
    assert (bag.format, len(bag), bag.has_poses) == ("ros-bag", 5, True)
    assert bag.intrinsics == plain.intrinsics == Intrinsics(60, 61, 31.5, 23.5, 64, 48)
    assert bag.depth_units_per_metre == 1000
    for k in (4, 0, 2):
        frame, expected = bag.read(k), plain.read(k)
        np.testing.assert_array_equal(frame.color, expected.color)
        np.testing.assert_array_equal(frame.depth_m, expected.depth_m)
        T = expected.T_world_camera.copy()
        T[1, 3] += 0.2  # the camera sits beside the base whose way the bag tells
        np.testing.assert_allclose(frame.T_world_camera, T, atol=1e-6)
        assert frame.timestamp_s == pytest.approx(1_700_000_000 + 0.033 * k, abs=1e-6)
    assert len(list(bag.iterate())) == 5


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_the_file_alone_is_a_recording_too(tmp_path, kind):
    folder = make_bag(bag_path(tmp_path, kind), kind)
    (folder / "metadata.yaml").unlink()
    file = next(folder.glob(f"*.{kind}"))
    for named in (file, folder, tmp_path):
        assert len(open_recording(named)) == 5


def write_topics(path, kind, topics, frames=3, info=True):
    """topics: name -> (function of messages, frame's number and time that makes the message)."""
    with writing(path, kind) as (make, publish):
        if info:
            publish("/camera/color/camera_info", make.info(CAMERA, OPTICAL, START_NS), START_NS)
        for k in range(frames):
            for topic, of in topics.items():
                publish(topic, of(make, k, time_of(k)), time_of(k))
    return path


def raw_color(make, k, t):
    return make.image(color_image(k), "rgb8", OPTICAL, t)


def jpeg_color(make, k, t):
    return make.compressed(encoded(".jpg", color_image(k)), "rgb8; jpeg compressed bgr8", OPTICAL, t)


def raw_depth(make, k, t):
    return make.image(depth_image(k, 1000.0), "16UC1", OPTICAL, t)


def inverse_depth(make, k, t):
    """As compressed_depth_image_transport packs 32FC1: quantised inverse depth behind a header."""
    metres = depth_image(k, 1000.0) / 1000.0
    a, b = 10000.0, -200.0
    whole = np.where(metres > 0, np.rint(a / np.maximum(metres, 1e-3) + b), 0).astype(np.uint16)
    data = struct.pack("<iff", 0, a, b) + encoded(".png", whole)
    return make.compressed(data, "32FC1; compressedDepth png", OPTICAL, t)


@pytest.mark.parametrize(
    ("depth", "tolerance"),
    [
        (lambda make, k, t: make.image((depth_image(k, 1000.0) / 1000).astype(np.float32), "32FC1", OPTICAL, t), 0),
        (lambda make, k, t: make.image(depth_image(k, 1000.0), "mono16", OPTICAL, t), 0),
        (
            lambda make, k, t: make.compressed(
                bytes(12) + encoded(".png", depth_image(k, 1000.0)), "16UC1; compressedDepth png", OPTICAL, t
            ),
            0,
        ),
        (inverse_depth, 1e-3),
    ],
    ids=["32FC1", "mono16", "compressedDepth 16UC1", "compressedDepth 32FC1"],
)
@pytest.mark.parametrize(
    ("color", "off"),
    [
        (lambda make, k, t: make.image(color_image(k)[..., ::-1], "bgr8", OPTICAL, t), 0),
        (lambda make, k, t: make.image(np.dstack([color_image(k), color_image(k)[..., 0]]), "rgba8", OPTICAL, t), 0),
        (jpeg_color, 3),
    ],
    ids=["bgr8", "rgba8", "jpeg"],
)
def test_encodings(tmp_path, color, off, depth, tolerance):
    topics = {"/camera/color/image_raw/compressed" if off else "/camera/color/image_raw": color, "/camera/depth": depth}
    frame = open_recording(write_topics(tmp_path / "walk.bag", "bag", topics)).read(2)
    assert np.abs(frame.color.astype(int) - color_image(2)).mean() <= off
    expected = depth_image(2, 1000.0) / 1000
    np.testing.assert_allclose(frame.depth_m, expected, atol=tolerance + 1e-6)
    assert ((frame.depth_m == 0) == (expected == 0)).all()


def test_depth_of_its_own_camera_is_carried_into_color(tmp_path):
    depth_camera = CAMERA | {"fx": 50.0, "fy": 50.0, "width": 80, "height": 60, "cx": 39.5, "cy": 29.5}
    with writing(tmp_path / "walk.bag", "bag") as (make, publish):
        static = make.transform("link", "color", START_NS, (0.05, 0, 0), (0, 0, 0, 1))
        publish("/tf_static", static, START_NS)
        publish("/tf_static", make.transform("link", "depth", START_NS, (0.02, 0, 0), (0, 0, 0, 1)), START_NS)
        publish("/camera/color/camera_info", make.info(CAMERA, "color", START_NS), START_NS)
        publish("/camera/depth/camera_info", make.info(depth_camera, "depth", START_NS), START_NS)
        for k in range(2):
            publish("/camera/color/image_raw", make.image(color_image(k), "rgb8", "color", time_of(k)), time_of(k))
            wall = np.full((60, 80), 1500, np.uint16)
            publish("/camera/depth/image_rect_raw", make.image(wall, "16UC1", "depth", time_of(k)), time_of(k))
    recording = open_recording(tmp_path / "walk.bag")
    np.testing.assert_allclose(recording.depth_camera.T_color_depth[:3, 3], [-0.03, 0, 0], atol=1e-9)
    assert recording.depth_camera.size == (80, 60)
    assert not recording.has_poses
    frame = recording.read(0)
    assert frame.depth_m.shape == (48, 64)
    assert frame.depth_m[24, 32] == pytest.approx(1.5)


def test_poses_of_a_topic_and_gaps_in_them(tmp_path):
    with writing(tmp_path / "walk.bag", "bag") as (make, publish):
        publish("/camera/color/camera_info", make.info(CAMERA, OPTICAL, START_NS), START_NS)
        for k in range(100):
            t = START_NS + k * STEP_NS
            publish("/camera/color/image_raw", raw_color(make, 0, t), t)
            publish("/camera/depth/image_raw", raw_depth(make, 0, t), t)
            if not 40 <= k < 80:
                publish("/vio/pose", make.odometry("map", t, (0.01 * k, 0.0, 0.0)), t)
    recording = open_recording(tmp_path / "walk.bag")
    assert recording.pose(10)[0, 3] == pytest.approx(0.1)
    with pytest.raises(FrameError, match=r"no camera pose at .* transform of 'the camera' is 0\.6\d\d s away"):
        recording.read(60)
    recording.without_poses().read(60)


def test_topics_can_be_chosen_and_results_know_which(tmp_path, capsys):
    topics = {
        "/left/color/image_raw": raw_color,
        "/right/color/image_raw": lambda make, k, t: make.image(color_image(k + 50), "rgb8", OPTICAL, t),
        "/left/depth/image_raw": raw_depth,
    }
    path = write_topics(tmp_path / "walk.bag", "bag", topics)
    with pytest.raises(InputError, match="color may be any of /left/color/image_raw, /right/color/image_raw; name one"):
        open_recording(path, intrinsics=(60, 60, 31.5, 23.5))
    recording = open_recording(path, format="ros-bag:color=/right/color/image_raw", intrinsics=(60, 60, 31.5, 23.5))
    assert recording.format == "ros-bag:color=/right/color/image_raw"
    assert recording.read(0).color[0, 0, 1] == 60
    with pytest.raises(InputError, match=r"has no topic '/none' \(depth\); it has /camera/color/camera_info, /left"):
        open_recording(path, format="ros-bag:depth=/none")
    with pytest.raises(InputError, match="topics are chosen with color=, depth=, pose="):
        open_recording(path, format="ros-bag:infra=/left/color/image_raw")
    with pytest.raises(InputError, match="the format 'plain' has no options"):
        open_recording(make_plain(tmp_path / "p").path, format="plain:color=1")
    output = str(tmp_path / "out")
    assert main(["slam", str(path), "--topics", "color=/nowhere", "--output", output]) == 2
    assert "has no topic '/nowhere'" in capsys.readouterr().err


def test_what_a_bag_lacks_is_said_in_one_line(tmp_path):
    path = write_topics(tmp_path / "a.bag", "bag", {"/camera/color/image_raw": raw_color})
    with pytest.raises(InputError, match="has no topic with depth images; it has /camera/color/camera_info, "):
        open_recording(path)
    topics = {"/camera/color/image_raw": raw_color, "/camera/depth/image_raw": raw_depth}
    path = write_topics(tmp_path / "b.bag", "bag", topics, info=False)
    with pytest.raises(InputError, match="the intrinsics are not known; give them with --intrinsics"):
        open_recording(path)
    assert len(open_recording(path, intrinsics=(60, 60, 31.5, 23.5))) == 3


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_a_bag_that_was_cut_off_gives_what_it_holds(tmp_path, kind):
    rng = np.random.default_rng(6)
    with writing(bag_path(tmp_path, kind), kind) as (make, publish):
        for k in range(60):  # of noise, so that there are many chunks
            t = time_of(k)
            publish("/camera/color/camera_info", make.info(CAMERA | {"width": 320, "height": 240}, OPTICAL, t), t)
            color = rng.integers(0, 256, (240, 320, 3), np.uint8)
            color[0, 0] = k
            publish("/camera/color/image_raw", make.image(color, "rgb8", OPTICAL, t), t)
            depth = rng.integers(900, 1100, (240, 320), np.uint16)
            publish("/camera/depth/image_raw", make.image(depth, "16UC1", OPTICAL, t), t)
    file = bag_path(tmp_path, kind) if kind == "bag" else next(bag_path(tmp_path, kind).glob("*.mcap"))
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) * 2 // 3])
    recording = open_recording(file)
    assert 30 <= len(recording) <= 40
    for k in (len(recording) - 1, 0, 17):
        assert recording.read(k).color[0, 0, 0] == k
    assert recording.timestamp_s(17) == pytest.approx(1_700_000_000 + 0.033 * 17, abs=1e-5)


def test_without_rosbags_the_extra_is_named(tmp_path, monkeypatch):
    path = make_bag(tmp_path / "walk.bag", "bag")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(InputError, match=r"pip install '\.\[ros\]'"):
        open_recording(path)
