from __future__ import annotations

import numpy as np
import pytest

from cuboid.lab.synthetic.mesh import box, corner_normals, lathe, sample_surface
from cuboid.lab.synthetic.shapes import MAKERS


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_model_is_a_household_thing_that_stands_on_zero(name, seed):
    mesh = MAKERS[name](np.random.default_rng(seed)).mesh()
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    assert abs(low[2]) < 1e-9
    assert (high - low).min() > 0.03
    assert (high - low).max() < 0.35
    assert (np.linalg.norm(mesh.area_normals(), axis=1) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(corner_normals(mesh), axis=2), 1, rtol=1e-9)


@pytest.mark.parametrize("name", MAKERS)
def test_faces_look_outward(name):
    """The enclosed volume is positive: its sum over faces changes sign where a part is inside out."""
    for mesh, _ in MAKERS[name](np.random.default_rng(3)).parts:
        a, b, c = np.moveaxis(mesh.corners() - mesh.vertices.mean(axis=0), 1, 0)
        assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() > 0


def test_same_seed_same_model():
    for make in MAKERS.values():
        first, second = (make(np.random.default_rng(7)).mesh().vertices for _ in range(2))
        np.testing.assert_array_equal(first, second)


def test_a_box_has_flat_sides_and_a_lathe_a_round_one():
    for normal in corner_normals(box((1, 2, 3))).reshape(-1, 3):
        assert sorted(np.abs(np.round(normal, 9))) == [0, 0, 1]
    wall = lathe([(1, 0), (1, 2)], 48)
    across = wall.corners()[..., :2]
    np.testing.assert_allclose(corner_normals(wall)[..., :2], across, atol=0.03)


def test_samples_spread_over_the_surface_by_area():
    points, normals = sample_surface(box((1, 1, 3)), 4000, np.random.default_rng(0))
    top = normals[:, 2] > 0.5
    assert abs(top.mean() - 1 / 14) < 0.005
    np.testing.assert_allclose(points[top, 2], 3)
    assert abs(points[top, 0].mean()) < 0.05
