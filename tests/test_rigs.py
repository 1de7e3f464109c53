"""Several cameras, one map: recordings of rigs are tracked as one, and each object has one label."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cuboid
from cuboid.cli import main
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import RigCamera
from cuboid.inputs.recordings.opening import open_recording, open_rig
from cuboid.inputs.recordings.rig import RigRecording
from cuboid.results.exports import EXPORTS, export
from cuboid.results.files import Results
from cuboid.results.views.mosaic import Mosaic
from made_rigs import NAMES, POSES, SMALL, TABLE, THINGS, WIDE, rig_document, write_camera, write_rig
from made_scenes import cast, look_at


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_rig(tmp_path_factory.mktemp("rig") / "table")


@pytest.fixture(scope="module")
def results(rig: Path, tmp_path_factory: pytest.TempPathFactory) -> Results:
    output = tmp_path_factory.mktemp("results") / "found"
    cuboid.track_recording(open_recording(rig), output)
    return Results(output)


def test_frames_come_in_the_order_of_their_times_with_their_camera(rig: Path) -> None:
    recording = open_recording(rig)
    assert isinstance(recording, RigRecording)
    times = [recording.timestamp_s(k) for k in range(len(recording))]
    assert times == sorted(times)
    assert len(times) == 10 + 8
    first, second = recording.read(0), recording.read(1)
    assert (first.camera, second.camera) == (RigCamera("left", WIDE), RigCamera("right", SMALL))
    np.testing.assert_allclose(second.T_world_camera, POSES[1], atol=1e-12)


def test_each_object_has_one_label_for_all_cameras(results: Results) -> None:
    assert len(results.objects) == len(THINGS)
    for thing in THINGS:
        nearest = min(results.objects, key=lambda item: np.linalg.norm(item.box.center - thing.center))
        assert np.linalg.norm(nearest.box.center - thing.center) < 0.02
        rows = [row for row in results.tracks if row.label == nearest.label]
        assert {row.camera for row in rows} == set(NAMES)
        assert all(np.linalg.norm(row.box.center - thing.center) < 0.03 for row in rows)


def test_rectangles_are_in_pixels_of_their_camera(results: Results) -> None:
    sizes = {"left": WIDE, "right": SMALL}
    for row in results.tracks:
        assert (row.rect_xyxy[2:] <= (sizes[row.camera].width, sizes[row.camera].height)).all()
        pixel = sizes[row.camera].pixels(
            np.linalg.inv(POSES[NAMES.index(row.camera)])[:3] @ np.append(row.box.center, 1.0)
        )
        assert (row.rect_xyxy[:2] < pixel).all()
        assert (pixel < row.rect_xyxy[2:]).all()


def test_results_open_their_recordings_again(results: Results) -> None:
    assert results.report.config["rig"]["cameras"] == list(NAMES)
    assert isinstance(results.recording, RigRecording)
    assert results.recording.read(1).camera_name == "right"


def test_results_of_one_camera_show_objects_from_all_cameras(results: Results) -> None:
    item = results.objects[0]
    views, expected = results.of_camera("right")._views(item), results._views(item)
    assert {view.color.shape for view in expected} == {view.color.shape for view in views}
    for view, other in zip(views, expected, strict=True):
        np.testing.assert_array_equal(view.T_world_camera, other.T_world_camera)


def test_a_camera_that_stops_and_one_that_starts_late_are_named(tmp_path: Path) -> None:
    rig = open_recording(write_rig(tmp_path / "rig", ((0.0, 0.4), (2.0, 3.5))))
    left, right = "camera left stops 3.1 s before the last camera", "camera right starts 2.0 s after the first camera"
    assert rig.warnings[:2] == (left, right)
    assert "do not overlap" in rig.warnings[2]


def test_recordings_on_the_command_line_are_those_of_the_cameras(rig: Path, tmp_path: Path) -> None:
    file = tmp_path / "rig.json"
    document = rig_document()
    for camera in document["cameras"]:  # type: ignore[attr-defined]
        del camera["recording"]
    file.write_text(json.dumps(document), encoding="utf-8")
    paths = [str(rig / name) for name in NAMES]
    assert main(["track", *paths, "--rig", str(file), "--output", str(tmp_path / "found"), "--limit", "6"]) == 0
    found = Results(tmp_path / "found")
    assert found.recording.read(1).camera_name == "right"
    with pytest.raises(InputError, match="has 2 cameras \\(left, right\\), but 1 recordings were given"):
        open_rig(file, [rig / "left"])
    with pytest.raises(InputError, match="camera 'left' has no 'recording'"):
        open_rig(file)


def test_recordings_with_poses_in_one_world_are_one(tmp_path: Path) -> None:
    path = [look_at((np.cos(a), np.sin(a), 0.8), (0.0, 0.0, 0.05)) for a in np.linspace(0.0, 0.5, 12)]
    for k, name in enumerate(NAMES):
        times_s = [j / 30 for j in range(k, 12, 2)]
        write_camera(tmp_path / "two" / name, WIDE, path[k::2], times_s, posed=True)
    (tmp_path / "two" / "rig.json").write_text(json.dumps(rig_document("moving", None)), encoding="utf-8")
    rig = open_recording(tmp_path / "two")
    for k, T in enumerate(path):
        np.testing.assert_allclose(rig.pose(k), T, atol=1e-8)
    tracker = cuboid.Tracker(rig.intrinsics)
    for frame in rig:
        tracker.update(frame)
    assert len(tracker.objects) == len(THINGS)


def test_without_poses_in_the_rig_each_recording_needs_its_own(tmp_path: Path) -> None:
    for name in NAMES:
        write_camera(tmp_path / name, WIDE, [POSES[0]] * 2, [0.0, 0.1], posed=name == "left")
    (tmp_path / "rig.json").write_text(json.dumps(rig_document("moving", None)), encoding="utf-8")
    with pytest.raises(InputError, match="camera 'right' has no poses; without 'T_rig_camera' each camera needs"):
        open_recording(tmp_path)


def test_poses_of_a_moving_rig_are_not_invented_over_gaps(tmp_path: Path) -> None:
    moves = [look_at((1.0, 0.02 * k, 0.8), (0.0, 0.02 * k, 0.05)) for k in range(8)]
    times_s = [0.0, 0.1, 0.2, 0.4, 0.5]  # 0.2 s between the third and the fourth
    write_camera(tmp_path / "left", WIDE, [moves[round(10 * t)] for t in times_s], times_s, posed=True)
    others_s = [0.05, 0.15, 0.25, 0.3, 0.55, 0.7]
    write_camera(tmp_path / "right", SMALL, [moves[0]] * len(others_s), others_s)
    document = rig_document("moving", [np.eye(4), np.eye(4)])
    (tmp_path / "rig.json").write_text(json.dumps(document), encoding="utf-8")
    rig = open_recording(tmp_path)
    found = {}
    for k in range(len(rig)):
        try:
            found[round(rig.timestamp_s(k), 2)] = rig.pose(k)[1, 3]
        except FrameError as error:
            found[round(rig.timestamp_s(k), 2)] = str(error)
    assert found[0.05] == pytest.approx(0.01)
    assert found[0.15] == pytest.approx(0.03)
    assert found[0.55] == pytest.approx(0.11)  # it moves on
    for time_s in (0.25, 0.3, 0.7):
        assert "has no frames near" in found[time_s]


@pytest.mark.parametrize(("interval_s", "warned"), [(0.1, False), (0.2, True)])
def test_a_slow_camera_with_the_poses_of_a_moving_rig_is_named(tmp_path: Path, interval_s: float, warned: bool) -> None:
    moves = [look_at((1.0, 0.02 * k, 0.8), (0.0, 0.02 * k, 0.05)) for k in range(4)]
    write_camera(tmp_path / "left", WIDE, moves, [interval_s * k for k in range(4)], posed=True)
    write_camera(tmp_path / "right", SMALL, moves[:2], [0.0, 0.05])
    document = rig_document("moving", [np.eye(4), np.eye(4)])
    (tmp_path / "rig.json").write_text(json.dumps(document), encoding="utf-8")
    lines = [line for line in open_recording(tmp_path).warnings if "get no pose" in line]
    assert len(lines) == warned
    assert not warned or "camera left, which has the poses of the rig, has a frame each 0.20 s" in lines[0]


def test_the_poses_of_one_camera_move_the_others(tmp_path: Path) -> None:
    T_rig_right = np.eye(4)
    T_rig_right[0, 3] = 0.1
    path = [look_at((np.cos(a), np.sin(a), 0.8), (0.0, 0.0, 0.05)) for a in np.linspace(0.0, 0.1, 5)]
    write_camera(tmp_path / "left", WIDE, path[::2], [0.0, 2 / 30, 4 / 30], posed=True)
    write_camera(tmp_path / "right", SMALL, [T @ T_rig_right for T in path[1::2]], [1 / 30, 3 / 30])
    document = rig_document("moving", [np.eye(4), T_rig_right])
    (tmp_path / "rig.json").write_text(json.dumps(document), encoding="utf-8")
    rig = open_recording(tmp_path / "rig.json")
    for k, T in enumerate(path):
        expected = T @ T_rig_right if k % 2 else T
        np.testing.assert_allclose(rig.pose(k), expected, atol=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "flying"}, "kind"),
        ({"cameras": []}, "cameras"),
        ({"cameras": [{"name": "a"}]}, "camera 'a' has no 'T_rig_camera'; each camera of a fixed rig needs one"),
        ({"cameras": [{"name": "a,b", "T_rig_camera": np.eye(4).tolist()}]}, "name"),
        ({"cameras": [{"name": "a", "T_rig_camera": (0.5 * np.eye(4)).tolist()}]}, "'T_rig_camera' of a"),
        ({"cameras": [{"name": "a", "T_rig_camera": np.eye(4).tolist()}] * 2}, "camera 'a' is named twice"),
    ],
)
def test_a_malformed_rig_is_refused_in_one_line(tmp_path: Path, change: dict[str, object], message: str) -> None:
    (tmp_path / "rig.json").write_text(json.dumps({**rig_document(), **change}), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        open_recording(tmp_path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_options_of_one_camera_are_refused(rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for options, message in (
        (["--poses", "estimated"], "a fixed rig has the poses of its cameras"),
        (["--intrinsics", "1,1,1,1"], "the cameras of a rig differ"),
    ):
        assert main(["track", str(rig), "--output", str(tmp_path / "none"), *options]) == 2
        assert message in capsys.readouterr().err


@pytest.mark.parametrize("name", ["coco", "kitti"])
def test_a_file_for_each_camera_has_the_frames_of_its_recording(results: Results, tmp_path: Path, name: str) -> None:
    suffix = EXPORTS.get(name).suffix
    notes = export(results, name, tmp_path / f"out{suffix}")
    assert "a file for each camera" in notes[0]
    for camera, count in zip(NAMES, (10, 8), strict=True):
        file = tmp_path / f"out-{camera}{suffix}"
        rows = [row for row in results.tracks if row.camera == camera]
        if name == "kitti":
            lines = [line.split() for line in file.read_text(encoding="utf-8").splitlines()]
            assert len(lines) == len(rows)
            assert max(int(line[0]) for line in lines) < count
        else:
            document = json.loads(file.read_text(encoding="utf-8"))
            assert [image["frame_index"] for image in document["images"]] == list(range(count))
            assert document["images"][3]["file_name"] == "color/000003.png"
            assert document["images"][0]["width"] == (WIDE if camera == "left" else SMALL).width
            assert len(document["annotations"]) == len(rows)


def test_a_bag_has_the_pictures_of_each_camera(results: Results, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="bags are written with rosbags")
    export(results, "mcap", tmp_path / "out.mcap")
    topics = "color=/right/color/image_raw/compressed,depth=/right/aligned_depth_to_color/image_raw/compressedDepth"
    bag = open_recording(tmp_path / "out.mcap", format=f"ros-bag:{topics}")
    assert len(bag) == 8
    assert bag.intrinsics == SMALL
    np.testing.assert_allclose(bag.read(2).T_world_camera, POSES[1], atol=1e-5)


def test_rerun_has_an_entity_for_each_camera(results: Results, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs rerun-sdk")
    export(results, "rerun", tmp_path / "out.rrd")
    call = [sys.executable, "-m", "rerun", "rrd", "print", str(tmp_path / "out.rrd")]
    printed = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    for name in NAMES:
        assert f"/world/camera/{name}/image" in printed
        assert f"/world/camera_path/{name}" in printed


def test_every_nth_frame_of_each_camera_is_used(rig: Path, tmp_path: Path) -> None:
    cuboid.track_recording(open_recording(rig), tmp_path / "found", cuboid.TrackOptions(every=3))
    found = Results(tmp_path / "found")
    cameras = [found.report.camera_of(frame) for frame in found.poses]
    assert [camera.name for camera in cameras if camera is not None].count("left") == 4
    assert len(cameras) == 4 + 3
    for frame, pose in found.poses.items():
        again = found.recording.read(frame)
        assert pose.timestamp_s == pytest.approx(again.timestamp_s)
        np.testing.assert_allclose(pose.T_world_camera, again.T_world_camera, atol=1e-6)


def test_a_calibration_of_a_rig_refuses_options_of_one_camera(
    rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["calibrate", "--rig", str(rig / "left"), str(rig / "right"), "--output", str(tmp_path / "rig.json")]
    for option in (["--depth-scale", "77"], ["--every", "2"], ["--poses", "given"]):
        assert main([*words, *option]) == 2
        assert f"{option[0]} is for one camera; leave it out with --rig" in capsys.readouterr().err


def test_a_repeated_frame_is_compared_with_the_last_one_of_its_camera(rig: Path) -> None:
    recording = open_recording(rig)
    tracker = cuboid.Tracker(recording.intrinsics)
    frames = [recording.read(k) for k in range(6)]
    for frame in frames:
        tracker.update(frame)
    left, right = (next(f for f in reversed(frames) if f.camera_name == name) for name in NAMES)
    before = tracker.points_known
    for k, frame in enumerate((left, right)):
        again = tracker.update(replace(frame, index=10 + k, timestamp_s=1.0 + k))
        assert isinstance(again, cuboid.FrameResult)
        assert again.milliseconds == {}
    assert tracker.points_known == before


def test_cameras_of_a_rig_agree_which_way_up_their_images_are() -> None:
    """Camera "left" sees a floor, "right" a wall on its right: alone, it would take that for the floor."""
    tracker = cuboid.Tracker(WIDE, poses="given")
    near = {"left": np.linspace(3.0, 1.0, 240)[:, None], "right": np.linspace(3.0, 1.0, 320)[None]}
    color = np.zeros((240, 320, 3), np.uint8)
    for k, name in enumerate(NAMES):
        depth_m = np.broadcast_to(near[name], (240, 320)).astype(np.float32)
        tracker.update(cuboid.Frame(k, k / 30, color, depth_m, np.eye(4), camera=RigCamera(name, WIDE)))
    assert {name: memory.turns for name, memory in tracker._mapper._cameras.items() if name} == {"left": 0, "right": 0}


@pytest.mark.parametrize(("apart_degrees", "pitch_degrees"), [(90, 45), (180, 60)])
def test_cameras_around_a_table_are_turned_by_what_each_sees(apart_degrees: float, pitch_degrees: float) -> None:
    pitch, color = np.radians(pitch_degrees), np.zeros((240, 320, 3), np.uint8)
    tracker = cuboid.Tracker(WIDE, poses="given")
    for k, (name, azimuth) in enumerate(zip(NAMES, np.radians((0, apart_degrees)), strict=True)):
        T = look_at((np.cos(azimuth) * np.cos(pitch), np.sin(azimuth) * np.cos(pitch), np.sin(pitch)), (0.0, 0.0, 0.0))
        depth_m = cast((TABLE,), T, WIDE)[0].astype(np.float32)
        tracker.update(cuboid.Frame(k, k / 30, color, depth_m, T, camera=RigCamera(name, WIDE)))
    assert [tracker._mapper._cameras[name].turns for name in NAMES] == [0, 0]


@pytest.mark.parametrize("pitch_degrees", [70, 80])
def test_a_camera_that_looks_steeply_down_is_turned_by_up_in_the_map(pitch_degrees: float) -> None:
    """Two such cameras look nearly the same way, wherever they stand: up in their images differs."""
    pitch, color = np.radians(pitch_degrees), np.zeros((240, 320, 3), np.uint8)
    tracker = cuboid.Tracker(WIDE, poses="given")
    names = [f"camera-{k}" for k in range(4)]
    for k, azimuth in enumerate(np.radians((0, 90, 180, 270))):
        T = look_at((np.cos(azimuth) * np.cos(pitch), np.sin(azimuth) * np.cos(pitch), np.sin(pitch)), (0.0, 0.0, 0.0))
        depth_m = cast((TABLE, *THINGS), T, WIDE)[0].astype(np.float32)
        tracker.update(cuboid.Frame(k, k / 30, color, depth_m, T, camera=RigCamera(names[k], WIDE)))
    assert [tracker._mapper._cameras[name].turns for name in names] == [0] * 4


def test_the_pictures_of_all_cameras_are_side_by_side() -> None:
    mosaic = Mosaic([RigCamera("left", WIDE), RigCamera("right", SMALL)])
    red, blue = np.full((240, 320, 3), (200, 0, 0), np.uint8), np.full((184, 240, 3), (0, 0, 200), np.uint8)
    assert mosaic.add("left", red) is None
    assert mosaic.add("right", blue) is None
    complete = mosaic.add("left", red)
    assert complete is not None
    assert complete.shape == (240, 640, 3)
    assert (complete[120, 160], complete[120, 480]) == (pytest.approx([200, 0, 0]), pytest.approx([0, 0, 200]))
    assert mosaic.last() is not None


def test_a_moving_rig_follows_the_estimated_poses_of_its_first_camera(tmp_path: Path) -> None:
    T_rig_right = np.eye(4)
    T_rig_right[0, 3] = 0.1
    path = [look_at((np.cos(a), np.sin(a), 0.8), (0.0, 0.0, 0.05)) for a in np.linspace(0.0, 0.2, 12)]
    write_camera(tmp_path / "left", WIDE, path[::2], [k / 30 for k in range(0, 12, 2)])
    write_camera(tmp_path / "right", SMALL, [T @ T_rig_right for T in path[1::2]], [k / 30 for k in range(1, 12, 2)])
    document = rig_document("moving", [np.eye(4), T_rig_right])
    (tmp_path / "rig.json").write_text(json.dumps(document), encoding="utf-8")
    cuboid.track_recording(open_recording(tmp_path), tmp_path / "found")
    found = Results(tmp_path / "found")
    assert found.report.poses == "estimated"
    assert len(found.poses) == len(path)
    for k, pose in found.poses.items():
        expected = np.linalg.inv(path[0]) @ (path[k] @ T_rig_right if k % 2 else path[k])
        # Before the second frame of the first camera, its velocity is not known.
        assert np.linalg.norm(pose.T_world_camera[:3, 3] - expected[:3, 3]) < (0.025 if k == 1 else 0.01)


def test_a_camera_that_stops_takes_nothing_from_the_others(tmp_path: Path, results: Results) -> None:
    cuboid.track_recording(open_recording(write_rig(tmp_path / "rig", ((0.0, 0.5), (0.0, 0.2)))), tmp_path / "found")
    found = Results(tmp_path / "found")
    assert [item.label for item in found.objects] == [item.label for item in results.objects]
    seen = [{row.label for row in one.tracks if row.camera == "left"} for one in (found, results)]
    assert seen[0] == seen[1]


def test_commands_of_one_camera_name_a_recording_of_the_rig(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(rig)]) == 2
    assert f"is a rig; name the recording of one camera, such as {rig / 'left'}" in capsys.readouterr().err


def test_a_wrong_depth_scale_is_that_of_its_camera(tmp_path: Path) -> None:
    path = write_rig(tmp_path / "rig", ((0.0, 0.3), (0.0, 0.3)))
    file = path / "right" / "camera.json"
    camera = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps({**camera, "depth_units_per_metre": 500}), encoding="utf-8")
    report = cuboid.track_recording(open_recording(path), tmp_path / "found").report
    wrong = [line for line in report.warnings if "depth scale" in line]
    assert len(wrong) == 1
    assert wrong[0].startswith("camera right: the depth scale of 500 units per metre is probably wrong")


def test_a_rig_measures_what_stands_in_its_middle(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["measure", str(rig), "--json"]) == 0
    measured = json.loads(capsys.readouterr().out)["objects"]
    sides = sorted(tuple(sorted(one["size_m"], reverse=True)) for one in measured)
    for found, thing in zip(sides, sorted(tuple(sorted(one.size, reverse=True)) for one in THINGS), strict=True):
        np.testing.assert_allclose(found, thing, atol=0.012)


def test_a_rig_can_be_added_to_a_scene_and_drawn(rig: Path, tmp_path: Path) -> None:
    scene, output = tmp_path / "place.cuboid", tmp_path / "found"
    call = ["track", str(rig), "--output", str(output), "--scene", str(scene), "--limit", "8", "--shapes"]
    assert main(call) == 0
    with cuboid.Scene.open(scene) as opened:
        assert len(opened.objects) == len(THINGS)
        opened.write_results(tmp_path / "again")
    rows, again = (Results(folder).tracks for folder in (output, tmp_path / "again"))
    assert [(row.frame, row.label, row.camera) for row in again] == [(row.frame, row.label, row.camera) for row in rows]
    assert main(["render", str(output)]) == 0
    assert '"rig":' in (output / "report.html").read_text(encoding="utf-8")
