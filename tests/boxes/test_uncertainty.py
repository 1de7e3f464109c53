"""How sure the measures of a box are: by the sides that were seen, the noise, and the number of views."""

from __future__ import annotations

import numpy as np

from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.uncertainty import UNSEEN_FRACTION, Uncertainty, uncertainty_of

BOX = Box(np.array([0.0, 0.0, 0.05]), np.array([0.2, 0.14, 0.1]), np.eye(3))
DOWN, SLANTED = np.array([[0.0, 0.0, -1.0]]), np.array([[-0.6, 0.0, -0.8]])
VOXEL_M = 0.01


def grid(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> np.ndarray:
    sides = [np.arange(low, high + 1e-9, VOXEL_M / 2.0) for low, high in (x, y, z)]
    return np.stack(np.meshgrid(*sides), -1).reshape(-1, 3)


TOP = grid((-0.1, 0.1), (-0.07, 0.07), (0.1, 0.1))
END = grid((0.1, 0.1), (-0.07, 0.07), (0.0, 0.1))


def sure(points: np.ndarray, directions: np.ndarray, noise_m: float = 0.001, rests: bool = True) -> Uncertainty:
    return uncertainty_of(BOX, points, directions, noise_m, 0.8, VOXEL_M, rests=rests)


def test_from_above_only_the_top_is_seen_and_all_measures_are_known() -> None:
    found = sure(TOP, DOWN)
    assert found.sides_seen == ("+z",)
    assert found.size_sigma_m.min() > 0.0005
    assert found.size_sigma_m.max() < 0.004
    assert (found.center_sigma_m < found.size_sigma_m).all()


def test_a_seen_end_is_listed() -> None:
    assert sure(np.concatenate([TOP, END]), SLANTED).sides_seen == ("+x", "+z")
    # the same points without a camera on that side: no camera saw the face
    assert sure(np.concatenate([TOP, END]), DOWN).sides_seen == ("+z",)


def test_a_side_without_points_is_wide_and_not_listed() -> None:
    half = TOP[TOP[:, 0] > -0.05]
    found = sure(half, DOWN)
    assert found.size_sigma_m[0] > UNSEEN_FRACTION * 0.2
    assert found.size_sigma_m[1] < 0.004
    assert found.center_sigma_m[0] > 0.02


def test_an_unknown_support_makes_the_height_wide() -> None:
    assert sure(TOP, DOWN, rests=False).size_sigma_m[2] > 5.0 * sure(TOP, DOWN).size_sigma_m[2]


def test_noise_widens_and_views_narrow() -> None:
    points = np.concatenate([TOP, END])
    assert sure(points, SLANTED, 0.008).size_sigma_m[0] > 1.2 * sure(points, SLANTED).size_sigma_m[0]
    more = np.array([[-0.6, 0.3, -0.74], [-0.6, -0.3, -0.74], [-0.8, 0.0, -0.6], *SLANTED])
    assert sure(points, more, 0.008).size_sigma_m[2] < sure(points, SLANTED, 0.008).size_sigma_m[2]
