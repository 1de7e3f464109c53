"""Errors of the written camera poses: none, drift, or jumps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from cuboid.core.frame import Float64Array
from cuboid.geometry import se3

PoseNoise = Callable[[Float64Array, np.random.Generator], Float64Array]

# Deviation of a frame's own error (it adds up): after 200 frames about 1.4 cm and 0.4 degrees, which is what
# good odometry without loop closure leaves on the way round a table.
DRIFT_M, DRIFT_RAD = 0.001, np.radians(0.03)
# A jump: how often, how far, and for how long, as when a tracker is lost and finds its place again.
JUMP_EVERY_FRAMES = 45
JUMP_M, JUMP_RAD = (0.01, 0.035), (np.radians(0.4), np.radians(1.5))
JUMP_FRAMES = (6, 20)


def none(T_world_camera: Float64Array, rng: np.random.Generator) -> Float64Array:
    """Return the poses (N, 4, 4) as they are."""
    return T_world_camera


def drift(T_world_camera: Float64Array, rng: np.random.Generator) -> Float64Array:
    """Return poses (N, 4, 4) whose errors add up from frame to frame, the first being exact."""
    wrong = np.empty_like(T_world_camera)
    wrong[0] = T_world_camera[0]
    for k in range(1, len(wrong)):
        step = se3.inverse(T_world_camera[k - 1]) @ T_world_camera[k]
        wrong[k] = wrong[k - 1] @ step @ _small(rng.normal(0, DRIFT_M, 3), rng.normal(0, DRIFT_RAD, 3))
    return wrong


def jumps(T_world_camera: Float64Array, rng: np.random.Generator) -> Float64Array:
    """Return poses (N, 4, 4) that are off by a few centimetres for some frames now and then."""
    wrong = T_world_camera.copy()
    k = int(rng.integers(10, JUMP_EVERY_FRAMES))
    while k < len(wrong):
        direction, axis = rng.standard_normal((2, 3))
        off = _small(
            direction / np.linalg.norm(direction) * rng.uniform(*JUMP_M),
            axis / np.linalg.norm(axis) * rng.uniform(*JUMP_RAD),
        )
        end = k + int(rng.integers(*JUMP_FRAMES))
        wrong[k:end] = wrong[k:end] @ off
        k = end + int(rng.integers(JUMP_EVERY_FRAMES // 2, JUMP_EVERY_FRAMES * 3 // 2))
    return wrong


POSE_NOISES: Mapping[str, PoseNoise] = MappingProxyType({"none": none, "drift": drift, "jumps": jumps})


def _small(translation: Float64Array, rotation_rad: Float64Array) -> Float64Array:
    """Return the motion (4, 4) of a translation and a small turn by a vector."""
    return se3.compose((1.0, *(rotation_rad / 2)), translation)
