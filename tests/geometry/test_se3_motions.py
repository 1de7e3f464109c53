from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from cuboid.ground.geometry import se3

length = st.floats(-3, 3)
turn = st.floats(-1.7, 1.7)  # a rotation vector below pi
twists = st.tuples(length, length, length, turn, turn, turn)
small_twists = st.tuples(*[st.floats(-1e-3, 1e-3)] * 6)


def matrix_of(twist) -> np.ndarray:
    generator = np.zeros((4, 4))
    generator[:3, :3] = se3.skew(twist[3:])
    generator[:3, 3] = twist[:3]
    return generator


@given(st.one_of(twists, small_twists))
def test_exp_is_the_matrix_exponential(twist) -> None:
    np.testing.assert_allclose(se3.exp(twist), expm(matrix_of(twist)), atol=1e-9)


@given(st.one_of(twists, small_twists))
def test_log_undoes_exp(twist) -> None:
    np.testing.assert_allclose(se3.log(se3.exp(twist)), twist, atol=1e-8)


@given(twists)
def test_the_angle_is_the_length_of_the_rotation_vector(twist) -> None:
    np.testing.assert_allclose(se3.angle(se3.exp(twist)), np.linalg.norm(twist[3:]), atol=1e-9)


def test_a_long_chain_of_motions_stays_rigid_when_tidied() -> None:
    T = np.eye(4)
    step = se3.exp([0.01, 0.0, 0.02, 0.01, -0.02, 0.03])
    for _ in range(2000):
        T = se3.tidied(se3.inverse(se3.inverse(T) @ se3.inverse(step)))
    assert np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() < 1e-12
    np.testing.assert_allclose(se3.tidied(T), T, atol=1e-12)
