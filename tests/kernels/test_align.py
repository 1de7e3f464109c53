from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cuboid.ground.geometry import se3
from cuboid.method.poses.kernels import align

CAMERA = np.array([60.0, 62.0, 31.0, 23.0])
NOISE = np.array([0.001, 1.4e-3])
GATE = np.array([0.1, 6.0])
SIGMA = np.array([5.0, 1.5])


def packed(seed: int, tilt: float = 0.3) -> NDArray[np.float32]:
    """A smooth picture of a tilted plane."""
    v, u = np.mgrid[:48, :64]
    rng = np.random.default_rng(seed)
    gray = 120 + 50 * np.sin(u / 4.0 + rng.uniform()) + 40 * np.cos(v / 5.0 + u / 9.0)
    # z = 1.5 + tilt x on the plane
    depth = 1.5 / (1 - tilt * (u - CAMERA[2]) / CAMERA[0])
    out = np.empty((48, 64, 4), np.float32)
    align.pack(np.rint(gray).astype(np.uint8), depth.astype(np.float32), out)
    return out


def picked(image: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    points, normals = np.empty((400, 3), np.float32), np.empty((400, 3), np.float32)
    intensity = np.empty(400, np.float32)
    n = align.pick_points(image, CAMERA, 3, 2, 6.0, NOISE[1], points, normals, intensity)
    return points[:n], normals[:n], intensity[:n]


def summed(points, normals, intensity, image, T, shade):
    system, sums = np.empty((7, 6)), np.empty(align.SUMS)
    shades = np.empty((len(shade), align.GROUP_SUMS))
    group = (np.arange(len(points)) % len(shade)).astype(np.int32)
    picked = points, normals, intensity, group, shade
    align.accumulate(*picked, image, CAMERA, np.ascontiguousarray(T), SIGMA, NOISE, GATE, system, sums, shades)
    return system, sums, shades, group


def residuals(points, normals, intensity, image, T, shade, group):
    """What `accumulate` sums, point by point: weighted residual vectors before weighting, (N, 2), NaN where none."""
    q = points.astype(float) @ T[:3, :3].T + T[:3, 3]
    n = normals.astype(float) @ T[:3, :3].T
    u, v = CAMERA[0] * q[:, 0] / q[:, 2] + CAMERA[2], CAMERA[1] * q[:, 1] / q[:, 2] + CAMERA[3]
    h, w = image.shape[:2]
    inside = (u >= 1) & (u < w - 2) & (v >= 1) & (v < h - 2) & ((n * q).sum(1) <= 0)
    out = np.full((len(q), 2), np.nan)
    for k in np.flatnonzero(inside):
        u1, v1 = int(u[k] + 0.5), int(v[k] + 0.5)
        d = float(image[v1, u1, 3])
        deviation = NOISE[0] + NOISE[1] * q[k, 2] ** 2
        if d > 0:
            if abs(d - q[k, 2]) > GATE[0] + GATE[1] * deviation:
                continue
            seen = np.array([(u1 - CAMERA[2]) / CAMERA[0] * d, (v1 - CAMERA[3]) / CAMERA[1] * d, d])
            out[k, 1] = n[k] @ (seen - q[k]) / deviation / SIGMA[1]
        u0, v0 = int(u[k]), int(v[k])
        a, b = u[k] - u0, v[k] - v0
        block = image[v0 : v0 + 2, u0 : u0 + 2, 0].astype(float)
        here = np.array([1 - b, b]) @ block @ np.array([1 - a, a])
        out[k, 0] = (intensity[k] - shade[group[k], 0] * here - shade[group[k], 1]) / SIGMA[0]
    return out


def test_points_of_a_plane_lie_on_it_and_know_its_normal() -> None:
    points, normals, intensity = picked(packed(0))
    assert len(points) > 150
    np.testing.assert_allclose(points[:, 2], 1.5 + 0.3 * points[:, 0], atol=1e-4)
    expected = np.array([0.3, 0.0, -1.0]) / np.hypot(0.3, 1.0)
    np.testing.assert_allclose(normals, np.tile(expected, (len(normals), 1)), atol=1e-3)
    assert intensity.min() >= 0
    assert np.ptp(intensity) > 50


def test_no_point_is_picked_where_depth_is_missing_or_jumps() -> None:
    image = packed(0)
    image[:, :20, 3] = 0.0
    image[:, 40:, 3] += 1.0
    points, _, _ = picked(image)
    u = points[:, 0] / points[:, 2] * CAMERA[0] + CAMERA[2]
    assert len(points) > 50
    assert u.min() > 19.5
    # a point beside the jump lies on one of the two surfaces, never between
    away = points[:, 2] - (1.5 + 0.3 * points[:, 0])
    behind = away > 0.5
    assert np.abs(away[~behind]).max() < 1e-3
    np.testing.assert_array_equal(behind, u > 39.5)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_sums_are_those_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, normals, intensity = picked(packed(seed))
    image = packed(seed + 10)
    T = se3.exp(rng.normal(size=6) * 0.02)
    shade = np.array([[1.1, -3.0], [0.9, 5.0]])
    system, sums, shades, group = summed(points, normals, intensity, image, T, shade)
    r = residuals(points, normals, intensity, image, T, shade, group)
    weight = (align.FREEDOM + 1) / (align.FREEDOM + r**2)
    squares = np.nansum(weight * r**2, 0)
    np.testing.assert_allclose(sums[[align.SQUARES_I, align.SQUARES_D]], squares, rtol=1e-3)
    assert sums[align.INLIERS] == np.isfinite(r[:, 1]).sum()
    assert sums[align.SHADED] == np.isfinite(r[:, 0]).sum()
    weight_i = weight[:, 0]
    for g in range(2):
        mine = (group == g) & np.isfinite(r[:, 0])
        np.testing.assert_allclose(shades[g, :2], [weight_i[mine].sum(), (weight_i * intensity)[mine].sum()], rtol=1e-3)
    np.testing.assert_allclose(system[:6], system[:6].T)


@pytest.mark.parametrize("part", ["depth", "intensity"])
def test_the_gradient_is_the_numeric_derivative_of_the_cost(part: str) -> None:
    """The gradient of sum w r^2 / 2 with the weights held; each kind of residual alone."""
    # a parabola: central differences and linear interpolation of its packed derivative are exact enough
    v, u = np.mgrid[:48, :64]
    image = packed(3)
    image[..., 0] = 0.03 * (u - 30.0) ** 2 + 0.02 * (v - 20.0) ** 2 + 0.5 * u
    image[1:-1, 1:-1, 1] = 0.5 * (image[1:-1, 2:, 0] - image[1:-1, :-2, 0])
    image[1:-1, 1:-1, 2] = 0.5 * (image[2:, 1:-1, 0] - image[:-2, 1:-1, 0])
    points, normals, intensity = picked(packed(4))
    shade = np.array([[1.0, 0.0]])
    T = se3.exp([0.004, -0.003, 0.005, 0.002, -0.004, 0.003])
    if part == "intensity":
        image[..., 3] = 0.0
    else:
        image[..., :3] = 0.0
    gradient = summed(points, normals, intensity, image, T, shade)[0][6]
    group = np.zeros(len(points), int)
    column = 1 if part == "depth" else 0
    at = residuals(points, normals, intensity, image, T, shade, group)[:, column]
    weight = (align.FREEDOM + 1) / (align.FREEDOM + at**2)
    numeric = np.empty(6)
    step = 1e-6
    for k in range(6):
        motion = np.zeros(6)
        motion[k] = step
        after, before = (
            residuals(points, normals, intensity, image, se3.exp(sign * motion) @ T, shade, group)[:, column]
            for sign in (1, -1)
        )
        numeric[k] = -np.nansum(weight * at * (after - before)) / (2 * step)
    np.testing.assert_allclose(gradient, numeric, rtol=0.03, atol=0.01 * np.abs(numeric).max())
