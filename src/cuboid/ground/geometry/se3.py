"""Rigid transforms: 4x4 matrices named destination first, and unit quaternions in the order w, x, y, z."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array

# Largest accepted deviation of a matrix from a rotation; files with 3 digits stay below. The matrix is then corrected.
RIGID_TOLERANCE = 0.01
# Below this deviation a matrix is a rotation up to the rounding of 64 bits, and is not corrected.
EXACT_TOLERANCE = 1e-12
# Largest distance of a camera from the origin of its world, metres.
MAX_FROM_ORIGIN_M = 1e6
# Below this angle between two quaternions (radians) the slerp weights sin(a t) / sin(a) become inaccurate,
# and linear interpolation between them is exact to 1e-13.
SLERP_SMALL_ANGLE = 1e-6
# Below this sine of half an angle a rotation vector is twice the quaternion's vector part, exact to 1e-16.
ROTATION_SMALL = 1e-9
# Below this angle (radians) a short Taylor series is exact to 1e-13, while the closed form becomes inaccurate.
SERIES_BELOW = 0.02


def rotation_from_quat_wxyz(quat_wxyz: npt.ArrayLike) -> Float64Array:
    """Return the rotation matrix of a quaternion.

    Parameters
    ----------
    quat_wxyz : (4,) array-like
        w, x, y, z; any length above zero, because it is normalised here.

    Returns
    -------
    (3, 3) float64

    Raises
    ------
    ValueError
        If the quaternion has no direction: zero, NaN or infinite.
    """
    w, x, y, z = _unit(np.asarray(quat_wxyz, np.float64))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quat_wxyz_from_rotation(rotation: npt.ArrayLike) -> Float64Array:
    """Return the unit quaternion of a rotation matrix, with w >= 0.

    Parameters
    ----------
    rotation : (3, 3) array-like
        A rotation matrix.

    Returns
    -------
    (4,) float64
        w, x, y, z. The products of the quaternion with its largest component are normalised (Shepperd 1978), which
        is accurate at all angles.
    """
    # In Python's floats: for nine numbers NumPy takes several times as long.
    R = np.asarray(rotation, np.float64).tolist()
    diagonal = R[0][0], R[1][1], R[2][2]
    trace = diagonal[0] + diagonal[1] + diagonal[2]
    candidates = trace, *diagonal
    biggest = candidates.index(max(candidates))
    if biggest == 0:
        quat = [1 + trace, R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]]
    else:
        i = biggest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        quat = [0.0] * 4
        quat[0] = R[k][j] - R[j][k]
        quat[1 + i] = 1 + 2 * R[i][i] - trace
        quat[1 + j] = R[j][i] + R[i][j]
        quat[1 + k] = R[k][i] + R[i][k]
    unit = _unit(np.array(quat))
    return -unit if unit[0] < 0 else unit


def quats_wxyz_from_rotations(rotations: npt.ArrayLike) -> Float64Array:
    """Return the unit quaternions (N, 4) of rotation matrices (N, 3, 3); see `quat_wxyz_from_rotation`."""
    R = np.asarray(rotations, np.float64).reshape(-1, 3, 3)
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(R, 0, -1)
    trace = a + e + i
    x, y, z = h - f, c - g, d - b
    products = np.array(
        [
            [1 + trace, x, y, z],
            [x, 1 + 2 * a - trace, d + b, g + c],
            [y, d + b, 1 + 2 * e - trace, h + f],
            [z, g + c, h + f, 1 + 2 * i - trace],
        ]
    )  # four times the product of each component, first axis, with each of the others
    quats = products[np.argmax((trace, a, e, i), axis=0), :, np.arange(len(R))]
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    return np.where(quats[:, :1] < 0, -quats, quats)


def compose(quat_wxyz: npt.ArrayLike, translation: npt.ArrayLike) -> Float64Array:
    """Return the (4, 4) matrix of a quaternion (w, x, y, z) and a translation (3,) in metres.

    Raises
    ------
    ValueError
        If the quaternion has no direction.
    """
    return assembled(rotation_from_quat_wxyz(quat_wxyz), translation)


def assembled(rotation: npt.ArrayLike, translation: npt.ArrayLike) -> Float64Array:
    """Return the (4, 4) matrix of a rotation (3, 3) and a translation (3,) in metres, unchecked."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, translation
    return T


def moved_beyond(T_one: Float64Array, T_other: Float64Array, distance_m: float, angle_rad: float) -> bool:
    """Return whether two poses (4, 4) differ by more than a distance, or by more than an angle (below pi)."""
    step, R = T_other[:3, 3] - T_one[:3, 3], T_one[:3, :3] * T_other[:3, :3]
    # The trace of the rotation between the two is 1 + 2 cos(angle).
    return float(step @ step) > distance_m**2 or float(R.sum()) < 1.0 + 2.0 * math.cos(angle_rad)


def inverse(T_a_b: npt.ArrayLike) -> Float64Array:
    """Return T_b_a (4, 4), the inverse of the rigid T_a_b (4, 4)."""
    T = np.asarray(T_a_b, np.float64)
    T_b_a = np.eye(4)
    T_b_a[:3, :3] = T[:3, :3].T
    T_b_a[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return T_b_a


def is_rigid(T: npt.ArrayLike, tolerance: float = 1e-3) -> bool:
    """Return whether a 4x4 matrix is a rotation and a translation.

    Parameters
    ----------
    T : (4, 4) array-like
    tolerance : float
        Largest deviation of an entry of R R^T from the identity, and of the last row from 0 0 0 1.
        The default accepts matrices that were written with four digits.

    Returns
    -------
    bool
        False for matrices of another shape, with NaN or infinity, with scale or shear, and for mirrors.
    """
    M = np.asarray(T, np.float64)
    return M.shape == (4, 4) and _deviation(M) <= tolerance


def _deviation(T: Float64Array) -> float:
    """Return the deviation of a matrix (4, 4) from a rigid transform; infinite for mirrors, NaN and infinity.

    It uses Python floats: NumPy takes ten times as long for such a small matrix, and this runs for each frame.
    """
    (a, b, c, x), (d, e, f, y), (g, h, i, z), (p, q, r, s) = T.tolist()
    if not all(map(math.isfinite, (x, y, z, p, q, r, s))):
        return math.inf
    off = max(
        abs(a * a + b * b + c * c - 1.0),
        abs(d * d + e * e + f * f - 1.0),
        abs(g * g + h * h + i * i - 1.0),
        abs(a * d + b * e + c * f),
        abs(a * g + b * h + c * i),
        abs(d * g + e * h + f * i),
        abs(p),
        abs(q),
        abs(r),
        abs(s - 1.0),
    )
    turned = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0
    return off if turned else math.inf


def rigid(T: npt.ArrayLike) -> Float64Array:
    """Return a pose (4, 4) given by a user without the rounding errors of its file.

    Poses are validated here: a matrix that is not rigid is refused, and the result is rigid to the last digit.

    Raises
    ------
    ValueError
        If the pose has another shape, has NaN, infinite or too large numbers, or is not rigid (scale, shear, mirror).
    """
    M = np.asarray(T, np.float64)
    if M.shape != (4, 4):
        raise ValueError(f"a pose must be (4, 4), got {M.shape}")
    refuse_nowhere(M)
    off = _deviation(M)
    if off > RIGID_TOLERANCE:
        raise ValueError("the pose is not rigid (a rotation, a translation and a last row 0 0 0 1)")
    return M if off <= EXACT_TOLERANCE else tidied(M)


def refuse_nowhere(numbers: npt.ArrayLike) -> None:
    """Raise ValueError if a number of a pose (4, 4) is NaN, infinite, or larger than `MAX_FROM_ORIGIN_M`."""
    largest = np.abs(numbers).max()
    if not np.isfinite(largest):
        raise ValueError("the pose has NaN or infinite numbers")
    if largest > MAX_FROM_ORIGIN_M:
        raise ValueError(
            f"the pose is {largest:.3g} m away, expected at most {MAX_FROM_ORIGIN_M:g} m; "
            "subtract an offset from all poses"
        )


def interpolate(T_a_b0: npt.ArrayLike, T_a_b1: npt.ArrayLike, s: float) -> Float64Array:
    """Interpolate from one rigid transform to another, by a fraction `s`.

    Parameters
    ----------
    T_a_b0, T_a_b1 : (4, 4) array-like
        At s = 0 and at s = 1.
    s : float
        0..1.

    Returns
    -------
    (4, 4) float64
        The translation is interpolated linearly, the rotation along the shorter arc at constant speed (slerp).
    """
    T0, T1 = np.asarray(T_a_b0, np.float64), np.asarray(T_a_b1, np.float64)
    q0, q1 = quat_wxyz_from_rotation(T0[:3, :3]), quat_wxyz_from_rotation(T1[:3, :3])
    if q0 @ q1 < 0:
        q1 = -q1
    # atan2 of the chords is accurate at small angles; arccos of a product near 1 is not.
    angle = 2.0 * np.arctan2(np.linalg.norm(q1 - q0), np.linalg.norm(q1 + q0))
    if angle < SLERP_SMALL_ANGLE:
        quat = (1 - s) * q0 + s * q1
    else:
        quat = (np.sin((1 - s) * angle) * q0 + np.sin(s * angle) * q1) / np.sin(angle)
    return compose(quat, (1 - s) * T0[:3, 3] + s * T1[:3, 3])


def transform(T_a_b: npt.ArrayLike, points_b: npt.ArrayLike) -> Float64Array:
    """Return points (..., 3) in frame a, given in frame b."""
    T = np.asarray(T_a_b, np.float64)
    moved: Float64Array = np.asarray(points_b, np.float64) @ T[:3, :3].T + T[:3, 3]
    return moved


def exp(motion: npt.ArrayLike) -> Float64Array:
    """Return the rigid motion (4, 4) of a twist.

    Parameters
    ----------
    motion : (6,) array-like
        Translation part (metres), then rotation vector (radians).

    Returns
    -------
    (4, 4) float64
        By Rodrigues' formula and the V matrix of SE(3) (Eade, "Lie groups for 2D and 3D transformations", 2013).
    """
    xi = np.asarray(motion, np.float64)
    W = skew(xi[3:])
    a, b, c = _series(float(xi[3:] @ xi[3:]))
    T = np.eye(4)
    T[:3, :3] += a * W + b * (W @ W)
    T[:3, 3] = xi[:3] + (b * W + c * (W @ W)) @ xi[:3]
    return T


def log(T_a_b: npt.ArrayLike) -> Float64Array:
    """Return the twist (6,) of a rigid motion (4, 4), the inverse of `exp`; its angle is at most pi."""
    T = np.asarray(T_a_b, np.float64)
    w, *axis = quat_wxyz_from_rotation(T[:3, :3])
    sine = float(np.linalg.norm(axis))
    # at a small angle theta / sin(theta / 2) tends to 2
    scale = 2.0 * np.arctan2(sine, w) / sine if sine > ROTATION_SMALL else 2.0
    turn = scale * np.array(axis)
    W = skew(turn)
    _, b, c = _series(float(turn @ turn))
    V = np.eye(3) + b * W + c * (W @ W)
    return np.concatenate([np.linalg.solve(V, T[:3, 3]), turn])


def tidied(T_a_b: npt.ArrayLike) -> Float64Array:
    """Return a product of many rigid transforms (4, 4) without its rounding errors.

    `inverse` uses the transpose as the inverse of a rotation, so that errors would grow along a long chain.
    """
    T = np.asarray(T_a_b, np.float64)
    return compose(quat_wxyz_from_rotation(T[:3, :3]), T[:3, 3])


def mean_motion(T_a_camera: Float64Array, T_b_camera: Float64Array) -> Float64Array:
    """Return the rigid T_a_b (4, 4) that best aligns the poses (N, 4, 4) of one world with those of another.

    The rotation is the chordal mean of R_a R_b^T (Hartley, Trumpf, Dai, Li, "Rotation Averaging", IJCV 2013), which is
    determined even if the camera moved along a line or not at all; the translation is the least-squares solution for
    this rotation.
    """
    turns = T_a_camera[:, :3, :3] @ T_b_camera[:, :3, :3].transpose(0, 2, 1)
    left, _, right = np.linalg.svd(turns.sum(0))
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    shift = (T_a_camera[:, :3, 3] - T_b_camera[:, :3, 3] @ rotation.T).mean(0)
    return compose(quat_wxyz_from_rotation(rotation), shift)


def level_rotation(up: Float64Array) -> Float64Array:
    """Return a rotation (3, 3) whose rows are two level axes and the unit vector `up` (3,): it rotates up to +z."""
    first = np.cross(np.eye(3)[int(np.argmin(np.abs(up)))], up)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first), up])


def skew(vector: npt.ArrayLike) -> Float64Array:
    """Return the (3, 3) matrix M of a vector v (3,) with M x = v cross x."""
    x, y, z = np.asarray(vector, np.float64)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def angle(T_a_b: npt.ArrayLike) -> float:
    """Return the angle of the rotation of a rigid motion (4, 4), radians, 0..pi."""
    w, x, y, z = quat_wxyz_from_rotation(np.asarray(T_a_b, np.float64)[:3, :3])
    return float(2.0 * np.arctan2(np.sqrt(x * x + y * y + z * z), w))


def _series(square: float) -> tuple[float, float, float]:
    """Return sin(t) / t, (1 - cos(t)) / t^2 and (t - sin(t)) / t^3 of the square of an angle t."""
    if square < SERIES_BELOW**2:
        return 1 - square / 6 * (1 - square / 20), 0.5 - square / 24 * (1 - square / 30), (1 - square / 20) / 6
    t = np.sqrt(square)
    # 1 - cos t computed from the half angle is accurate
    return float(np.sin(t) / t), float(2 * np.sin(t / 2) ** 2 / square), float((t - np.sin(t)) / (square * t))


def _unit(quat_wxyz: Float64Array) -> Float64Array:
    """Return the quaternion normalised to length 1; raise ValueError if it is zero or not finite."""
    largest = np.abs(quat_wxyz).max()
    if quat_wxyz.shape != (4,) or not np.isfinite(largest) or largest == 0:
        raise ValueError(f"a rotation needs a finite quaternion other than zero, got {quat_wxyz.tolist()}")
    scaled = quat_wxyz / largest  # a length of 1e-200 squared would be zero
    unit: Float64Array = scaled / math.sqrt(scaled @ scaled)
    return unit


def view_shift_m(T_new: Float64Array, T_old: Float64Array, depth_m: float) -> float:
    """Return the larger displacement of a camera and of the point at a depth on its optical axis, metres.

    Parameters
    ----------
    T_new, T_old : (4, 4) float64
        T_world_camera after and before a correction.
    depth_m : float
    """
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, depth_m]])
    return float(np.linalg.norm(transform(T_new, ends) - transform(T_old, ends), axis=1).max())
