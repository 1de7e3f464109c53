from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cuboid.ground.geometry import se3

metres = st.floats(-50, 50)
unit_range = st.floats(-1, 1)
quats = st.tuples(unit_range, unit_range, unit_range, unit_range).filter(lambda q: np.linalg.norm(q) > 1e-3)
motions = st.builds(se3.compose, quats, st.tuples(metres, metres, metres))


@given(quats)
def test_rotation_of_a_quaternion_is_that_of_scipy(quat):
    expected = Rotation.from_quat(np.roll(quat, -1)).as_matrix()
    np.testing.assert_allclose(se3.rotation_from_quat_wxyz(quat), expected, atol=1e-12)


@given(quats)
def test_quaternion_survives_the_way_through_a_matrix(quat):
    back = se3.quat_wxyz_from_rotation(se3.rotation_from_quat_wxyz(quat))
    unit = np.asarray(quat) / np.linalg.norm(quat)
    assert back[0] >= 0
    assert min(np.abs(back - unit).max(), np.abs(back + unit).max()) < 1e-12


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_turns_have_their_axis(axis):
    R = -np.eye(3)
    R[axis, axis] = 1.0
    expected = np.zeros(4)
    expected[1 + axis] = 1.0
    np.testing.assert_allclose(np.abs(se3.quat_wxyz_from_rotation(R)), expected, atol=1e-15)


def test_quaternions_of_many_rotations_are_those_of_each() -> None:
    rng = np.random.default_rng(3)
    quats = rng.normal(size=(200, 4))
    quats[::4, 0] = 0.0  # half turns
    R = np.array([se3.rotation_from_quat_wxyz(quat) for quat in (*quats, *np.eye(4))])
    many = se3.quats_wxyz_from_rotations(R)
    np.testing.assert_allclose(many, [se3.quat_wxyz_from_rotation(one) for one in R], atol=1e-15)
    assert se3.quats_wxyz_from_rotations(np.empty((0, 3, 3))).shape == (0, 4)


def test_a_quarter_turn_about_z_takes_x_to_y():
    T = se3.compose((np.sqrt(0.5), 0, 0, np.sqrt(0.5)), (10, 20, 30))
    np.testing.assert_allclose(se3.transform(T, (1, 0, 0)), (10, 21, 30), atol=1e-12)


def test_length_of_a_quaternion_does_not_matter():
    small = se3.rotation_from_quat_wxyz(np.array([1e-200, 0, 0, 1e-200]))
    np.testing.assert_allclose(small, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize("quat", [(0, 0, 0, 0), (np.nan, 0, 0, 1), (np.inf, 0, 0, 1)])
def test_a_quaternion_without_direction_is_refused(quat):
    with pytest.raises(ValueError, match="finite quaternion other than zero"):
        se3.rotation_from_quat_wxyz(quat)


@given(motions)
def test_inverse_undoes(T):
    np.testing.assert_allclose(se3.inverse(T) @ T, np.eye(4), atol=1e-11)


@given(motions, st.lists(st.tuples(metres, metres, metres), min_size=1, max_size=5))
def test_transform_keeps_distances_and_shapes(T, points):
    moved = se3.transform(T, points)
    assert moved.shape == (len(points), 3)
    np.testing.assert_allclose(
        np.linalg.norm(moved - moved[0], axis=1),
        np.linalg.norm(np.asarray(points) - points[0], axis=1),
        atol=1e-10,
    )
    np.testing.assert_allclose(se3.transform(se3.inverse(T), moved), points, atol=1e-10)
    np.testing.assert_allclose(se3.transform(T, np.reshape(points, (-1, 1, 3)))[:, 0], moved)


@given(motions)
def test_motions_are_rigid(T):
    assert se3.is_rigid(T, 1e-9)
    assert se3.is_rigid(np.round(T, 4))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda T: np.full((4, 4), np.nan),
        lambda T: T * np.array([1, 1, np.inf, 1]),
        lambda T: np.diag([1.0, 1.0, -1.0, 1.0]),
        lambda T: np.diag([1.1, 1.1, 1.1, 1.0]),
        lambda T: np.diag([1.0, 1.0, 1.0, 2.0]),
        lambda T: np.zeros((4, 4)),
        lambda T: np.eye(4) * 1e200,
        lambda T: T[:3],
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")  # inf * 0, on purpose
def test_what_is_not_rigid_is_told(spoil):
    assert not se3.is_rigid(spoil(np.eye(4)))


@given(motions, motions)
def test_interpolation_ends_where_it_should(T0, T1):
    np.testing.assert_allclose(se3.interpolate(T0, T1, 0.0), T0, atol=1e-10)
    np.testing.assert_allclose(se3.interpolate(T0, T1, 1.0), T1, atol=1e-10)


@given(motions, st.tuples(unit_range, unit_range, unit_range), st.floats(0, 1))
def test_interpolation_turns_at_an_even_rate(T0, turn, s):
    """Against SciPy's exponential map; the turn stays below a half turn, where the shorter way is unique."""
    T1 = T0.copy()
    T1[:3, :3] = T0[:3, :3] @ Rotation.from_rotvec(turn).as_matrix()
    T = se3.interpolate(T0, T1, s)
    expected = T0[:3, :3] @ Rotation.from_rotvec(s * np.asarray(turn)).as_matrix()
    np.testing.assert_allclose(T[:3, :3], expected, atol=1e-9)
    assert se3.is_rigid(T, 1e-9)


def test_poses_are_apart_by_distance_or_by_angle() -> None:
    near = se3.exp(np.array([0.01, -0.02, 0.0, 0.0, 0.0, 0.009]))
    start = se3.exp(np.array([0.4, 1.0, -0.3, 0.5, -1.2, 0.3]))
    assert not se3.moved_beyond(start, near @ start, 10.0, 0.01)
    assert se3.moved_beyond(start, near @ start, 10.0, 0.0085)
    moved = start.copy()
    moved[:3, 3] += (0.01, -0.02, 0.02)
    assert se3.moved_beyond(start, moved, 0.0299, 0.01)
    assert not se3.moved_beyond(start, moved, 0.0301, 0.01)
