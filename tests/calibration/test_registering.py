"""Depth that lies beside color: found, mended, told; and no word where it does not."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

import cuboid
from cuboid.cli import main
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.inputs.calibration.registering import register_recording, registration_warning
from cuboid.inputs.readers import open_recording
from cuboid.lab.synthetic import render_recording
from cuboid.lab.synthetic.kinds import make_scene
from cuboid.lab.synthetic.recording import DEPTH_UNITS_PER_M
from cuboid.lab.synthetic.view import SceneView
from cuboid.results.files import open_results, read_run
from made_scenes import write_plain

COLOR = Intrinsics(262.5, 262.5, 160.0, 120.0, 320, 240)
# A depth camera of a longer focal length, 3 cm to the left, that looks a little higher: as 7-Scenes has it.
DEPTH = Intrinsics(292.5, 292.5, 158.0, 121.0, 320, 240)
FRAMES = 12


def beside():
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.004, 0.0, 0.0]))[0]
    T[0, 3] = -0.03
    return T


def make(folder, T_color_depth, depth, named=COLOR, places=FRAMES):
    """A made room from some places: color of one camera, depth of another, and the depth that the first would see."""
    scene = make_scene("room", 6)
    frames = np.linspace(0, len(scene.T_room_camera) - 1, places).astype(int).repeat(FRAMES // places)
    seen = SceneView(scene, COLOR)
    measured = SceneView(replace(scene, T_room_camera=scene.T_room_camera @ T_color_depth), depth)
    truth, taken = [], []
    for k, frame in enumerate(frames.tolist()):
        color = seen.render(frame, "clean")
        truth.append(color.depth_m)
        depth_m = measured.render(frame, "clean").depth_m
        taken.append(Frame(k, k / 30, color.color, depth_m, scene.T_room_camera[frame]))
    return write_plain(folder, named, taken, DEPTH_UNITS_PER_M), truth


@pytest.fixture(scope="module")
def deregistered(tmp_path_factory):
    return make(tmp_path_factory.mktemp("made") / "deregistered", beside(), DEPTH)


@pytest.fixture(scope="module")
def registered(tmp_path_factory):
    return make(tmp_path_factory.mktemp("made") / "registered", np.eye(4), COLOR)


def errors(recording, truth):
    """Readings that are off by more than 3 cm: what lies at the wrong place shows at edges."""
    frames = [recording.read(k).depth_m for k in range(len(truth))]
    both = [(one > 0) & (true > 0) for one, true in zip(frames, truth, strict=True)]
    off = [np.abs(one - true)[where] for one, true, where in zip(frames, truth, both, strict=True)]
    return float((np.concatenate(off) > 0.03).mean())


def test_what_was_done_is_found(deregistered):
    folder, truth = deregistered
    recording = open_recording(folder)
    registration = register_recording(recording)
    found, mended = registration.found, registration.recording
    assert found.clear
    assert found.off_px == pytest.approx(12.5, abs=2)
    camera = mended.depth_camera
    assert (camera.fx, camera.fy) == pytest.approx((DEPTH.fx, DEPTH.fy), rel=0.01)
    assert camera.T_color_depth[0, 3] == pytest.approx(-0.03, abs=0.01)
    assert camera.cx == pytest.approx(DEPTH.cx, abs=2)
    assert camera.cy == pytest.approx(DEPTH.cy + 0.004 * DEPTH.fy, abs=1)  # a tilt is a shift
    known = recording.with_depth_camera(replace_camera(camera))
    assert errors(known, truth) < 0.02
    assert errors(mended, truth) < 0.04
    assert errors(recording, truth) > 0.08
    again = register_recording(mended)
    assert not again.found.clear
    assert again.recording is mended


def shifted(folder, to, px):
    """The recording with color that lies this many pixels to the right of depth."""
    shutil.copytree(folder, to)
    for file in (to / "color").iterdir():
        image = cv2.imread(str(file))
        image = cv2.copyMakeBorder(image, 0, 0, px, 0, cv2.BORDER_REPLICATE)[:, : image.shape[1]]
        cv2.imwrite(str(file), image, [cv2.IMWRITE_JPEG_QUALITY, 95])
    return to


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    path = tmp_path_factory.mktemp("made") / "table"
    render_recording(make_scene("table", 3, frames=40), path, size=(320, 240))
    return path


def test_poses_tell_which_camera_the_intrinsics_are_of(table, tmp_path):
    """Depth and poses fit together: the optical center of color is 12 pixels farther right."""
    recording = cuboid.open_recording(shifted(table, tmp_path / "shifted", 12))
    K = open_recording(table).intrinsics
    camera = recording.depth_camera
    assert (camera.fx, camera.cx, camera.cy) == (K.fx, K.cx, K.cy)
    assert recording.intrinsics.cx == pytest.approx(K.cx + 12, abs=1)
    (warning,) = recording.warnings
    assert warning.startswith("depth was displaced from color by 12 px and is registered now")


@pytest.fixture(scope="module")
def untouched(table, tmp_path_factory):
    """The objects of the recording whose color and depth are registered."""
    output = tmp_path_factory.mktemp("untouched") / "results"
    assert main(["track", str(table), "--output", str(output), "--threads", "1"]) == 0
    return open_results(output).objects


# Largest displacement of an object whose unseen side is guessed with the help of color, and of the others. Color is
# displaced from depth here, so the guess differs: by 1.1 cm (1.05 cm in a run without color). Objects that were placed
# by displaced color moved by 9 to 19 cm.
GUESSED_M, SEEN_M = 0.02, 0.005


def test_a_registration_that_no_two_cameras_have_is_not_taken(table, tmp_path):
    recording = cuboid.open_recording(shifted(table, tmp_path / "shifted", 40))
    assert recording.depth_camera is None
    (warning,) = recording.warnings
    assert warning.startswith("depth is displaced from color by about ")
    assert ", but no two cameras side by side are displaced like this: depth is not changed" in warning


def test_a_run_whose_depth_stays_beside_color_says_it_once(table, untouched, tmp_path):
    folder = shifted(table, tmp_path / "shifted", 25)
    objects = {}
    for register in ("auto", "off"):
        output = tmp_path / register
        assert main(["track", str(folder), "--register", register, "--output", str(output), "--threads", "1"]) == 0
        (warning,) = read_run(output / "run.json").warnings
        assert warning.startswith("depth is displaced from color by about ")
        refused = ", but no two cameras side by side are displaced like this: depth is not changed"
        assert (refused in warning) == (register == "auto")
        objects[register] = (output / "objects.json").read_bytes()
    assert objects["auto"] == objects["off"]
    found = open_results(tmp_path / "auto").objects
    # Beside its depth, the color no longer says that the least probable object is one whole thing.
    least = min(untouched, key=lambda item: item.probability)
    assert len(found) >= len(untouched) - 1
    sure = [item for item in untouched if item is not least]
    moved_m = sorted(min(np.linalg.norm(one.box.center - item.box.center) for one in found) for item in sure)
    assert max(moved_m) < GUESSED_M
    assert moved_m[-2] < SEEN_M


def test_a_registration_that_does_not_fit_the_poses_is_not_taken(table, tmp_path):
    """The depth camera is named as it is; only its center could be moved, against depth and poses."""
    folder = shifted(table, tmp_path / "shifted", 12)
    K = open_recording(table).intrinsics
    camera = json.loads((folder / "camera.json").read_text())
    named = {name: getattr(K, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    camera |= {"depth_camera": named, "T_color_depth": np.eye(4).tolist()}
    (folder / "camera.json").write_text(json.dumps(camera))
    recording = cuboid.open_recording(folder, register="on")
    assert recording.depth_camera.cx == K.cx
    (warning,) = recording.warnings
    assert "but no registration fits the given poses: depth is not changed" in warning


def test_a_camera_that_stands_shows_it_in_the_parts_of_its_image(tmp_path):
    T_color_depth = np.eye(4)
    T_color_depth[0, 3] = -0.12  # about 12 px at 2.6 m
    folder, truth = make(tmp_path / "made", T_color_depth, COLOR, places=1)
    recording = open_recording(folder)
    registration = register_recording(recording)
    found, mended = registration.found, registration.recording
    assert found.views == 1
    assert found.clear
    assert found.magnification == 1.0
    assert errors(mended, truth) < 0.5 * errors(recording, truth)
    assert not register_recording(open_recording(make(tmp_path / "good", np.eye(4), COLOR, places=1)[0])).found.clear


def test_the_outline_of_one_object_does_not_show_it(tmp_path):
    box = (slice(80, 160), slice(120, 220))
    depth_m, color = np.full((240, 320), 1.5, np.float32), np.full((240, 320, 3), 90, np.uint8)
    depth_m[box], color[box] = 1.0, 200
    root = make_flat(tmp_path, color, np.roll(depth_m, 14, axis=1))
    registration = register_recording(open_recording(root))
    found, same = registration.found, registration.recording
    assert found.off_px == pytest.approx(14, abs=2)
    assert not found.clear
    assert same.depth_camera is None


def replace_camera(camera):
    return replace(camera, fx=DEPTH.fx, fy=DEPTH.fy, cx=DEPTH.cx, cy=DEPTH.cy, T_color_depth=beside())


def test_depth_that_clearly_lies_beside_color_is_registered_unless_the_user_says_no(deregistered, tmp_path, capsys):
    folder, _ = deregistered
    assert main(["track", str(folder), "--output", str(tmp_path / "a")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "warning: depth was displaced from color by 1" in said
    assert "--register off leaves depth unchanged" in said
    config = json.loads((tmp_path / "a" / "run.json").read_text())["config"]
    assert config["depth_camera"]["fx"] == pytest.approx(DEPTH.fx, rel=0.01)
    assert np.shape(config["T_color_depth"]) == (4, 4)
    assert main(["report", str(tmp_path / "a"), "--force"]) == 0  # opens the recording as it was tracked
    assert main(["track", str(folder), "--register", "off", "--output", str(tmp_path / "b")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "depth is displaced from color by about 1" in said
    assert "use --register on" in said


@pytest.mark.parametrize("named", ["color", "depth"])
def test_named_intrinsics_may_be_those_of_either_camera(tmp_path, named):
    camera = {"color": COLOR, "depth": DEPTH}[named]
    recording = cuboid.open_recording(make(tmp_path / "made", beside(), DEPTH, named=camera)[0])
    assert recording.intrinsics.fx == pytest.approx(COLOR.fx, rel=0.015)
    assert recording.depth_camera.fx == pytest.approx(DEPTH.fx, rel=0.015)


def test_no_word_where_depth_is_registered(registered, capsys, tmp_path):
    folder, _ = registered
    recording = open_recording(folder)
    registration = register_recording(recording)
    found, same = registration.found, registration.recording
    assert not found.clear
    assert same is recording
    assert registration_warning(recording.read, recording.intrinsics, range(FRAMES)) is None
    assert main(["slam", str(folder), "--register", "--output", str(tmp_path / "out")]) == 0
    assert "depth is not clearly displaced from color" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    "name", ["desk-realsense", "rgbd-scenes-v2", "rgbd_dataset_freiburg1_xyz", "office-scan", "dish-from-above"]
)
def test_no_word_about_real_recordings(data_dir, name):
    assert cuboid.open_recording(data_dir / name).depth_camera is None
    recording = open_recording(data_dir / name).without_poses()
    last = range(2 * len(recording) // 3, len(recording))
    for frames in (range(len(recording)), last):
        assert registration_warning(recording.read, recording.intrinsics, frames) is None


@pytest.mark.parametrize(
    "name", ["desk-realsense", "rgbd-scenes-v2", "rgbd_dataset_freiburg1_xyz", "office-scan", "dish-from-above"]
)
def test_no_word_about_a_single_view_of_real_recordings(data_dir, name):
    recording = open_recording(data_dir / name).without_poses()
    read = cache(recording.read)
    for frame in np.linspace(0, len(recording) - 1, 5).astype(int).tolist():
        assert registration_warning(read, recording.intrinsics, [frame] * FRAMES) is None


def test_depth_of_a_real_camera_that_stands_is_registered(data_dir):
    recording = open_recording(data_dir / "overhead-hands")
    registration = register_recording(recording)
    found, mended = registration.found, registration.recording
    assert found.views == 1
    assert found.clear
    # what lies on the table, 0.8 m away, is about 22 px right and 4 px up in the depth image
    assert found.shift_px[0] + found.apart_px_m / 0.8 == pytest.approx(-22, abs=3)
    assert found.shift_px[1] == pytest.approx(4, abs=2)
    assert not register_recording(mended).found.clear


def test_a_recording_without_edges_tells_nothing(tmp_path):
    recording = open_recording(make_flat(tmp_path))
    registration = register_recording(recording)
    found, same = registration.found, registration.recording
    assert found is None
    assert same is recording


def make_flat(root, color=np.full((240, 320, 3), 90, np.uint8), depth_m=np.full((240, 320), 1.5, np.float32)):  # noqa: B008
    return write_plain(root, COLOR, [Frame(0, 0.0, color, depth_m, None)], DEPTH_UNITS_PER_M)
