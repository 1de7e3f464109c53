from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from cuboid.lab.synthetic.mesh import box, corner_normals, lathe, sample_surface
from cuboid.lab.synthetic.raycast import RayCaster
from cuboid.lab.synthetic.shapes import CATALOGUE, MAKERS, Model


@cache
def model(name: str, seed: int) -> Model:
    return CATALOGUE[name](np.random.default_rng(seed))


# Longest side of things that have about the same size everywhere, metres.
LONGEST_M = {"monitor": (0.45, 0.65), "keyboard": (0.34, 0.47), "laptop": (0.27, 0.38), "mouse": (0.09, 0.13)}
LONGEST_M |= {"smartphone": (0.13, 0.17), "banana": (0.12, 0.2), "apple": (0.06, 0.1), "plate": (0.15, 0.28)}
LONGEST_M |= {"fork": (0.17, 0.23), "knife": (0.17, 0.28), "spoon": (0.14, 0.22), "scissors": (0.15, 0.25)}
LONGEST_M |= {"shoe": (0.24, 0.32), "backpack": (0.34, 0.5), "bear": (0.15, 0.3), "kettle": (0.19, 0.28)}


@pytest.mark.parametrize("name", CATALOGUE)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_thing_stands_on_zero_and_has_the_size_of_its_kind(name, seed):
    mesh = model(name, seed).mesh()
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    least, most = LONGEST_M.get(name, (0.035, 0.35 if name in MAKERS else 0.5))
    assert abs(low[2]) < 1e-9
    assert (high - low).min() > (0.03 if name in MAKERS else 0.008)
    assert least <= (high - low).max() <= most
    np.testing.assert_allclose(np.linalg.norm(corner_normals(mesh), axis=2), 1, rtol=1e-9)
    assert (np.linalg.norm(mesh.area_normals(), axis=1) > 0).all()


@pytest.mark.parametrize("name", CATALOGUE)
def test_rays_from_outside_meet_outsides(name):
    """A hole in a surface shows the inner side of the opposite one: such rays are at most 1 in 200."""
    mesh = model(name, 1).mesh()
    caster, normals = RayCaster(mesh.corners()), mesh.area_normals()
    middle, reach = mesh.vertices.mean(0), np.linalg.norm(np.ptp(mesh.vertices, axis=0)) / 2
    wrong = hit = 0
    for bearing, rise in ((0.3, 0.2), (1.8, 0.5), (3.2, 0.9), (4.9, 1.3)):
        away = np.array([np.cos(bearing) * np.cos(rise), np.sin(bearing) * np.cos(rise), np.sin(rise)])
        eye = (middle + 5 * reach * away).astype(np.float32)
        targets = middle + np.random.default_rng(0).uniform(-reach, reach, (60, 60, 3))
        rays = (targets - eye).astype(np.float32)
        face = caster.first_hits(eye, rays).face
        hit += int((face >= 0).sum())
        wrong += int((np.einsum("ijk,ijk->ij", normals[face], rays) >= 0)[face >= 0].sum())
    assert hit > 300
    assert wrong <= hit / 200


# Things of standard sizes, and of how many.
STANDARD_SIZES = {"can": 3, "letter_trays": 1}


def test_models_of_a_name_differ():
    for name in CATALOGUE:
        models = [model(name, k) for k in range(4)]
        assert len({repr([(part.vertices.tobytes(), look) for part, look in one.parts]) for one in models}) >= 3, name
        # A lamp with an arm has one size, one with a stem any: two of the four have a stem.
        least = 2 if name == "table_lamp" else 3
        assert name in STANDARD_SIZES or len({size(one) for one in models}) >= least, name


@pytest.mark.parametrize("name", STANDARD_SIZES)
def test_things_of_standard_sizes_have_all_of_them(name):
    assert len({size(model(name, k)) for k in range(24)}) == STANDARD_SIZES[name]


def size(model):
    return tuple(np.round(np.ptp(model.mesh().vertices, axis=0), 4))


@pytest.mark.parametrize("name", CATALOGUE)
def test_faces_look_outward(name):
    """The enclosed volume is positive: its sum over faces changes sign where a part is inside out."""
    for mesh, _ in model(name, 2).parts:
        a, b, c = np.moveaxis(mesh.corners() - mesh.vertices.mean(axis=0), 1, 0)
        assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() > 0


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
