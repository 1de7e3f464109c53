from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cuboid.ground.geometry import se3
from cuboid.method.poses.graph import Edge, deviations, optimise, optimise_around, residuals

SURE = np.diag([1e6] * 3 + [1e6] * 3)


def ring(n: int = 12) -> list[np.ndarray]:
    """Poses once round a circle; the first is the identity."""
    step = se3.exp([0.3, 0.0, 0.05, 0.0, 2 * np.pi / n, 0.0])
    poses = [np.eye(4)]
    for _ in range(n - 1):
        poses.append(se3.tidied(poses[-1] @ step))
    return poses


def edge(poses: list[np.ndarray], a: int, b: int, off: np.ndarray | None = None) -> Edge:
    T = se3.inverse(poses[a]) @ poses[b]
    return Edge(a, b, T if off is None else T @ se3.exp(off), SURE)


def distance(found: list[np.ndarray], true: list[np.ndarray]) -> float:
    return max(float(np.abs(a - b).max()) for a, b in zip(found, true, strict=True))


def test_drifted_poses_return_to_the_known_solution() -> None:
    true = ring()
    edges = [edge(true, k, (k + 1) % 12) for k in range(12)] + [edge(true, 0, 4), edge(true, 3, 9)]
    drifted = [T @ se3.exp(np.array([0.01, -0.004, 0.006, 0.004, 0.003, -0.005]) * k) for k, T in enumerate(true)]
    found = optimise(drifted, edges)
    assert distance(found, true) < 1e-6
    np.testing.assert_allclose(residuals(edges, found), 0.0, atol=1e-6)


def test_a_closed_loop_shares_its_error_evenly() -> None:
    """Four steps of 1 m along a line and back in one: 4 cm too little are taken 0.8 cm each."""
    poses = [se3.compose((1, 0, 0, 0), (k, 0, 0)) for k in range(5)]
    edges = [edge(poses, k, k + 1) for k in range(4)]
    edges.append(Edge(0, 4, se3.compose((1, 0, 0, 0), (4.04, 0, 0)), np.diag([1e4] * 3 + [1e6] * 3)))
    edges[:4] = [Edge(e.a, e.b, e.T_a_b, np.diag([1e4] * 3 + [1e6] * 3)) for e in edges[:4]]
    found = optimise(poses, edges)
    np.testing.assert_allclose([T[0, 3] for T in found], [0, 1.008, 2.016, 3.024, 4.032], atol=1e-5)


def test_more_information_pulls_harder() -> None:
    poses = [np.eye(4), np.eye(4)]
    near, far = se3.exp([0.1, 0, 0, 0, 0, 0]), se3.exp([0.103, 0, 0, 0, 0, 0])
    found = optimise(poses, [Edge(0, 1, near, SURE), Edge(0, 1, far, SURE * 2)])
    np.testing.assert_allclose(found[1][:3, 3], [0.102, 0, 0], atol=1e-5)


def test_one_wrong_edge_does_not_bend_the_ring() -> None:
    true = ring()
    edges = [edge(true, k, (k + d) % 12) for k in range(12) for d in (1, 2)]
    wrong = edge(true, 2, 8, np.array([0.5, 0.3, 0, 0, 0.4, 0]))
    found = optimise(true, [*edges, wrong])
    assert distance(found, true) < 0.02
    assert deviations([wrong], found)[0] > 100


@given(st.tuples(*[st.floats(-0.2, 0.2)] * 6))
def test_deviations_are_the_length_of_the_residual_in_deviations(off: tuple[float, ...]) -> None:
    poses = [np.eye(4), se3.exp(off)]
    measured = Edge(0, 1, np.eye(4), np.diag([4.0] * 6))
    expected = 2.0 * np.linalg.norm([*off[3:], *poses[1][:3, 3]])
    np.testing.assert_allclose(deviations([measured], poses)[0], expected, atol=1e-9)


def test_the_jacobian_lets_steps_converge_from_far() -> None:
    true = ring(6)
    edges = [edge(true, a, b) for a in range(6) for b in range(a)]
    rng = np.random.default_rng(0)
    start = [true[0], *(T @ se3.exp(rng.normal(size=6) * 0.15) for T in true[1:])]
    assert distance(optimise(start, edges), true) < 1e-5


def test_only_the_poses_around_the_new_one_move() -> None:
    true = ring()
    edges = [edge(true, k, k + 1) for k in range(11)] + [edge(true, k, k + 2) for k in range(10)]
    start = list(true)
    for k in (2, 10, 11):
        start[k] = start[k] @ se3.exp([0.01, 0, 0, 0, 0.01, 0])
    found = optimise_around(start, edges, middle=11, max_moving=4)
    np.testing.assert_array_equal(found[2], start[2])
    assert distance(found[8:], true[8:]) < 1e-6


def test_without_edges_nothing_moves() -> None:
    true = ring(3)
    assert distance(optimise(true, []), true) == 0.0
