from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_recordings import CAMERA, make_plain, write_image

from cuboid.ground.core.errors import InputError
from cuboid.inputs.readers import Calibration, open_recording
from cuboid.inputs.readers.calibration import write_camera
from cuboid.inputs.readers.reopen import reopen_recording
from cuboid.inputs.readers.undistortion import Undistortion, rescaled

K = np.array([[60.0, 0, 31.5], [0, 61.0, 23.5], [0, 0, 1]])
LENS = (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
SIZE = (64, 48)


def bent(K, coefficients, u, v):
    """Where a lens puts what a pinhole would see at pixels u, v (Brown 1966, in OpenCV's order)."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*coefficients, 0, 0, 0, 0)[:8]
    x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
    r2 = x * x + y * y
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    x_bent = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    y_bent = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return K[0, 0] * x_bent + K[0, 2], K[1, 1] * y_bent + K[1, 2]


def straightened(lens, color, raw):
    return lens.color(color), lens.depth(raw)


def places():
    """Color and depth that tell the column and the row of each pixel."""
    v, u = np.mgrid[:48, :64]
    return np.stack([2 * u, 2 * v, np.zeros_like(u)], -1).astype(np.uint8), (1000 + 100 * v + u).astype(np.uint16)


@pytest.mark.parametrize("coefficients", [LENS, LENS[:4], (0.5, -0.1, 0.001, 0.002, 0.01, 0.6, -0.05, 0.02)])
def test_each_pixel_shows_what_the_pinhole_sees(coefficients):
    color, raw = places()
    straight, depth = straightened(Undistortion(K, coefficients, SIZE), color, raw)
    v, u = np.mgrid[:48, :64].astype(float)
    u_bent, v_bent = bent(K, coefficients, u, v)
    inside = (u_bent >= 0) & (u_bent <= 63) & (v_bent >= 0) & (v_bent <= 47)
    assert inside.mean() > 0.8
    np.testing.assert_allclose(straight[inside][:, 0] / 2, u_bent[inside], atol=0.3)
    np.testing.assert_allclose(straight[inside][:, 1] / 2, v_bent[inside], atol=0.3)
    row, column = np.divmod(depth[inside].astype(int) - 1000, 100)
    np.testing.assert_allclose(column, u_bent[inside], atol=0.55)
    np.testing.assert_allclose(row, v_bent[inside], atol=0.55)
    outside = (u_bent < -1) | (u_bent > 64) | (v_bent < -1) | (v_bent > 48)
    assert not depth[outside].any()


def test_depth_is_a_reading_never_a_mean_of_two():
    raw = np.where(np.random.default_rng(0).random((48, 64)) < 0.5, 1000, 3000).astype(np.uint16)
    raw[20:24] = 0
    depth = Undistortion(K, LENS, SIZE).depth(raw)
    assert set(np.unique(depth)) == {0, 1000, 3000}


def test_without_coefficients_nothing_is_touched():
    color, raw = places()
    for none in ((), (0.0, 0.0, 0.0, 0.0)):
        same = straightened(Undistortion(K, none, SIZE), color, raw)
        assert same[0] is color
        assert same[1] is raw


@given(st.floats(0.8, 1.25), st.sampled_from([LENS, LENS[:4]]))
def test_rescaled_coefficients_bend_the_same_pixels_alike(factor, coefficients):
    v, u = np.mgrid[:48:5, :64:5].astype(float)
    longer = K * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]])
    np.testing.assert_allclose(
        bent(longer, rescaled(coefficients, factor), u, v), bent(K, coefficients, u, v), atol=1e-9
    )


@pytest.fixture
def distorted(tmp_path):
    """A plain recording of a lens whose camera.json tells its distortion."""
    made = make_plain(tmp_path)
    color, raw = places()
    for k in range(5):
        write_image(made.color(k), color)
        write_image(made.depth(k), raw)
    camera = {**CAMERA, "depth_units_per_metre": 1000, "distortion": list(LENS)}
    (made.path / "camera.json").write_text(json.dumps(camera))
    return made


def test_frames_of_a_distorted_lens_come_out_straight(distorted):
    recording = open_recording(distorted.path)
    assert recording.distortion == LENS
    color, raw = straightened(Undistortion(K, LENS, SIZE), *places())
    frame = recording.read(1)
    np.testing.assert_array_equal(frame.color, color)
    np.testing.assert_allclose(frame.depth_m, raw / 1000, atol=1e-6)


def test_four_numbers_from_the_user_are_a_pinhole(distorted):
    recording = open_recording(distorted.path, intrinsics=(60, 61, 31.5, 23.5))
    assert recording.distortion == ()
    np.testing.assert_array_equal(recording.read(1).color, places()[0])
    camera = Calibration(60, 61, 31.5, 23.5, None, "a test", LENS)
    assert open_recording(distorted.path, intrinsics=camera).distortion == LENS


def test_a_written_camera_keeps_its_lens(distorted, tmp_path):
    recording = open_recording(distorted.path)
    file = tmp_path / "mine.json"
    write_camera(file, recording.intrinsics, 1000, recording.distortion)
    again = open_recording(distorted.path, intrinsics=file)
    assert again.distortion == pytest.approx(LENS)
    np.testing.assert_array_equal(again.read(0).color, recording.read(0).color)


def test_results_are_shown_on_the_frames_that_they_were_made_from(distorted):
    recording = open_recording(distorted.path)
    for lens in (LENS, ()):
        again = reopen_recording(distorted.path, "plain", recording.intrinsics, lens, None, 4)
        assert again.distortion == lens
        assert np.array_equal(again.read(0).color, recording.read(0).color) == bool(lens)


@pytest.mark.parametrize(
    ("distortion", "says"),
    [
        ([0.1, 0.2, 0.3], r"distortion must have 4, 5, 8 numbers k1, k2, p1, p2, k3, \.\.\., got 3"),
        ([0.1, 0.2, 0.3, "x"], r"distortion\[3\]: expected a number, got 'x'"),
        ([0.1, 0.2, 0.3, True], r"distortion\[3\]: expected a number, got True"),
        (0.1, "distortion: expected a list, got 0.1"),
        ([-3.0, 0, 0, 0], r"distortion coefficients \(camera\.json\) are wrong: they bend the image by more than"),
        ([1e6, 0, 0, 0], "are wrong: they bend the image"),
    ],
)
def test_wrong_coefficients_are_one_line(distorted, distortion, says):
    camera = json.loads((distorted.path / "camera.json").read_text())
    (distorted.path / "camera.json").write_text(json.dumps({**camera, "distortion": distortion}))
    with pytest.raises(InputError, match=says) as caught:
        open_recording(distorted.path)
    assert "\n" not in str(caught.value)


def test_coefficients_that_bend_pixels_to_infinity_are_wrong():
    """Containers of other programs tell any number."""
    K = np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]])
    with pytest.raises(ValueError, match="bend the image by more than a lens does"):
        Undistortion(K, (1e308, 0, 0, 0), (64, 48))
