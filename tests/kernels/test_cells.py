from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cuboid.kernels import cells as kernel

CAMERA = np.array([130.0, 128.0, 80.3, 59.1])


def depth_of_plane(normal: np.ndarray, offset: float) -> np.ndarray:
    v, u = np.mgrid[:120, :160]
    rays = np.stack([(u - CAMERA[2]) / CAMERA[0], (v - CAMERA[3]) / CAMERA[1], np.ones_like(u, float)], -1)
    z = -offset / (rays @ normal)
    return np.where((z > 0) & (z < 5), z, 0).astype(np.float32)


@settings(max_examples=40, deadline=None)
@given(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.floats(0.6, 3.0))
def test_cells_of_a_plane_have_its_normal_and_lie_on_it(tilt_x: float, tilt_y: float, distance: float) -> None:
    normal = np.array([tilt_x, tilt_y, -1.0])
    normal /= np.linalg.norm(normal)
    depth = depth_of_plane(normal, distance)
    cells = np.empty((15 * 20, kernel.CELL_COLUMNS))
    kernel.fit_cells(depth, CAMERA, 8, 5.0, cells)
    good = cells[:, kernel.AREA] > 0
    assert good.any()
    np.testing.assert_allclose(cells[good, :3], np.tile(normal, (good.sum(), 1)), atol=2e-4)
    np.testing.assert_allclose(cells[good, 3:6] @ normal + distance, 0, atol=1e-4)
    assert (cells[good, kernel.RMS] < 1e-5).all()


def test_area_is_that_of_the_surface() -> None:
    cells = np.empty((15 * 20, kernel.CELL_COLUMNS))
    kernel.fit_cells(depth_of_plane(np.array([0, 0, -1.0]), 2.0), CAMERA, 8, 5.0, cells)
    np.testing.assert_allclose(cells[:, kernel.AREA], 64 * 4 / (130.0 * 128.0), rtol=1e-6)


def test_the_fit_is_least_squares_in_inverse_depth() -> None:
    rng = np.random.default_rng(0)
    depth = depth_of_plane(np.array([0.3, -0.5, -0.81]), 1.5)
    depth[depth > 0] += rng.normal(0, 0.004, np.count_nonzero(depth)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.1] = 0
    cells = np.empty((15 * 20, kernel.CELL_COLUMNS))
    kernel.fit_cells(depth, CAMERA, 8, 5.0, cells)
    for place in np.flatnonzero(cells[:, kernel.AREA] > 0)[::7]:
        r, c = divmod(int(place), 20)
        v, u = np.mgrid[8 * r : 8 * r + 8, 8 * c : 8 * c + 8]
        z = depth[8 * r : 8 * r + 8, 8 * c : 8 * c + 8]
        ok = z > 0
        design = np.column_stack([u[ok], v[ok], np.ones(ok.sum())]).astype(float)
        (a, b, w), residual, *_ = np.linalg.lstsq(design, 1.0 / z[ok].astype(float), rcond=None)
        normal = -np.array([a * CAMERA[0], b * CAMERA[1], a * CAMERA[2] + b * CAMERA[3] + w])
        normal /= np.linalg.norm(normal)
        np.testing.assert_allclose(cells[place, :3], normal, atol=1e-6)
        np.testing.assert_allclose(cells[place, kernel.RMS], np.sqrt(residual[0] / ok.sum()), rtol=1e-6)


def test_no_plane_where_most_is_missing_or_grazed() -> None:
    depth = depth_of_plane(np.array([0, 0, -1.0]), 2.0)
    depth[:, ::2] = 0
    cells = np.empty((15 * 20, kernel.CELL_COLUMNS))
    kernel.fit_cells(depth, CAMERA, 8, 5.0, cells)
    assert (cells[:, kernel.AREA] == 0).all()
