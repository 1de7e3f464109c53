"""Sizes of bodies that do not end where their tops do: the outline is where rays of the camera touch them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import inverse
from cuboid.method.boxes.profile import AXIS, Profile, outline, profile_of, rounded_profile
from cuboid.method.boxes.rims import rim_drop_m, side_drops
from cuboid.method.boxes.top_edges import Picture, top_sides
from made_scenes import cast, look_at, upright

CAMERA = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
TABLE = upright((0.0, 0.0), (4.0, 4.0, 0.05), z=-0.05)
VOXEL_M, PIXEL_M = 0.01, 0.8 / 600.0
ABOVE, SIDE = look_at((0.0, 0.12, 0.88), (0.0, 0.121, 0.0)), look_at((0.0, -0.62, 0.62), (0.0, 0.0, 0.0))


def seen_points(things: list[Box], pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The points of things that a camera sees, one for each voxel; depth; and which thing each pixel shows."""
    depth_m, hit = cast([TABLE, *things], pose, CAMERA)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    world = (CAMERA.points(u, v, depth_m) @ pose[:3, :3].T + pose[:3, 3])[hit >= 1]
    cells, index = np.unique(np.floor(world / VOXEL_M).astype(int), axis=0, return_inverse=True)
    index = index.ravel()
    points = np.column_stack([np.bincount(index, world[:, k]) for k in range(3)]) / np.bincount(index)[:, None]
    assert len(points) == len(cells)
    return points, depth_m, hit


def profile_and_rim(box: Box, points: np.ndarray) -> tuple[Profile, float]:
    profile = profile_of(box, points, VOXEL_M)
    assert profile is not None
    return profile, rim_drop_m(side_drops(box, points, VOXEL_M))


@pytest.mark.parametrize("pose", [ABOVE, SIDE])
@pytest.mark.parametrize("height_m", [0.04, 0.08])
def test_a_body_under_a_narrower_lid_is_as_wide_as_the_body(pose: np.ndarray, height_m: float) -> None:
    body = upright((0.03, -0.02), (0.13, 0.1, height_m), 0.2)
    lid = upright((0.03, -0.02), (0.09, 0.06, 0.05), 0.2, z=height_m)
    points, depth_m, hit = seen_points([body, lid], pose)
    color = np.full((*depth_m.shape, 3), [130.0, 120.0, 110.0])
    color[hit == 1] = 60.0, 90.0, 160.0
    color[hit == 2] = 190.0, 84.0, 50.0
    color = cv2.GaussianBlur(color, (3, 3), 0.6)
    picture = Picture(color.astype(np.uint8), depth_m.astype(np.float32), CAMERA, inverse(pose), 1e-3)
    whole = Box(body.center + np.array([0.0, 0.0, 0.025]), body.size + np.array([-0.004, -0.004, 0.05]), body.rotation)
    profile, rim_m = profile_and_rim(whole, points)
    assert rounded_profile(whole, points, rim_m, VOXEL_M, hollow=False) is not None
    found = top_sides(whole, picture, rim_m, profile=profile)
    # From the side, the lid hides the far end of the width: this is left to depth.
    clear = np.array([True, pose is ABOVE])
    np.testing.assert_array_equal(~np.isnan(found[:2]), clear)
    np.testing.assert_allclose(found[:2][clear], body.size[:2][clear], atol=1.5 * PIXEL_M)


@pytest.mark.parametrize("pose", [ABOVE, SIDE])
def test_a_box_ends_where_its_top_does(pose: np.ndarray) -> None:
    carton = upright((0.05, -0.03), (0.2, 0.12, 0.08), 0.3)
    points, _, _ = seen_points([carton], pose)
    _, rim_m = profile_and_rim(carton, points)
    assert rounded_profile(carton, points, rim_m, VOXEL_M, hollow=False) is None


@pytest.mark.parametrize(("lid_m", "has_lid"), [(0.043, True), (0.049, False)])
def test_a_flat_lid_on_a_wider_jar_is_not_its_outline(lid_m: float, has_lid: bool) -> None:
    # From above and a little aside: the lid, and half of the wall below it.
    turn, rise = np.meshgrid(np.linspace(0.0, np.pi, 16), np.arange(0.005, 0.1, 0.01))
    wall = np.column_stack([0.05 * np.cos(turn.ravel()), 0.05 * np.sin(turn.ravel()), rise.ravel()])
    across = np.stack(np.meshgrid(*2 * [np.arange(-0.05, 0.051, 0.005)]), -1).reshape(-1, 2)
    across = across[np.hypot(*across.T) < lid_m]
    edge = np.linspace(0.0, 2.0 * np.pi, 60)
    flat = np.concatenate([across, lid_m * np.column_stack([np.cos(edge), np.sin(edge)])])
    points = np.concatenate([wall, np.column_stack([flat, np.full(len(flat), 0.12)])])
    jar = upright((0.0, 0.0), (0.1, 0.1, 0.12), 0.0)
    assert (rounded_profile(jar, points, 0.0, VOXEL_M, hollow=False) is not None) == has_lid


def ball(radius_m: float, eye: np.ndarray) -> tuple[Box, np.ndarray]:
    """The box of a ball on the table, and the points of it that a camera at `eye` sees."""
    middle = np.array([0.0, 0.0, radius_m])
    k = np.arange(4000) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / 4000), np.pi * (1.0 + 5.0**0.5) * k
    normals = np.column_stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)])
    points = middle + radius_m * normals
    seen = ((eye - points) * normals).sum(1) > 0.05
    return Box(middle, np.full(3, 2.0 * radius_m), np.eye(3)), points[seen]


@pytest.mark.parametrize("eye", [(0.15, 0.0, 0.9), (0.0, -0.6, 0.65)])
def test_the_outline_of_a_ball_is_where_rays_touch_it(eye: tuple[float, float, float]) -> None:
    radius_m, at = 0.05, np.array(eye)
    box, points = ball(radius_m, at)
    profile, _ = profile_and_rim(box, points)
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    outward = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(12)])
    places, wide = outline(profile, AXIS, box, box.center + radius_m * outward, outward, at)
    # The distance of a ray from the middle of the ball is its radius.
    rays = (places - at) / np.linalg.norm(places - at, axis=1)[:, None]
    away = np.linalg.norm(np.cross(box.center - at, rays), axis=1)
    np.testing.assert_allclose(away[wide], radius_m, atol=0.002)
    assert wide.sum() >= 6


def test_the_far_side_of_a_soft_box_ends_as_its_near_side_does() -> None:
    # A quarter circle of 3 cm from the top to each side; a camera at 45 degrees sees half of the far one.
    turn = np.linspace(0.0, np.pi / 2.0, 40)
    rise, inset = 0.05 + 0.03 * np.sin(turn), 0.03 * (1.0 - np.cos(turn))
    x = np.linspace(-0.05, 0.05, 30)
    near = np.array([(a, -0.06 + i, z) for a in x for i, z in zip(inset, rise, strict=True)])
    wall = np.array([(a, -0.06, z) for a in x for z in np.linspace(0.005, 0.05, 12)])
    far = near[near[:, 2] > 0.05 + 0.03 * np.sqrt(0.5)] * [1.0, -1.0, 1.0]
    top = np.array([(a, b, 0.08) for a in x for b in np.linspace(-0.03, 0.03, 15)])
    points = np.concatenate([near, wall, far, top])
    box = Box(np.array([0.0, 0.0, 0.04]), np.array([0.1, 0.1088, 0.08]), np.eye(3))
    profile, _ = profile_and_rim(box, points)
    true = Box(np.array([0.0, 0.0, 0.04]), np.array([0.1, 0.12, 0.08]), np.eye(3))
    eye, outward = np.array([[0.0, -1.0, 1.04]]), np.array([[0.0, 1.0, 0.0]])
    places, _ = outline(profile, 1, true, true.center + 0.06 * outward, outward, eye[0])
    middle, ray = np.array([0.0, 0.03, 0.05]), (places - eye)[0] / np.linalg.norm(places - eye)
    assert np.linalg.norm(np.cross(middle - eye[0], ray)) == pytest.approx(0.03, abs=0.002)
    assert profile.beyond_m[3] == pytest.approx(0.06 - 0.0544, abs=0.001)  # the seen near side, beyond that of the box
