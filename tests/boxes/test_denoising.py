"""What noise has spread along the rays lies where it was seen on average."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou
from cuboid.method.boxes.denoising import denoised
from cuboid.method.boxes.fit import fit_box
from cuboid.method.boxes.kernels.shifts import shift_means
from cuboid.method.boxes.revolved import revolved

UP = np.array([0.0, 0.0, 1.0])
VOXEL_M = 0.01
EYE = np.array([0.0, -3.0, 0.055])
RADIUS_M, HEIGHT_M = 0.06, 0.11
JAR = Box(np.array([0.0, 0.0, HEIGHT_M / 2]), np.array([2 * RADIUS_M, 2 * RADIUS_M, HEIGHT_M]), np.eye(3))


def jar(noise_m: float, seed: int = 0) -> np.ndarray:
    """The near half of a jar's side, as the map holds it: noise along the rays, and a voxel for each reading."""
    rng = np.random.default_rng(seed)
    n = 3000
    across, height = rng.uniform(-RADIUS_M, RADIUS_M, n), rng.uniform(0.0, HEIGHT_M, n)
    near = -np.sqrt(RADIUS_M**2 - across**2)
    points = np.column_stack([across, near + rng.normal(0.0, noise_m, n), height])
    return np.asarray(np.unique(np.floor(points / VOXEL_M), axis=0) * VOXEL_M + VOXEL_M / 2)


def jar_box(points: np.ndarray, noise_m: float) -> Box:
    trust = np.ones(len(points))
    box = fit_box(points, UP, 0.0, 0.008, trust)
    return revolved(box, points, trust, (UP, 0.0), noise_m, VOXEL_M, 0.008) or box


@pytest.mark.parametrize("seed", range(4))
def test_a_jar_at_three_metres_has_its_own_box(seed: int) -> None:
    seen = jar(0.013, seed)
    clean, noise_m = denoised(seen, np.ones(len(seen)), EYE, 0.013, VOXEL_M)
    off_m = [np.abs(np.hypot(p[:, 0], p[:, 1]) - RADIUS_M).mean() for p in (seen, clean)]
    assert off_m[1] < 0.5 * off_m[0]
    assert noise_m < 0.6 * 0.013
    assert iou(jar_box(clean, noise_m), JAR) > max(0.8, iou(jar_box(seen, 0.013), JAR) + 0.15)


def test_three_points_on_a_ray_lie_in_their_mean() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.04, 0.0], [0.2, 0.02, 0.0]])
    eye = points.mean(0) - [0.0, 2.0, 0.0]
    even, noise_m = denoised(points, np.ones(4), eye, 0.02, VOXEL_M)
    np.testing.assert_allclose(even[:, 1], [0.05 / 3, 0.05 / 3, 0.05 / 3, 0.02])
    assert noise_m == 0.02 / np.sqrt(3)
    trusted, _ = denoised(points, np.array([2.0, 1.0, 1.0, 1.0]), eye, 0.02, VOXEL_M)
    np.testing.assert_allclose(trusted[:3, 1], 0.05 / 4)


def test_two_surfaces_on_a_ray_stay_two() -> None:
    near = np.array([[0.0, y, 0.0] for y in (0.0, 0.01, 0.02)])
    points = np.concatenate([near, near + np.array([0.0, 0.2, 0.0])])
    clean, _ = denoised(points, np.ones(6), points.mean(0) - [0.0, 2.0, 0.0], 0.015, VOXEL_M)
    np.testing.assert_allclose(clean[:, 1], [0.01] * 3 + [0.21] * 3)


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 60), st.floats(0.005, 0.04), st.integers(0, 1000))
def test_nothing_moves_but_along_the_ray_and_within_what_was_there(n: int, noise_m: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, trust = rng.uniform(-0.2, 0.2, (n, 3)), rng.uniform(0.0, 2.0, n)
    eye = rng.uniform(1.0, 3.0, 3)
    clean, left_m = denoised(points, trust, eye, noise_m, VOXEL_M)
    ray = (points.mean(0) - eye) / np.linalg.norm(points.mean(0) - eye)
    moved = clean - points
    np.testing.assert_allclose(moved, np.outer(moved @ ray, ray), atol=1e-9)
    assert (points @ ray).min() - 1e-9 <= (clean @ ray).min() <= (clean @ ray).max() <= (points @ ray).max() + 1e-9
    assert 0.0 < left_m <= noise_m


def test_what_is_near_is_as_it_was_seen() -> None:
    seen = jar(0.002)
    clean, noise_m = denoised(seen, np.ones(len(seen)), EYE, 0.002, VOXEL_M)
    assert clean is seen
    assert noise_m == 0.002


def test_what_nothing_is_believed_of_and_a_camera_within_it_are_no_fault() -> None:
    seen = jar(0.013)
    clean, noise_m = denoised(seen, np.zeros(len(seen)), EYE, 0.013, VOXEL_M)
    assert np.isfinite(clean).all()
    assert noise_m > 0.0
    assert denoised(seen, np.ones(len(seen)), seen.mean(0), 0.013, VOXEL_M)[0] is seen
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.078, 0.0], [0.3, 0.0, 0.0]])
    assert np.isfinite(denoised(ends, np.ones(3), EYE, 0.013, VOXEL_M)[0]).all()


def shifted(places: np.ndarray, weight: np.ndarray, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """What `kernels.shifts.shift_means` does, in NumPy."""
    mean, moved = places.copy(), np.inf
    while moved > 0.001:
        near = np.abs(places - mean[:, None]) <= reach_m
        before, mean = mean, (near * weight) @ places / (near @ weight)
        moved = np.abs(mean - before).max()
    return mean, near.sum(1)


@settings(deadline=None, max_examples=100)
@given(st.integers(1, 80), st.floats(0.01, 0.05), st.floats(0.05, 2.0), st.integers(0, 10000))
def test_places_go_where_numpy_says(n: int, reach_m: float, length_m: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    places, weight = np.sort(rng.uniform(0.0, length_m, n)), rng.uniform(0.1, 2.0, n)
    mean, near = np.empty(n), np.empty(n)
    shift_means(places, weight, reach_m, mean, near)
    expected, count = shifted(places, weight, reach_m)
    np.testing.assert_allclose(mean, expected, atol=1e-9)
    np.testing.assert_array_equal(near, count)
