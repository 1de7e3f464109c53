"""Boxes that end at the faces of things, not at the outer end of their noise."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.faces import to_faces
from cuboid.method.boxes.fit import fit_box
from cuboid.method.boxes.kernels.extents import side_layers

UP = np.array([0.0, 0.0, 1.0])
SIZE = np.array([0.2, 0.14, 0.1])


def faces(seen: str, noise_m: float) -> np.ndarray:
    """Points of a carton's faces: of its front and its right, and of its top."""
    rng = np.random.default_rng(4)
    u = rng.uniform(-0.5, 0.5, (6000, 3)) * SIZE
    u[:, 2] += SIZE[2] / 2
    front, right, top = u[:2000].copy(), u[2000:4000].copy(), u[4000:].copy()
    front[:, 1], right[:, 0], top[:, 2] = -SIZE[1] / 2, SIZE[0] / 2, SIZE[2]
    chosen = {"f": front, "r": right, "t": top}
    cloud = np.concatenate([chosen[k] for k in seen])
    return np.asarray(cloud + rng.normal(0, noise_m, cloud.shape))


@settings(deadline=None, max_examples=20)
@given(st.floats(0.001, 0.006))
def test_noise_makes_no_carton_larger(noise_m: float) -> None:
    cloud = faces("frt", noise_m)
    trust = np.ones(len(cloud))
    seen = fit_box(cloud, UP, 0.0, 0.008, trust)
    box = to_faces(seen, cloud, trust, noise_m, top_alone=False)
    assert seen.size[2] > SIZE[2] + noise_m
    np.testing.assert_allclose(box.size, SIZE, atol=noise_m + 0.003)
    np.testing.assert_allclose(box.center, [0, 0, SIZE[2] / 2], atol=noise_m + 0.001)


def test_a_side_that_was_not_seen_stays_where_the_top_ends() -> None:
    cloud = faces("t", 0.0)
    trust = np.ones(len(cloud))
    seen = fit_box(cloud, UP, 0.0, 0.0, trust)
    box = to_faces(seen, cloud, trust, 0.003, top_alone=False)
    np.testing.assert_allclose(box.size[:2], seen.size[:2], atol=0.0015)


def test_of_a_round_body_only_the_top_is_moved() -> None:
    cloud = faces("frt", 0.004)
    trust = np.ones(len(cloud))
    seen = fit_box(cloud, UP, 0.0, 0.008, trust)
    box = to_faces(seen, cloud, trust, 0.004, top_alone=True)
    np.testing.assert_array_equal(box.size[:2], seen.size[:2])
    assert box.size[2] < seen.size[2] - 0.004


def test_layers_are_weighed_as_plain_sums_say() -> None:
    rng = np.random.default_rng(0)
    points, weights = rng.normal(0, 0.1, (500, 3)), rng.uniform(0, 1, 500)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    box = Box(np.array([0.01, 0.02, -0.03]), np.array([0.3, 0.2, 0.25]), turn)
    out = np.empty((5, 3))
    side_layers(points, weights, box.center, np.ascontiguousarray(turn), box.size / 2, 0.05, out)
    local = (points - box.center) @ turn
    for k, (axis, sign) in enumerate([(0, 1), (0, -1), (1, 1), (1, -1), (2, 1)]):
        depth = box.size[axis] / 2 - sign * local[:, axis]
        first, second = depth < 0.05, (depth >= 0.05) & (depth < 0.1)
        expected = [weights[first].sum(), (weights * np.maximum(depth, 0))[first].sum(), weights[second].sum()]
        np.testing.assert_allclose(out[k], expected, rtol=1e-12)
