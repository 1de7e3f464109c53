from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.depth import SAME_SURFACE
from cuboid.ground.core.downscaling import downscale
from cuboid.ground.core.frame import Frame, Intrinsics

K = Intrinsics(50.0, 50.0, 31.5, 23.5, 64, 48)


def plane_depth(intrinsics: Intrinsics) -> np.ndarray:
    """Depth of the plane 0.3 x + 0.2 y + z = 2 through each pixel's centre."""
    u, v = np.meshgrid(np.arange(intrinsics.width), np.arange(intrinsics.height))
    x, y = (u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy
    return (2.0 / (0.3 * x + 0.2 * y + 1.0)).astype(np.float32)


def frame(depth_m: np.ndarray) -> Frame:
    return Frame(3, 0.5, np.zeros((*depth_m.shape, 3), np.uint8), depth_m, np.eye(4))


@pytest.mark.parametrize("factor", [2, 4])
def test_depth_and_pinhole_of_the_small_image_agree(factor: int) -> None:
    small = downscale(frame(plane_depth(K)), factor)
    np.testing.assert_allclose(small.depth_m, plane_depth(K.downscaled(factor)), rtol=2e-3)
    assert (small.index, small.timestamp_s, small.depth_m.dtype) == (3, 0.5, np.float32)


def halved_depth(depth_m: np.ndarray) -> np.ndarray:
    """The truth of the kernel, a block at a time."""
    height, width = depth_m.shape[0] // 2, depth_m.shape[1] // 2
    out_m = np.zeros((height, width), np.float32)
    for v in range(height):
        for u in range(width):
            block = depth_m[2 * v : 2 * v + 2, 2 * u : 2 * u + 2].ravel()
            known = np.sort(block[block > 0])
            if len(known) < 2:
                out_m[v, u] = known[0] if len(known) else 0.0
                continue
            near, far = known[:2] if len(known) == 2 else known[1:3]
            out_m[v, u] = (near + far) / 2 if far <= near * (1 + SAME_SURFACE) else near
    return out_m


def test_the_kernel_is_equal_to_its_truth() -> None:
    rng = np.random.default_rng(1)
    depth_m = rng.choice(np.array([0, 0, 1, 1.004, 1.009, 1.02, 2], np.float32), (40, 60))
    out_m = downscale(frame(depth_m), 2).depth_m
    np.testing.assert_allclose(out_m, halved_depth(depth_m), rtol=1e-6)


def test_no_depth_between_two_surfaces() -> None:
    depth_m = np.full((8, 8), 1.0, np.float32)
    depth_m[:, 3:] = 2.0
    assert set(np.unique(downscale(frame(depth_m), 2).depth_m)) == {1.0, 2.0}


def test_holes_stay_holes_and_do_not_pull() -> None:
    depth_m = np.array([[0, 0, 1.0, 0, 1, 1], [0, 0, 0, 1.004, 0, 1.004]], np.float32)
    np.testing.assert_allclose(downscale(frame(depth_m), 2).depth_m, [[0, 1.002, 1.002]], atol=1e-6)


def test_color_is_the_mean_of_the_block_and_odd_rows_are_left_out() -> None:
    color = np.zeros((5, 7, 3), np.uint8)
    color[0, 0] = 100
    small = downscale(Frame(0, 0.0, color, np.ones((5, 7), np.float32)), 2)
    assert small.color.shape == (2, 3, 3)
    assert small.color[0, 0].tolist() == [25, 25, 25]
    assert small.depth_m.shape == (2, 3)


def test_scale_one_is_the_frame_itself() -> None:
    whole = frame(plane_depth(K))
    assert downscale(whole, 1) is whole


def test_a_reading_is_a_point_on_the_ray_of_its_pixel() -> None:
    camera = Intrinsics(100.0, 200.0, 50.0, 40.0, 101, 81)
    points = camera.points(np.array([50, 60, 0]), np.array([40, 40, 80]), np.array([2.0, 1.0, 0.5], np.float32))
    assert points.tolist() == [[0.0, 0.0, 2.0], [0.1, 0.0, 1.0], [-0.25, 0.1, 0.5]]
    np.testing.assert_allclose(camera.pixels(points), [[50, 40], [60, 40], [0, 80]])
