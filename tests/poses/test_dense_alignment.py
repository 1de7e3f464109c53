from __future__ import annotations

import numpy as np
import pytest
from posed_pictures import CAMERA, black, camera_path, picture

from cuboid.ground.core.frame import Frame
from cuboid.ground.geometry import se3
from cuboid.method.poses.alignment import Prior, align, merge, pick
from cuboid.method.poses.pyramid import build_levels, keep, shrink

PATH = camera_path(25)


def levels_of(frame: Frame):
    return build_levels(*shrink(frame, CAMERA))


@pytest.fixture(scope="module")
def first():
    return levels_of(picture(PATH[0], 0))


def error(T_found: np.ndarray, k: int, origin: int = 0) -> tuple[float, float]:
    """Metres and degrees off the true motion from one picture to another."""
    true = se3.inverse(PATH[k]) @ PATH[origin]
    away = se3.log(T_found @ se3.inverse(true))
    return float(np.linalg.norm(away[:3])), float(np.degrees(np.linalg.norm(away[3:])))


@pytest.mark.parametrize("k", [1, 2, 4])
def test_a_known_motion_is_found_from_nothing(first, k: int) -> None:
    found = align(pick(first), levels_of(picture(PATH[k], k)), np.eye(4))
    metres, degrees = error(found.T_camera_reference, k)
    assert metres < 0.004
    assert degrees < 0.15
    assert found.reliable
    assert found.inliers > 0.9
    assert found.correlation > 0.9


def test_it_is_found_in_another_light(first) -> None:
    frame = picture(PATH[2], 2)
    dark = Frame(2, frame.timestamp_s, (frame.color * 0.7 + 10).astype(np.uint8), frame.depth_m)
    found = align(pick(first), levels_of(dark), np.eye(4))
    assert error(found.T_camera_reference, 2)[0] < 0.004
    np.testing.assert_allclose(found.shade[0, 0], 1 / 0.7, rtol=0.05)


def test_something_that_moved_into_the_picture_does_not_disturb(first) -> None:
    frame = picture(PATH[2], 2)
    color, depth_m = frame.color.copy(), frame.depth_m.copy()
    color[80:200, 60:140], depth_m[80:200, 60:140] = 200, 0.5
    found = align(pick(first), levels_of(Frame(2, 0.0, color, depth_m)), np.eye(4))
    assert error(found.T_camera_reference, 2)[0] < 0.004


def test_a_wrong_pose_does_not_hold(first) -> None:
    elsewhere = levels_of(picture(PATH[24], 24))
    assert not align(pick(first), elsewhere, np.eye(4)).reliable


def test_a_black_picture_does_not_hold_even_with_depth(first) -> None:
    frame = picture(PATH[1], 1)
    dark = Frame(1, 0.0, np.zeros_like(frame.color), frame.depth_m)
    assert not align(pick(first), levels_of(dark), np.eye(4)).reliable
    assert not align(pick(first), levels_of(black(1)), np.eye(4)).reliable


def test_a_flat_wall_without_texture_does_not_hold() -> None:
    color = np.full((240, 320, 3), 128, np.uint8)
    wall = levels_of(Frame(0, 0.0, color, np.full((240, 320), 1.5, np.float32)))
    assert not align(pick(wall), wall, np.eye(4)).reliable


def test_points_of_several_pictures_align_as_well_as_one(first) -> None:
    others = [levels_of(picture(PATH[k], k)) for k in (0, 3)]
    common = [se3.inverse(PATH[0]) @ PATH[k] for k in (0, 3)]
    reference = merge([pick(levels) for levels in others], common)
    assert reference.groups == 2
    found = align(reference, levels_of(picture(PATH[5], 5)), se3.inverse(PATH[4]) @ PATH[0])
    metres, degrees = error(found.T_camera_reference, 5)
    assert metres < 0.004
    assert degrees < 0.15


def test_a_prior_holds_what_the_pictures_leave_open() -> None:
    """A textureless wall says nothing about a way along it: the prior decides that, and only that."""
    wall = levels_of(Frame(0, 0.0, np.full((240, 320, 3), 128, np.uint8), np.full((240, 320), 1.5, np.float32)))
    nearer = levels_of(Frame(1, 0.0, np.full((240, 320, 3), 128, np.uint8), np.full((240, 320), 1.48, np.float32)))
    expected = se3.exp([0.03, -0.02, 0.0, 0.0, 0.0, 0.0])
    found = align(pick(wall), nearer, expected, Prior(expected, np.diag([1e4] * 3 + [1e4] * 3)))
    np.testing.assert_allclose(found.T_camera_reference[:3, 3], [0.03, -0.02, -0.02], atol=2e-3)


def test_the_covariance_tells_the_direction_in_doubt(first) -> None:
    found = align(pick(first), first, np.eye(4))
    wall = levels_of(Frame(0, 0.0, np.full((240, 320, 3), 128, np.uint8), np.full((240, 320), 1.5, np.float32)))
    blind = align(pick(wall), wall, np.eye(4))
    assert np.sqrt(found.covariance().diagonal()[:3]).max() < 0.005
    sideways, ahead = np.sqrt(blind.covariance().diagonal()[[0, 2]])
    assert sideways > 20 * ahead


def test_what_is_kept_of_a_keyframe_gives_the_same_levels() -> None:
    gray, depth_m, camera = shrink(picture(PATH[0], 0), CAMERA)
    again = keep(gray, depth_m, camera).levels()
    for one, two in zip(build_levels(gray, depth_m, camera), again, strict=True):
        np.testing.assert_array_equal(one.image[..., 0], two.image[..., 0])
        there = (one.image[..., 3] > 0) & (two.image[..., 3] > 0)
        assert np.abs(one.image[..., 3] - two.image[..., 3])[there].mean() < 2e-4
