from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from features import FEATURES, Surface, make_surface

EYE = np.array([0.0, 0.2, 0.0])


def bumpy(seed: int, noise_m: float = 0.0) -> np.ndarray:
    """A curved sheet of 20 x 20 cm, 1 m ahead."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:40, :40] * 0.005 - 0.1
    waves = rng.uniform(20, 45, (2, 2))
    z = 1 + 0.02 * np.sin(u * waves[0, 0]) * np.cos(v * waves[0, 1]) + 0.015 * np.cos(v * waves[1, 0] + u * waves[1, 1])
    points = np.stack([u, v, z], -1).reshape(-1, 3)
    return points + rng.normal(0, 1, points.shape) * noise_m


def surface(points: np.ndarray, eye: np.ndarray = EYE) -> Surface:
    v, u = np.mgrid[:40, :40]
    return make_surface(points, (v * 320 + u).ravel(), 320, eye)


@pytest.mark.parametrize("name", FEATURES)
def test_a_feature_does_not_change_with_the_pose(name: str) -> None:
    dimensions, compute = FEATURES[name]
    turn = Rotation.from_rotvec([0.5, -1.1, 0.7]).as_matrix()
    shift = np.array([0.3, 2.0, -1.0])
    here = compute(surface(bumpy(1)))
    there = compute(surface(bumpy(1) @ turn.T + shift, turn @ EYE + shift))
    assert here.shape[1] == dimensions
    off = np.linalg.norm(there - here, axis=1) / np.linalg.norm(here, axis=1)
    assert (off < 0.01).mean() > 0.9  # rounding may take a point of the regular grid over the edge of a bin


@pytest.mark.parametrize("name", FEATURES)
def test_a_feature_is_nearer_to_its_own_place_than_to_others(name: str) -> None:
    _, compute = FEATURES[name]
    clean, noisy = compute(surface(bumpy(1))), compute(surface(bumpy(1, noise_m=0.0005)))
    distance = np.linalg.norm(clean[:, None] - noisy[None], axis=2)
    assert (distance.argmin(0) == np.arange(len(clean))).mean() > 0.6


def test_normals_look_at_the_camera_and_triangles_at_neighbours() -> None:
    sheet = surface(bumpy(2))
    assert (((EYE - sheet.points) * sheet.normals).sum(1) > 0).all()
    sides = sheet.points[sheet.triangles] - sheet.points[np.roll(sheet.triangles, 1, axis=1)]
    assert len(sheet.triangles) > 1.5 * len(sheet.points)
    assert np.linalg.norm(sides, axis=2).max() < 0.03
