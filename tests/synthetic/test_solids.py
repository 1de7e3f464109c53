from __future__ import annotations

import numpy as np
import pytest

from cuboid.lab.synthetic.mesh import box, lathe
from cuboid.lab.synthetic.solids import (
    blended,
    displaced,
    flattened,
    hollow,
    loft,
    pipe,
    ribbon,
    rounded_box,
    rounded_rectangle,
    sheet,
    superellipsoid,
    swept,
)


def volume(mesh) -> float:
    a, b, c = np.moveaxis(mesh.corners(), 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def is_closed(mesh) -> bool:
    """Tell whether each edge has a partner in the opposite direction."""
    _, vertex = np.unique(np.round(mesh.vertices, 7), axis=0, return_inverse=True)
    faces = vertex.reshape(-1)[mesh.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(1)]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist()
    return sorted(map(tuple, edges)) == sorted((b, a) for a, b in edges)


FLAT = np.stack([*np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 2, 5)), np.zeros((5, 4))], axis=-1)
SOLIDS = {
    "ball": (superellipsoid((0.1, 0.1, 0.1), 2.0, 80), 4 / 3 * np.pi * 1e-3),
    "pipe": (pipe([(0, 0, 0), (0.5, 0, 0), (1, 0, 0)], 0.1), np.pi * 0.01),
    "box": (rounded_box((0.3, 0.2, 0.1), 0.001, 0.0005), 0.3 * 0.2 * 0.1),
    "sheet": (sheet(FLAT, 0.1), 0.2),
    "ribbon": (ribbon([0, 1, 2], [0.2] * 3, [0.0] * 3, [0.1] * 3), 0.04),
    "blend": (blended([((0, 0, 0), (0.1, 0.1, 0.1))], 0.01, 0.01), 4 / 3 * np.pi * 1e-3),
    "loft": (loft([np.column_stack([rounded_rectangle(0.2, 0.1, 0.001), np.full(24, z)]) for z in (0, 1)]), 0.02),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_have_their_volume(name):
    mesh, expected = SOLIDS[name]
    # The ends of a sheet have vertices on its edges: it is closed, but not edge by edge.
    assert is_closed(mesh) or name == "sheet"
    assert volume(mesh) == pytest.approx(expected, rel=0.06)


def test_a_blend_joins_bodies_that_touch_and_has_a_smooth_neck():
    apart = blended([((-0.1, 0, 0), (0.1, 0.1, 0.1)), ((0.1, 0, 0), (0.1, 0.1, 0.1))], 0.02, 0.01)
    neck = np.abs(apart.vertices[:, 0]) < 0.006
    assert np.linalg.norm(apart.vertices[neck, 1:], axis=1).min() > 0.02


def test_a_vessel_is_hollow():
    profile = hollow([(0.1, 0), (0.1, 0.2)], 0.005, 0.01)
    for mesh in (lathe(profile), swept(rounded_rectangle(2, 2, 0.9), profile)):
        inside = np.linalg.norm(mesh.vertices[:, :2], axis=1) < 0.05
        assert mesh.vertices[inside, 2].max() == pytest.approx(0.01)
        assert is_closed(mesh)


def test_displaced_and_flattened_bodies_stay_closed():
    body = flattened(displaced(box((0.2, 0.2, 0.2)), np.random.default_rng(0), 0.01, 0.1), 0.02)
    assert is_closed(displaced(superellipsoid((0.1, 0.1, 0.1), 3.0), np.random.default_rng(0), 0.01, 0.1))
    assert body.vertices[:, 2].min() == pytest.approx(0.02)
