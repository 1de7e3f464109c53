"""Plain folders whose camera.json names a depth camera beside the color camera."""

from __future__ import annotations

import dataclasses
import json

import cv2
import numpy as np
import pytest
from made_recordings import color_image, make_plain, write_image

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.readers import open_recording
from cuboid.inputs.readers.reopen import reopen_recording
from cuboid.results.files.report import RunReport

COLOR = {"fx": 120.0, "fy": 120.0, "cx": 79.5, "cy": 59.5, "width": 160, "height": 120, "depth_units_per_metre": 1000}
DEPTH = {"fx": 60.0, "fy": 61.0, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48}
BESIDE = [[1, 0, 0, -0.05], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
LENS = [0.1, -0.05, 0.001, -0.002, 0.01]


def make(root, depth=DEPTH, T=BESIDE, color=COLOR, **more):
    """Color of 160x120, depth of 64x48: a wall at 2 m with a box at 1 m before it."""
    made = make_plain(root, frames=2)
    for k in range(2):
        write_image(made.color(k), color_image(k, (120, 160)))
        wall = np.full((48, 64), 2000, np.uint16)
        wall[16:32, 24:40] = 1000
        write_image(made.depth(k), wall)
    document = color | ({"depth_camera": depth} if depth else {}) | ({"T_color_depth": T} if T else {}) | more
    (made.path / "camera.json").write_text(json.dumps(document))
    return made


def test_depth_is_carried_into_color(tmp_path):
    recording = open_recording(make(tmp_path).path)
    assert recording.intrinsics == Intrinsics(120, 120, 79.5, 59.5, 160, 120)
    frame = recording.read(1)
    assert frame.color.shape == (120, 160, 3)
    near = np.abs(frame.depth_m - 1.0) < 1e-3
    rows, columns = np.nonzero(near)
    # edges of the box: pixel 23.5 to 39.5 of depth, seen by the color camera at 1 m
    left, right = (120 * ((edge - 31.5) / 60 - 0.05) + 79.5 for edge in (23.5, 39.5))
    assert (columns.min(), columns.max()) == pytest.approx((left, right), abs=1)
    assert (rows.min(), rows.max()) == pytest.approx((120 * (15.5 - 23.5) / 61 + 59.5, 120 * 8 / 61 + 59.5), abs=1)
    assert near[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1].all()
    assert (np.isin(np.round(frame.depth_m, 3), (0, 1, 2))).all()
    assert frame.T_world_camera[0, 3] == pytest.approx(0.1)  # of the plain folder's poses: the color camera's


def test_a_distorted_depth_lens_is_taken_into_account(tmp_path):
    recording = open_recording(make(tmp_path, DEPTH | {"distortion": LENS}).path)
    depth = np.full((48, 64), 2000, np.uint16)
    depth[5:8, 50:53] = 0
    write_image(recording.path / "depth" / "000000.png", depth)
    rows, columns = np.nonzero(recording.read(0).depth_m[15:36, 105:126] == 0)
    K = np.array([[60, 0, 31.5], [0, 61, 23.5], [0, 0, 1]])
    x, y = cv2.undistortPoints(np.array([[[51.0, 6.0]]]), K, np.array(LENS))[0, 0]
    place = (120 * (x - 0.05 / 2) + 79.5, 120 * y + 59.5)
    assert (columns.mean() + 105, rows.mean() + 15) == pytest.approx(place, abs=0.6)


def test_depth_that_sees_nothing_of_the_color_image_is_a_bad_frame(tmp_path):
    turned_round = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]
    recording = open_recording(make(tmp_path, T=turned_round).path)
    with pytest.raises(FrameError, match=r"000000\.png has no reading in the color image; check T_color_depth"):
        recording.read(0)


def test_a_depth_image_of_another_size_is_a_bad_frame(tmp_path):
    made = make(tmp_path)
    write_image(made.depth(1), np.full((50, 64), 2000, np.uint16))
    recording = open_recording(made.path)
    recording.read(0)
    with pytest.raises(FrameError, match=r"depth is 64x50, its camera 64x48: depth/000001\.png"):
        recording.read(1)


def test_without_a_depth_camera_sizes_must_be_equal(tmp_path):
    with pytest.raises(
        InputError, match=r"color is 160x120 but depth 64x48, .* must describe the 'depth_camera': color"
    ):
        open_recording(make(tmp_path, depth=None, T=None).path)


@pytest.mark.parametrize(
    ("depth", "T", "says"),
    [
        (DEPTH, None, "'depth_camera' without 'T_color_depth': they belong together"),
        (None, BESIDE, "'T_color_depth' without 'depth_camera'"),
        (DEPTH | {"fx": -1}, BESIDE, r"depth_camera\.fx: expected a number of at least 0\.001, got -1"),
        (DEPTH | {"width": 64.5}, BESIDE, r"depth_camera\.width: expected a whole number, got 64\.5"),
        (DEPTH | {"f": 1}, BESIDE, r"depth_camera: field 'f' is unknown"),
        ({"fx": 1}, BESIDE, r"depth_camera: field 'fy' is missing"),
        ([1], BESIDE, "depth_camera: expected an object"),
        (DEPTH, [[1, 0], [0, 1]], "T_color_depth.0.: expected a list of length 4"),
        (DEPTH, "x", "T_color_depth: expected a list"),
        (DEPTH, [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "the pose is not rigid"),
        (DEPTH, [[1, 0, 0, -50], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "50 m apart; is it in millimetres"),
        (DEPTH | {"distortion": [-9.0, 0, 0, 0]}, BESIDE, r"depth camera \(camera\.json\) is wrong: its distortion"),
        (DEPTH | {"fx": 1e-300}, BESIDE, r"depth_camera\.fx: expected a number of at least 0\.001, got 1e-300"),
    ],
)
def test_a_faulty_depth_camera_is_one_line(tmp_path, depth, T, says):
    with pytest.raises(InputError, match=says) as caught:
        open_recording(make(tmp_path, depth, T).path)
    assert "\n" not in str(caught.value)


def test_results_reopen_the_same_frames(tmp_path):
    recording = open_recording(make(tmp_path, DEPTH | {"distortion": LENS}).path)
    config = json.loads(json.dumps(recording.depth_camera.document()))  # as run.json keeps it
    report = RunReport("0", True, str(recording.path), "plain", "given", 1, config, 2, 2, (), {}, 1.0, 1.0)
    again = reopen_recording(recording.path, "plain", recording.intrinsics, (), report.depth_camera, 1)
    assert np.array_equal(again.read(1).depth_m, recording.read(1).depth_m)
    assert dataclasses.replace(report, config={}).depth_camera is None
