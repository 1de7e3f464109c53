from __future__ import annotations

import numpy as np

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import MapPoints
from cuboid.ground.geometry.se3 import compose, transform
from cuboid.results.views.overlays import depth_picture, heat_over, map_heat

INTRINSICS = Intrinsics(500.0, 500.0, 319.5, 239.5, 640, 480)


def test_cold_pixels_stay_as_they_are_and_hotter_ones_change_more() -> None:
    color = np.full((4, 256, 3), 60, np.uint8)
    heat = np.tile(np.linspace(0, 1, 256, dtype=np.float32), (4, 1))
    picture = heat_over(color, heat).astype(int)
    assert (picture[:, 0] == 60).all()
    brightness = picture[0].sum(axis=1)
    assert (np.diff(brightness[90:]) >= -2).all()
    assert brightness[-1] - brightness[0] > 300


def test_heat_of_fewer_pixels_fills_the_picture() -> None:
    color = np.zeros((480, 640, 3), np.uint8)
    heat = np.zeros((120, 160), np.float32)
    heat[30:60, 40:80] = 1.0
    hot = heat_over(color, heat).sum(axis=2) > 300
    assert hot[130:230, 170:310].all()
    assert not hot[:110].any()
    assert not hot[:, 340:].any()


def test_near_is_bright_far_is_dark_and_no_reading_is_black() -> None:
    depth_m = np.full((60, 90), 1.0, np.float32)
    depth_m[:, 30:60], depth_m[:, 60:] = 3.0, 0.0
    picture = depth_picture(depth_m, INTRINSICS).astype(int).sum(axis=2)
    assert picture[30, 15] > picture[30, 45] > 0
    assert (picture[:, 60:] == 0).all()


def test_a_slope_towards_the_light_is_brighter() -> None:
    """Light comes from above: a floor that rises away from the camera gets more of it than a ceiling."""
    v = np.arange(60, dtype=np.float32)[:, None] - 30
    floor = np.broadcast_to(1.5 / (1 + v * 0.005), (60, 90)).astype(np.float32)
    ceiling = np.ascontiguousarray(floor[::-1])
    bright = [depth_picture(np.ascontiguousarray(depth_m), INTRINSICS)[25:35].sum() for depth_m in (floor, ceiling)]
    assert bright[0] > bright[1]


def points_of(xyz: np.ndarray, heat: np.ndarray | float) -> MapPoints:
    n = len(xyz)
    heats = np.broadcast_to(np.float32(heat), n).astype(np.float32)
    return MapPoints(xyz.astype(np.float32), np.zeros((n, 3), np.uint8), heats, np.zeros(n, np.int32))


def plane(z: float, half: float, step: float = 0.01) -> np.ndarray:
    x, y = np.meshgrid(np.arange(-half, half, step), np.arange(-half, half, step))
    return np.column_stack((x.ravel(), y.ravel(), np.full(x.size, z)))


def test_the_heat_of_the_map_is_seen_where_its_points_are_without_holes() -> None:
    T_world_camera = compose((0.8, 0.3, -0.2, 0.4), (1.0, 2.0, -0.5))
    xyz = plane(1.0, 0.2)
    points = points_of(transform(T_world_camera, xyz), np.where(xyz[:, 0] < 0, 1.0, 0.25))
    heat = map_heat(points, np.full((480, 640), 1.0, np.float32), T_world_camera, INTRINSICS)
    assert heat.shape == (480, 640)
    assert heat.dtype == np.float32
    assert (heat[160:320, 240:300] > 0.95).all()  # u = 319.5 + 500 x: the left half
    np.testing.assert_allclose(heat[160:320, 340:400], 0.25, atol=0.02)
    assert not heat[:, :195].any()
    assert not heat[:115].any()


def test_the_nearer_point_counts_and_what_the_surface_hides_does_not() -> None:
    both = np.concatenate((plane(2.0, 0.4), plane(1.0, 0.2)))
    heat_of = np.concatenate((np.full(len(plane(2.0, 0.4)), 1.0), np.full(len(plane(1.0, 0.2)), 0.5)))
    for order in (np.arange(len(both)), np.arange(len(both))[::-1]):
        points = points_of(both[order], heat_of[order])
        open_view = map_heat(points, np.zeros((480, 640), np.float32), np.eye(4), INTRINSICS)
        np.testing.assert_allclose(open_view[180:300, 260:380], 0.5, atol=0.02)
    wall = map_heat(points_of(plane(2.0, 0.4), 1.0), np.full((480, 640), 1.0, np.float32), np.eye(4), INTRINSICS)
    assert not wall.any()


def test_points_behind_the_camera_and_no_points_give_no_heat() -> None:
    depth_m = np.ones((480, 640), np.float32)
    for xyz in (plane(-1.0, 0.2), np.zeros((0, 3))):
        assert not map_heat(points_of(xyz, 1.0), depth_m, np.eye(4), INTRINSICS).any()
