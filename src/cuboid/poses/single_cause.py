"""Whether one fault of the camera explains all differences between given and found motions.

Drift adds up, differently at each place. A wrong depth scale and poses of another body than the camera leave the same
difference wherever the camera moves alike: neither is cured by moving the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.core.frame import Float64Array
from cuboid.core.tolerances import MIN_SIGMA_M
from cuboid.geometry.se3 import inverse, log, skew

# A fault explains the differences where it leaves at most this fraction of them.
LEFT_FRACTION = 0.3
# A scale beyond these, and a camera farther than this from the body, metres and radians, is none that is seen: what
# moves in the picture can look like it.
SCALES, MAX_OFFSET_M, MAX_OFFSET_RAD = (0.5, 2.0), 0.3, 0.3
# Damping of the fit, in metres and radians squared: what the motions do not determine stays near none.
DAMPING = 1e-4


@dataclass(frozen=True, slots=True)
class MotionPair:
    """A motion of the camera between two frames, as given and as found from the images.

    Attributes
    ----------
    T_given, T_found : (4, 4) float64
        T_camera_reference.
    depth_m : float
        Of what was seen: a rotation displaces it by so much a radian.
    """

    T_given: Float64Array
    T_found: Float64Array
    depth_m: float


@dataclass(frozen=True, slots=True)
class SingleCause:
    """A fault that explains the differences.

    Attributes
    ----------
    scale : float or None
        Found translations are this times the given ones: the depth is as much too large, or the poses too small.
    offset : (6,) float64 or None
        Motion (translation in metres, rotation in radians) between the camera and the body whose poses were given.
    """

    scale: float | None = None
    offset: Float64Array | None = None


def single_cause(pairs: Sequence[MotionPair]) -> SingleCause | None:
    """Return the fault of the camera that explains the differences of all motions; None where neither does.

    Parameters
    ----------
    pairs : sequence of MotionPair
    """
    differences = np.concatenate([_weighted(log(pair.T_found @ inverse(pair.T_given)), pair) for pair in pairs])
    allowed_m = max(LEFT_FRACTION * _rms(differences), MIN_SIGMA_M)
    by_scale = np.concatenate([_weighted(np.append(pair.T_given[:3, 3], np.zeros(3)), pair) for pair in pairs])[:, None]
    by_offset = np.concatenate([_by_offset(pair) for pair in pairs])
    scale, left = _fitted(by_scale, differences)
    factor = 1.0 + float(scale[0])
    if _rms(left) <= allowed_m and SCALES[0] <= factor <= SCALES[1]:
        return SingleCause(scale=factor)
    offset, left = _fitted(by_offset, differences)
    near = np.linalg.norm(offset[:3]) <= MAX_OFFSET_M and np.linalg.norm(offset[3:]) <= MAX_OFFSET_RAD
    return SingleCause(offset=offset) if near and _rms(left) <= allowed_m else None


def _weighted(motion: Float64Array, pair: MotionPair) -> Float64Array:
    """Return a motion (6,) or (6, N) in metres: rotations times the depth."""
    return np.concatenate([motion[:3], pair.depth_m * motion[3:]])


def _by_offset(pair: MotionPair) -> Float64Array:
    """Return the derivative (6, 6) of the difference of a motion by the offset of the camera from the body.

    With an offset X the camera's motion is X^-1 T X, so that the difference is (Ad_T - 1) x for a small x = log X.
    """
    R, t = pair.T_given[:3, :3], pair.T_given[:3, 3]
    adjoint = np.block([[R, skew(t) @ R], [np.zeros((3, 3)), R]])
    return _weighted(adjoint - np.eye(6), pair)


def _fitted(columns: Float64Array, differences: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the parameters that explain most of the differences, and what they leave."""
    normal = columns.T @ columns + DAMPING * np.eye(columns.shape[1])
    parameters = np.asarray(np.linalg.solve(normal, columns.T @ differences), np.float64)
    return parameters, differences - columns @ parameters


def _rms(differences: Float64Array) -> float:
    """Return the root of the mean squared displacement; six numbers a motion."""
    return float(np.sqrt((differences**2).sum() / (len(differences) / 6)))
