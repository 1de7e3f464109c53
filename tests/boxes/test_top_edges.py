"""Length and width from the edges of a top in a color image, where depth has them wrong."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import inverse
from cuboid.method.boxes.measured_sides import (
    MAX_SIDE_VIEWS,
    along_axes,
    measured,
    still_valid,
    view_is_due,
    with_sides,
    with_view,
)
from cuboid.method.boxes.top_edges import Picture, top_sides
from made_scenes import cast, look_at, upright

CAMERA = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
TABLE = upright((0.0, 0.0), (4.0, 4.0, 0.05), z=-0.05)
TRUE = upright((0.05, -0.03), (0.2, 0.12, 0.08), 0.3)
VOXEL_M, PIXEL_M = 0.01, 0.8 / 600.0
ABOVE, SIDE = look_at((0.0, 1e-3, 0.88), (0.0, 0.0, 0.0)), look_at((0.0, -0.62, 0.62), (0.0, 0.0, 0.0))


def picture(pose: np.ndarray, thing: Box = TRUE, contrast: float = 1.0, round_top: bool = False) -> Picture:
    """A box or a can of another color than the table, its sides darker than its top, with noise and a print."""
    depth_m, hit = cast([TABLE, thing], pose, CAMERA)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    world = CAMERA.points(u, v, depth_m) @ pose[:3, :3].T + pose[:3, 3]
    local = (world - thing.center) @ thing.rotation
    top = (hit == 1) & (local[..., 2] > thing.size[2] / 2.0 - 1e-6)
    if round_top:  # seen from straight above: the rest of the square is table
        top &= np.hypot(local[..., 0], local[..., 1]) < thing.size[0] / 2.0
        depth_m = np.where((hit == 1) & ~top, depth_m + thing.size[2], depth_m)
        hit = np.where((hit == 1) & ~top, 0, hit)
    color = np.array([130.0, 120.0, 110.0]) + contrast * (
        np.where(top, 60.0, 0.0)[..., None] * [1.0, -0.6, -1.0] - np.where((hit == 1) & ~top, 40.0, 0.0)[..., None]
    )
    color[top & (np.hypot(local[..., 0] - 0.03, local[..., 1]) < 0.02)] = 30.0
    rng = np.random.default_rng(3)
    color = cv2.GaussianBlur(color, (3, 3), 0.6) + rng.normal(0.0, 2.0, color.shape)
    noisy_m = depth_m + 1e-3 * depth_m**2 * rng.standard_normal(depth_m.shape)
    return Picture(np.clip(color, 0, 255).astype(np.uint8), noisy_m.astype(np.float32), CAMERA, inverse(pose), 1e-3)


def wrong(box: Box, length_m: float, width_m: float, turn_rad: float = 0.0) -> Box:
    """The box as depth has it: displaced, turned, and with other sides."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    R = box.rotation @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    moved, grown = np.array([0.002, -0.001, 0.0]), np.array([length_m, width_m, 0.0])
    return Box(box.center + moved, box.size + grown, R)


@pytest.mark.parametrize("pose", [ABOVE, SIDE])
@pytest.mark.parametrize("off_m", [-0.008, 0.003])
def test_the_sides_are_those_of_the_top_wherever_depth_ends(pose: np.ndarray, off_m: float) -> None:
    found = top_sides(wrong(TRUE, off_m, off_m / 2.0, np.radians(0.8)), picture(pose), 0.0)
    np.testing.assert_allclose(found[:2], TRUE.size[:2], atol=0.4 * PIXEL_M)
    np.testing.assert_allclose(found[2:], PIXEL_M, rtol=0.1)


def test_a_round_top_has_its_diameter() -> None:
    can = upright((0.02, 0.01), (0.12, 0.12, 0.08), 0.1)
    found = top_sides(wrong(can, -0.006, -0.004), picture(ABOVE, can, round_top=True), 0.0)
    assert found[0] == found[1] == pytest.approx(0.12, abs=0.5 * PIXEL_M)


@pytest.mark.parametrize("lid_m", [0.056, 0.057, 0.0575])
def test_the_outermost_circle_is_the_outline_of_a_can_with_a_lid(lid_m: float) -> None:
    can = upright((0.02, 0.01), (0.12, 0.12, 0.08), 0.1)
    seen = picture(ABOVE, can, round_top=True)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    world = CAMERA.points(u, v, np.full(u.shape, 0.8)) @ ABOVE[:3, :3].T + ABOVE[:3, 3]
    lid = np.hypot(world[..., 0] - 0.02, world[..., 1] - 0.01) < lid_m  # of another color, and a stronger edge
    color = np.where(lid[..., None], np.array([60, 140, 150]), seen.color).astype(np.uint8)
    found = top_sides(wrong(can, -0.007, -0.007), replace(seen, color=color), 0.0)
    assert found[0] == found[1] == pytest.approx(0.12, abs=0.5 * PIXEL_M)


def test_edges_that_are_not_clear_are_left_to_depth() -> None:
    seen = picture(ABOVE)
    assert np.isnan(top_sides(TRUE, picture(ABOVE, contrast=0.02), 0.0)).all()
    below_m = np.array([0.05, 0.0])  # the edge of a lower part appears displaced
    assert np.isnan(top_sides(TRUE, seen, 0.0, below_m)).tolist() == [True, False, True, False]
    assert np.isnan(top_sides(wrong(TRUE, 0.06, 0.06), seen, 0.0)).all()  # no top at the expected edges
    assert np.isnan(top_sides(Box(TRUE.center, np.array([0.01, 0.008, 0.08]), TRUE.rotation), seen, 0.0)).all()
    level = look_at((0.0, -0.9, 0.2), (0.0, 0.0, 0.08))
    assert np.isnan(top_sides(TRUE, picture(level), 0.0)).all()


def test_the_same_picture_gives_the_same_sides() -> None:
    box, seen = wrong(TRUE, -0.004, 0.002), picture(SIDE)
    np.testing.assert_array_equal(top_sides(box, seen, 0.0), top_sides(box, seen, 0.0))


def test_the_median_of_the_views_is_taken_and_the_centre_stays() -> None:
    views = np.array([[0.2, 0.12, 1e-3, 1e-3], [0.201, np.nan, 1e-3, np.nan], [0.3, 0.121, 1e-3, 1e-3]])
    box = wrong(TRUE, -0.008, -0.004)
    found = with_sides(box, views, VOXEL_M)
    np.testing.assert_allclose(found.size, [0.201, 0.1205, 0.08])
    np.testing.assert_array_equal(found.center, box.center)
    np.testing.assert_array_equal(measured(found, views, VOXEL_M)[1], [1e-3, 1e-3])


def test_views_follow_the_axes_of_the_box_and_end_when_the_object_grows() -> None:
    views = np.array([[0.2, 0.12, 1e-3, 2e-3]])
    turned = Box(TRUE.center, TRUE.size[[1, 0, 2]], TRUE.rotation[:, [1, 0, 2]] * [1.0, -1.0, 1.0])
    np.testing.assert_array_equal(along_axes(views, TRUE, turned), [[0.12, 0.2, 2e-3, 1e-3]])
    assert not len(along_axes(views, TRUE, wrong(TRUE, 0.0, 0.0, 0.4)))
    assert len(still_valid(views, TRUE, wrong(TRUE, 0.003, 0.0), VOXEL_M)) == 1
    assert not len(still_valid(views, TRUE, wrong(TRUE, 0.1, 0.0), VOXEL_M))


@pytest.mark.parametrize(("side_m", "is_lid"), [(0.195, False), (0.193, True), (0.207, False)])
def test_a_side_much_shorter_than_that_of_depth_is_of_a_lid(side_m: float, is_lid: bool) -> None:
    views = np.array([[side_m, np.nan, 1.5e-3, np.nan]])
    assert len(still_valid(views, TRUE, TRUE, VOXEL_M)) == (0 if is_lid else 1)
    np.testing.assert_allclose(with_sides(TRUE, views, VOXEL_M).size[0], TRUE.size[0] if is_lid else side_m)


@pytest.mark.parametrize(
    ("views", "new_viewpoint", "due"),
    [(0, False, [1, 2, 3, 5, 8, 12, 18]), (1, True, [1, 2, 3, 5, 8, 12, 18]), (1, False, [1, 2, 4, 8, 16])],
)
def test_an_object_is_measured_the_rarer_the_longer_it_was_seen(
    views: int, new_viewpoint: bool, due: list[int]
) -> None:
    last, found = 0, []
    for sightings in range(1, 20):
        if view_is_due(np.ones((views, 4)), sightings, last, new_viewpoint=new_viewpoint):
            last = sightings
            found.append(sightings)
    assert found == due


def test_views_without_an_edge_are_not_kept_and_near_ones_replace_those_from_afar() -> None:
    far, near = np.array([0.19, 0.11, 5e-3, 5e-3]), np.array([0.2, 0.12, 1e-3, 1e-3])
    views = np.zeros((0, 4))
    for _ in range(MAX_SIDE_VIEWS + 3):
        views = with_view(with_view(views, far), np.full(4, np.nan))
    assert len(views) == MAX_SIDE_VIEWS
    for count in (1, 2):
        views = with_view(views, near)
        assert np.count_nonzero(views[:, 0] == near[0]) == count
    np.testing.assert_allclose(measured(TRUE, views, VOXEL_M), [near[:2], near[2:]], atol=1e-4)
    assert np.array_equal(with_view(views[-2:].repeat(6, 0), far), views[-2:].repeat(6, 0)), "a worse one is not kept"


@pytest.mark.parametrize("pose", [ABOVE, SIDE])
@pytest.mark.parametrize(("left_m", "right_m"), [(0.0, 0.005), (0.0, 0.007), (0.003, 0.003), (0.004, 0.004)])
@pytest.mark.parametrize("height_m", [0.01, 0.04])
def test_a_side_ends_at_a_lower_part_that_stands_out_not_at_the_top(
    pose: np.ndarray, left_m: float, right_m: float, height_m: float
) -> None:
    whole = upright((0.05, -0.03), (0.2, 0.12, 0.08))
    lower = upright((0.05, -0.03), (0.2, 0.12, height_m))
    upper_x_m = 0.05 + (left_m - right_m) / 2.0
    upper = upright((upper_x_m, -0.03), (0.2 - left_m - right_m, 0.12, 0.08 - height_m), z=height_m)
    depth_m, hit = cast([TABLE, lower, upper], pose, CAMERA)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    z = (CAMERA.points(u, v, depth_m) @ pose[:3, :3].T + pose[:3, 3])[..., 2]
    color = np.full((*depth_m.shape, 3), [130.0, 120.0, 110.0])
    color[hit >= 1] = 90.0, 80.0, 70.0
    color[(hit == 1) & (z > height_m - 1e-4)] = 90.0, 150.0, 60.0
    color[(hit == 2) & (z > 0.08 - 1e-4)] = 190.0, 84.0, 50.0
    color = cv2.GaussianBlur(color, (3, 3), 0.6)
    seen = Picture(color.astype(np.uint8), depth_m.astype(np.float32), CAMERA, inverse(pose), 1e-3)
    found = top_sides(whole, seen, 0.0)
    assert np.isnan(found[0]) or abs(found[0] - 0.2) < PIXEL_M, found
    assert found[1] == pytest.approx(0.12, abs=PIXEL_M)


def test_a_pixel_is_as_wide_as_both_focal_lengths_say() -> None:
    seen = picture(ABOVE)
    camera = replace(CAMERA, fy=CAMERA.fy / 1.21)
    flat = replace(seen, camera=camera, color=stretched(seen.color), depth_m=stretched(seen.depth_m))
    shown = [top_sides(TRUE, one, 0.0)[2] for one in (seen, flat)]
    assert shown[1] == pytest.approx(1.1 * shown[0], rel=0.01)


def stretched(image: np.ndarray) -> np.ndarray:
    """An image as a camera with a shorter focal length along its columns shows it."""
    rows = CAMERA.cy + 1.21 * (np.arange(CAMERA.height) - CAMERA.cy)
    return image[np.clip(np.rint(rows), 0, CAMERA.height - 1).astype(int)]
