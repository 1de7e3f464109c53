from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.geometry.se3 import exp, inverse
from cuboid.method.poses.single_cause import MotionPair, single_cause


def motions(seed: int = 0, count: int = 12) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [exp(np.concatenate([rng.uniform(-0.4, 0.4, 3), rng.uniform(-0.3, 0.3, 3)])) for _ in range(count)]


def pairs(found: list[np.ndarray]) -> list[MotionPair]:
    noise = np.random.default_rng(1)
    return [
        MotionPair(inverse(T), np.eye(4), exp(noise.normal(size=6) * 0.0005) @ other, 1.2)
        for T, other in zip(motions(), found, strict=True)
    ]


@pytest.mark.parametrize("factor", [0.9, 1.05])
def test_a_scale_of_all_translations_is_found(factor: float) -> None:
    scaled = [np.block([[T[:3, :3], factor * T[:3, 3:]], [T[3:]]]) for T in motions()]
    cause = single_cause(pairs(scaled))
    assert cause is not None
    assert cause.scale == pytest.approx(factor, abs=0.003)


def test_poses_of_another_body_than_the_camera_are_found() -> None:
    T_body_camera = exp(np.array([0.05, 0.02, -0.03, 0.03, -0.05, 0.02]))
    cause = single_cause(pairs([inverse(T_body_camera) @ T @ T_body_camera for T in motions()]))
    assert cause is not None
    assert cause.scale is None
    assert cause.offset is not None


def test_drift_and_things_beyond_a_camera_are_no_single_cause() -> None:
    drift = [exp(np.array([0.01 * k, 0.0, 0.0, 0.0, 0.0, 0.004 * k])) @ T for k, T in enumerate(motions())]
    assert single_cause(pairs(drift)) is None
    still = [np.eye(4)] * len(motions())  # as an alignment to a thing that hangs at the camera
    assert single_cause(pairs(still)) is None
