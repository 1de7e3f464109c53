"""Tops seen from above: the box ends at their edges, not at the outermost means of voxels."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.edges import to_edges, to_top
from cuboid.method.boxes.fit import fit_box

UP, VOXEL_M = np.array([0.0, 0.0, 1.0]), 0.01


def voxels(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and number of the points (N, 3) in each voxel."""
    keys, index, counts = np.unique(np.floor(points / VOXEL_M), axis=0, return_inverse=True, return_counts=True)
    sums = np.zeros((len(keys), 3))
    np.add.at(sums, index.ravel(), points)
    return sums / counts[:, None], counts.astype(np.float64)


def top(angle: float, inside: str, size: tuple[float, float], height: float = 0.1) -> np.ndarray:
    rng = np.random.default_rng(7)
    plan = rng.uniform(-0.5, 0.5, (60_000, 2))
    if inside == "disc":
        plan = plan[np.hypot(*plan.T) < 0.5]
    plan = plan * size
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([plan @ np.array([[c, s], [-s, c]]) + (0.313, 0.207), np.full(len(plan), height)])


def standing(height: float, size: tuple[float, float], angle: float) -> Box:
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Box(np.array([0.313, 0.207, height / 2.0]), np.array([*size, height]), rotation)


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("size", [(0.12, 0.05), (0.3, 0.21)])
def test_a_flat_top_gets_its_length_and_width(angle: float, size: tuple[float, float]) -> None:
    points, readings = voxels(top(angle, "rectangle", size))
    fitted = fit_box(points, UP, 0.0, 0.008, readings)
    box = to_edges(fitted, points, readings, VOXEL_M)
    assert np.abs(fitted.size[:2] - size).max() > 0.0025  # means of voxels lie before the edge
    np.testing.assert_allclose(box.size[:2], size, atol=0.0015)
    np.testing.assert_allclose(box.center[:2], (0.313, 0.207), atol=0.001)
    assert box.size[2] == fitted.size[2]


@pytest.mark.parametrize("diameter", [0.07, 0.15])
def test_a_round_top_gets_its_diameter(diameter: float) -> None:
    points, readings = voxels(top(0.0, "disc", (diameter, diameter)))
    box = to_edges(fit_box(points, UP, 0.0, 0.008, readings), points, readings, VOXEL_M)
    np.testing.assert_allclose(box.size[:2], diameter, atol=0.0015)


def test_a_seen_face_and_a_small_top_are_not_moved() -> None:
    points, readings = voxels(top(0.0, "rectangle", (0.2, 0.1)))
    rng = np.random.default_rng(3)
    front = np.column_stack([rng.uniform(0.213, 0.413, 20_000), np.full(20_000, 0.157), rng.uniform(0, 0.1, 20_000)])
    more, counts = voxels(front)
    points, readings = np.concatenate([points, more]), np.concatenate([readings, counts])
    fitted = fit_box(points, UP, 0.0, 0.0, readings)
    box = to_edges(fitted, points, readings, VOXEL_M)
    low, moved = ((one.center - one.rotation[:, 1] * one.size[1] / 2.0)[1] for one in (fitted, box))
    assert moved == pytest.approx(low, abs=1e-9)
    small = Box(np.array([0.0, 0.0, 0.01]), np.full(3, 0.02), np.eye(3))
    few, weight = voxels(rng.uniform(-0.01, 0.01, (200, 3)) + np.array([0.0, 0.0, 0.01]))
    assert to_edges(small, few, weight, VOXEL_M) is small


def test_a_thick_flat_top_gets_its_height_and_a_dome_keeps_its_own() -> None:
    rng = np.random.default_rng(5)
    flat = top(0.4, "rectangle", (0.2, 0.12))
    flat[:, 2] += rng.normal(0.0, 0.005, len(flat))
    points, readings = voxels(flat)
    box = to_top(standing(0.113, (0.2, 0.12), 0.4), points, readings, VOXEL_M, 0.001)
    assert box.size[2] == pytest.approx(0.1, abs=0.001)
    assert box.center[2] == pytest.approx(0.05, abs=0.001)
    dome = top(0.0, "disc", (0.2, 0.2))
    dome[:, 2] += 0.05 - 5.0 * ((dome[:, :2] - (0.313, 0.207)) ** 2).sum(1)
    points, readings = voxels(dome)
    around = standing(0.15, (0.2, 0.2), 0.0)
    assert to_top(around, points, readings, VOXEL_M, 0.001) is around


def test_a_bowl_keeps_its_rim() -> None:
    inside, wall = top(0.0, "disc", (0.18, 0.18), 0.07), top(0.0, "disc", (0.2, 0.2), 0.1)
    wall = wall[np.hypot(*(wall[:, :2] - (0.313, 0.207)).T) > 0.09]
    points, readings = voxels(np.concatenate([inside, wall]))
    around = standing(0.1, (0.2, 0.2), 0.0)
    assert to_top(around, points, readings, VOXEL_M, 0.001) is around
