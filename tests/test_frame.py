"""A frame and its intrinsics: what they accept, and what they refuse in one line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import cuboid
from made_scenes import CAMERA, frame_of, look_at, upright

TABLE = upright((0, 0), (1.4, 1.0, 0.05), z=-0.05)


def made(**values: Any) -> cuboid.Frame:
    """Return a frame of 4 x 3 pixels, some of its values replaced."""
    usual = {"color": np.zeros((3, 4, 3), np.uint8), "depth_m": np.ones((3, 4), np.float32), "timestamp_s": 0.5}
    return cuboid.Frame(**{"index": 7, **usual, **values})


@pytest.mark.parametrize("none", [np.nan, np.inf, -np.inf, -1.0])
def test_depth_that_is_no_reading_becomes_0(none: float) -> None:
    """ROS and other cameras mark no reading as NaN, and as infinite if it is too far."""
    depth_m = np.array([[1.0, none, 0.0, 2.0]] * 3, np.float32)
    np.testing.assert_array_equal(made(depth_m=depth_m).depth_m, [[1, 0, 0, 2]] * 3)
    assert depth_m[0, 1] == none or np.isnan(depth_m[0, 1]), "the caller's array stays"


def test_depth_with_the_wrong_sign_is_refused_and_a_marker_of_no_reading_is_not() -> None:
    readings = np.linspace(0.5, 2, 12, dtype=np.float32).reshape(3, 4)
    with pytest.raises(cuboid.FrameError, match=r"frame 7: 12 depth readings are negative .*: change the sign"):
        made(depth_m=-readings)
    half = np.where(np.arange(12).reshape(3, 4) < 5, readings, -readings)
    with pytest.raises(cuboid.FrameError, match="7 depth readings are negative"):
        made(depth_m=half)
    for marker in (-1.0, -np.inf):
        assert not made(depth_m=np.full((3, 4), marker, np.float32)).has_depth
    marked = np.where(np.arange(12).reshape(3, 4) < 2, readings, np.float32(-1))
    assert (made(depth_m=marked).depth_m > 0).sum() == 2


def test_masked_depth_becomes_0_and_valid_depth_is_not_copied() -> None:
    depth_m = np.full((3, 4), 2, np.float32)
    assert made(depth_m=depth_m).depth_m is depth_m
    frame = made(depth_m=np.ma.masked_greater(depth_m, 1))
    assert type(frame.depth_m) is np.ndarray
    assert not frame.depth_m.any()


def test_a_frame_repeats_another_one_only_if_color_depth_and_pose_are_exactly_equal() -> None:
    frame = made(T_world_camera=np.eye(4))
    assert made(index=8, timestamp_s=0.6, T_world_camera=np.eye(4)).repeats(frame)
    assert made().repeats(made())
    color, depth_m, T = frame.color.copy(), frame.depth_m.copy(), np.eye(4)
    color[2, 3, 1], depth_m[2, 3], T[0, 3] = 1, 1.001, 1e-6
    others = [{"color": color}, {"depth_m": depth_m}, {"T_world_camera": T}, {"T_world_camera": None}]
    for other in others:
        assert not made(**{"T_world_camera": np.eye(4), **other}).repeats(frame), other
    assert not frame.repeats(None)


def test_the_tracker_does_not_see_how_missing_depth_was_marked() -> None:
    def tracked(none: float) -> list[tuple[int, int]]:
        tracker = cuboid.Tracker(CAMERA)
        for k in range(4):
            frame = frame_of([TABLE], look_at([0.1 * k, -1.2, 0.8], [0, 0, 0.05]), k)
            depth_m = np.where(frame.depth_m > 0, frame.depth_m, np.float32(none))
            depth_m[:40] = none
            tracker.update(cuboid.Frame(k, k / 30, frame.color, depth_m, frame.T_world_camera))
        return [(tracker.points_known, len(tracker.planes))]

    assert tracked(np.inf) == tracked(np.nan) == tracked(0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"color": None}, r"frame 7: color must be \(H, W, 3\) uint8, got NoneType"),
        ({"color": np.zeros((3, 4))}, r"frame 7: color must be \(H, W, 3\) uint8, got \(3, 4\) float64"),
        ({"depth_m": [[1.0]]}, r"frame 7: depth must be \(3, 4\) float32 in metres like the color image, got list"),
        ({"depth_m": np.ones((3, 4), np.uint16)}, r"frame 7: depth must be .* got \(3, 4\) uint16"),
        (
            {"color": np.zeros((0, 0, 3), np.uint8), "depth_m": np.zeros((0, 0), np.float32)},
            "frame 7: images must",
        ),
        ({"index": 1.5}, r"a frame's index must be a whole number from 0, got 1\.5"),
        ({"index": True}, "a frame's index must be a whole number from 0, got True"),
        ({"index": -1}, "a frame's index must be a whole number from 0, got -1"),
        ({"index": "a"}, "a frame's index must be a whole number from 0, got 'a'"),
        ({"timestamp_s": None}, "frame 7: expected a time in seconds, got None"),
        ({"timestamp_s": float("nan")}, "frame 7: expected a time in seconds, got nan"),
        ({"timestamp_s": 1_700_000_000_000_000_000}, "frame 7: expected a time in seconds, got 1700000000000000000"),
    ],
)
def test_a_frame_that_is_none_is_refused_in_one_line(values: dict[str, Any], message: str) -> None:
    with pytest.raises(cuboid.FrameError, match=message):
        made(**values)


@pytest.mark.parametrize("index", [1.5, True, -1])
def test_a_skipped_frame_has_the_number_of_a_frame(index: Any) -> None:
    assert cuboid.SkippedFrame(np.int64(3), "torn") == cuboid.SkippedFrame(3, "torn")  # type: ignore[arg-type]
    with pytest.raises(cuboid.FrameError, match="a frame's index must be a whole number from 0"):
        cuboid.SkippedFrame(index, "torn")


def test_intrinsics_of_any_number_type_are_floats_and_whole_pixels() -> None:
    """Kernels are compiled for 64-bit floats, and sizes are used as slices."""
    camera = cuboid.Intrinsics(np.float32(500), 500, np.float64(2), 1, np.int64(4), 3.0)  # type: ignore[arg-type]
    assert camera == cuboid.Intrinsics(500.0, 500.0, 2.0, 1.0, 4, 3)
    values = (camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
    assert [type(value) for value in values] == [float] * 4 + [int] * 2


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((float("nan"), 1, 1, 1, 4, 3), "intrinsics need finite values and fx, fy > 0, got fx, fy, cx, cy = .nan, 1"),
        ((None, 1, 1, 1, 4, 3), "intrinsics need finite values and fx, fy > 0"),
        ((-5, 1, 1, 1, 4, 3), "intrinsics need finite values and fx, fy > 0"),
        ((10**400, 1, 1, 1, 4, 3), "intrinsics need finite values and fx, fy > 0"),
        ((1, 1, 1, 1, 4.5, 3), "intrinsics need a positive image size in whole pixels, got 4.5 x 3"),
        ((1, 1, 1, 1, 0, 3), "intrinsics need a positive image size in whole pixels, got 0 x 3"),
    ],
)
def test_intrinsics_that_are_none_are_refused_in_one_line(values: tuple[Any, ...], message: str) -> None:
    with pytest.raises(cuboid.InputError, match=message):
        cuboid.Intrinsics(*values)


@pytest.mark.parametrize("intrinsics", [None, np.eye(3), [500, 500, 320, 240]])
def test_the_tracker_names_the_intrinsics_that_it_expects(intrinsics: Any) -> None:
    with pytest.raises(cuboid.InputError, match=r"expected intrinsics as cuboid.Intrinsics\(fx, .*got "):
        cuboid.Tracker(intrinsics)
