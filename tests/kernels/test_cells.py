from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cuboid.ground.core.kernels import cells as kernel
from cuboid.ground.core.tolerances import MIN_SIGMA_M

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


# A camera that looks ten degrees down: up in the camera frame.
UP = np.array([0.0, -np.cos(np.radians(10)), -np.sin(np.radians(10))])


def board_from_afar(rng: np.random.Generator, noise: float, missing: float) -> np.ndarray:
    """A board 80 cm deep, 45 cm below the camera and 2.6 m away, before an upright wall; the rest is empty."""
    level, upright = depth_of_plane(UP, 0.45), depth_of_plane(np.cross([1.0, 0, 0], UP), 3.4)
    v, u = np.mgrid[:120, :160]
    out = np.stack([(u - CAMERA[2]) / CAMERA[0], (v - CAMERA[3]) / CAMERA[1], np.ones_like(u, float)], -1)
    far = level * (out @ -np.cross([1.0, 0, 0], UP))
    depth = np.where((far > 2.6) & (far < 3.4), level, np.where(v < 62, upright, 0)).astype(np.float32)
    seen = depth > 0
    depth[seen] += rng.normal(0, 1, seen.sum()).astype(np.float32) * noise * depth[seen] ** 2
    depth[rng.random(depth.shape) < missing] = 0
    return depth


def level_patches(depth: np.ndarray, noise: float, skip: np.ndarray | None = None) -> np.ndarray:
    skip = np.zeros((30, 40), np.uint8) if skip is None else skip
    out = np.empty((30 * 40, 5))
    return out[: kernel.level_patches(depth, CAMERA, UP, 4, noise, 1.0, 4.0, skip, out)]


def test_a_board_too_narrow_for_any_flat_cell_is_found_level_and_the_wall_behind_is_not() -> None:
    depth = board_from_afar(np.random.default_rng(3), 1.4e-3, 0.3)
    cells = np.empty((15 * 20, kernel.CELL_COLUMNS))
    kernel.fit_cells(depth, CAMERA, 8, 4.0, cells)
    assert not ((cells[:, kernel.AREA] > 0) & (cells[:, :3] @ UP > 0.98)).any()
    found = level_patches(depth, 1.4e-3)
    assert len(found) > 20
    np.testing.assert_allclose(found[:, :3] @ UP, -0.45, atol=0.01)
    # 80 cm by the 3.2 to 4.2 m that are in view, but for its near and far edge and for what is missing.
    assert 0.7 < found[:, 3].sum() < 3.4


def test_patches_that_are_skipped_are_not_found() -> None:
    depth = board_from_afar(np.random.default_rng(3), 1.4e-3, 0.0)
    found = level_patches(depth, 1.4e-3)
    skip = np.zeros((30, 40), np.uint8)
    skip.ravel()[found[:, 4].astype(int)] = 1
    assert len(level_patches(depth, 1.4e-3, skip)) == 0


def test_level_patches_are_those_of_a_plain_count() -> None:
    noise = 1.4e-3
    depth = board_from_afar(np.random.default_rng(5), noise, 0.2)
    expected = {}
    for place in range(30 * 40):
        r, c = divmod(place, 40)
        ray = np.array([((c + 0.5) * 4 - CAMERA[2]) / CAMERA[0], ((r + 0.5) * 4 - CAMERA[3]) / CAMERA[1], 1.0])
        steep = -UP @ ray
        if steep < kernel.LOWEST * np.linalg.norm(ray):
            continue
        climb = CAMERA[:2] * (UP[:2] - ray[:2] * UP[2])
        longest = np.abs(climb).max()
        level, known = [], 0
        for v, u in ((r * 4 + i, c * 4 + j) for i in range(4) for j in range(4)):
            z = float(depth[v, u])
            if not 1.0 <= z <= 4.0:
                continue
            gate = 3 * 1.42 * noise * z * z * steep + MIN_SIGMA_M
            first = int(np.ceil(2 * gate * longest / z))
            if first > 2 * 4:
                continue
            beyond = [np.rint([v, u] + k * climb[::-1] / longest).astype(int) for k in range(first, first + 4)]
            beyond = [p for p in beyond if 0 <= p[0] < 120 and 0 <= p[1] < 160 and depth[tuple(p)] > 0]
            if not beyond or depth[tuple(beyond[0])] > 4.0:
                continue
            known += 1
            points = [
                depth[y, x] * np.array([(x - CAMERA[2]) / CAMERA[0], (y - CAMERA[3]) / CAMERA[1], 1.0])
                for y, x in ((v, u), beyond[0])
            ]
            if abs(points[1] @ UP - points[0] @ UP) <= gate:
                level.append(points[0])
        if len(level) >= kernel.MIN_LEVEL and len(level) >= kernel.FILLED * known:
            expected[place] = np.mean(level, axis=0)
    found = level_patches(depth, noise)
    assert found[:, 4].astype(int).tolist() == sorted(expected)
    np.testing.assert_allclose(found[:, :3], [expected[int(p)] for p in found[:, 4]], atol=1e-5)
