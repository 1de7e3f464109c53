"""Whether a single error of the camera setup explains all differences between given and found motions.

Drift accumulates, and differs from place to place. A wrong depth scale, poses of another body than the camera, or
poses in another convention, cause the same difference for the same camera motion everywhere: correcting poses one by
one cures none of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.pose_convention import POSE_CONVENTIONS, converted
from cuboid.ground.core.tolerances import MIN_SIGMA_M
from cuboid.ground.geometry.se3 import inverse, log, skew

# An error explains the differences if at most this fraction of them remains.
LEFT_FRACTION = 0.3
# Another convention explains them if at most this fraction remains: poses in a wrong convention may drift in addition.
LEFT_BY_CONVENTION = 0.5
# Poses in millimetres or centimetres are so far apart that no two frames show the same place.
CONVENTIONS = tuple(names for names in POSE_CONVENTIONS if not {"mm", "cm"} & set(names))
# Accepted ranges of a depth scale, and of the offset between camera and body, metres and radians: beyond these, moving
# objects in the image are a more likely cause.
SCALES, MAX_OFFSET_M, MAX_OFFSET_RAD = (0.5, 2.0), 0.3, 0.3
# Damping of the fit, in metres and radians squared: parameters that the motions do not determine stay near zero.
DAMPING = 1e-4


@dataclass(frozen=True, slots=True)
class MotionPair:
    """A motion of the camera between two frames, as given and as found from the images.

    Attributes
    ----------
    T_world_camera, T_world_reference : (4, 4) float64
        The given poses of both frames.
    T_found : (4, 4) float64
        T_camera_reference, from the images.
    depth_m : float
        Depth of the scene: a rotation displaces it by this distance per radian.
    """

    T_world_camera: Float64Array
    T_world_reference: Float64Array
    T_found: Float64Array
    depth_m: float

    @property
    def T_given(self) -> Float64Array:
        """T_camera_reference (4, 4) by the given poses."""
        return inverse(self.T_world_camera) @ self.T_world_reference

    def in_convention(self, names: tuple[str, ...]) -> MotionPair:
        """Return the pair with given poses that are read in other conventions."""
        camera, reference = (converted(T, names) for T in (self.T_world_camera, self.T_world_reference))
        return MotionPair(camera, reference, self.T_found, self.depth_m)


@dataclass(frozen=True, slots=True)
class SingleCause:
    """An error of the camera setup that explains the differences.

    Attributes
    ----------
    scale : float or None
        Found translations are this times the given ones: the depth is too large, or the poses are too small.
    offset : (6,) float64 or None
        Motion (translation in metres, rotation in radians) between the camera and the body of the given poses.
    convention : tuple of str
        Convention of the given poses, in `POSE_CONVENTIONS`; empty if it is ours.
    """

    scale: float | None = None
    offset: Float64Array | None = None
    convention: tuple[str, ...] = ()


def single_cause(pairs: Sequence[MotionPair]) -> SingleCause | None:
    """Return the error that explains the differences of all motions; None if no kind does.

    Parameters
    ----------
    pairs : sequence of MotionPair
    """
    differences = _differences(pairs)
    left_by = {names: _rms(_differences([pair.in_convention(names) for pair in pairs])) for names in CONVENTIONS}
    convention = min(left_by, key=left_by.__getitem__)
    if left_by[convention] <= LEFT_BY_CONVENTION * _rms(differences):
        return SingleCause(convention=convention)
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


def _differences(pairs: Sequence[MotionPair]) -> Float64Array:
    """Return the differences of given and found motions, metres, six numbers each."""
    return np.concatenate([_weighted(log(pair.T_found @ inverse(pair.T_given)), pair) for pair in pairs])


def _weighted(motion: Float64Array, pair: MotionPair) -> Float64Array:
    """Return a motion (6,) or (6, N) in metres: rotations are multiplied by the depth."""
    return np.concatenate([motion[:3], pair.depth_m * motion[3:]])


def _by_offset(pair: MotionPair) -> Float64Array:
    """Return the derivative (6, 6) of the difference of a motion by the offset between camera and body.

    With an offset X the camera's motion is X^-1 T X, so that the difference is (Ad_T - 1) x for a small x = log X.
    """
    R, t = pair.T_given[:3, :3], pair.T_given[:3, 3]
    adjoint = np.block([[R, skew(t) @ R], [np.zeros((3, 3)), R]])
    return _weighted(adjoint - np.eye(6), pair)


def _fitted(columns: Float64Array, differences: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the parameters that explain most of the differences, and the remaining differences."""
    normal = columns.T @ columns + DAMPING * np.eye(columns.shape[1])
    parameters = np.asarray(np.linalg.solve(normal, columns.T @ differences), np.float64)
    return parameters, differences - columns @ parameters


def _rms(differences: Float64Array) -> float:
    """Return the root mean square displacement; a motion has six numbers."""
    return float(np.sqrt((differences**2).sum() / (len(differences) / 6)))
