"""Pictures of a known depth camera, not aligned and without intrinsics: the camera is named, with the file to write."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.calibration.known_cameras import CAMERAS, layouts
from cuboid.inputs.recordings.opening import open_recording
from cuboid.lab.synthetic.kinds import make_scene
from cuboid.lab.synthetic.recording import DEPTH_UNITS_PER_M, encode_color, encode_depth
from cuboid.lab.synthetic.view import SceneView

SIZE = (424, 240)
FRAMES = 8


def write(folder, color, depth, apart_m):
    """Write pictures of a made room of two cameras side by side, without any camera file."""
    scene = make_scene("room", 6)
    T = np.eye(4)
    T[0, 3] = apart_m
    seen = SceneView(scene, color)
    measured = SceneView(replace(scene, T_room_camera=scene.T_room_camera @ T), depth)
    for name in ("color", "depth"):
        (folder / name).mkdir(parents=True)
    for k, frame in enumerate(np.linspace(0, len(scene.T_room_camera) - 1, FRAMES).astype(int).tolist()):
        (folder / "color" / f"{k}.jpg").write_bytes(encode_color(seen.render(frame, "clean").color))
        (folder / "depth" / f"{k}.png").write_bytes(encode_depth(measured.render(frame, "clean").depth_m))
    return folder


def pinhole(focal):
    return Intrinsics(focal, focal, (SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2, *SIZE)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """A D435 whose focal lengths differ by 1 % from the data sheet."""
    return write(tmp_path_factory.mktemp("known") / "d435", pinhole(1.01 * 306.2), pinhole(0.99 * 212.0), 0.015)


def test_a_realsense_is_named_with_the_line_for_camera_json(pictures):
    with pytest.raises(InputError, match="the intrinsics and the depth scale are not known") as raised:
        open_recording(pictures, depth_scale=None)
    notes = raised.value.__notes__
    at = next(k for k, note in enumerate(notes) if "agree for this camera: Intel RealSense D435" in note)
    document = json.loads(notes[at + 1])
    assert document["fx"] == pytest.approx(306, abs=3)
    assert document["depth_camera"]["fx"] == pytest.approx(212, abs=3)
    assert document["T_color_depth"][0][3] == 0.015
    document["depth_units_per_metre"] = DEPTH_UNITS_PER_M
    (pictures / "camera.json").write_text(json.dumps(document))
    assert open_recording(pictures).depth_camera is not None
    (pictures / "camera.json").unlink()


def test_a_guess_that_no_two_cameras_fit_gets_the_line_too(pictures):
    document = {"fx": 367.0, "fy": 367.0, "cx": 211.5, "cy": 119.5, "width": 424, "height": 240}
    (pictures / "camera.json").write_text(json.dumps(document | {"depth_units_per_metre": DEPTH_UNITS_PER_M}))
    warnings = open_recording(pictures).warnings
    (pictures / "camera.json").unlink()
    assert all("Intel RealSense D435" in line or "is registered now" in line for line in warnings)
    assert warnings


def test_aligned_pictures_are_of_no_known_pair(tmp_path):
    aligned = write(tmp_path / "aligned", pinhole(306.2), pinhole(306.2), 0.0)
    with pytest.raises(InputError) as raised:
        open_recording(aligned)
    assert not any("for this camera" in note for note in raised.value.__notes__)


def test_where_no_camera_fits_the_three_things_are_listed(tmp_path):
    odd = write(tmp_path / "odd", pinhole(330.0), replace(pinhole(330.0), width=420, height=260, cy=129.5), 0.3)
    with pytest.raises(InputError) as raised:
        open_recording(odd)
    assert any("'depth_camera', and 'T_color_depth'" in note for note in raised.value.__notes__)


@pytest.mark.parametrize(
    ("color", "depth", "names"),
    [
        ((848, 480), (848, 480), {"Intel RealSense D435", "Intel RealSense D415", "Intel RealSense D455"}),
        ((1280, 720), (640, 576), {"Azure Kinect"}),
        ((1920, 1080), (512, 424), {"Kinect for Xbox One"}),
        ((320, 200), (77, 78), set()),
    ],
)
def test_the_sizes_tell_which_cameras_are_possible(color, depth, names):
    assert {camera.name for camera, _ in layouts(color, depth)} == names
    assert len({camera.name for camera in CAMERAS}) == len(CAMERAS)
