"""How much lower the rim of a rounded top is than its middle."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.rims import is_hollow, rim_drop_m, side_drops, steps_m

BOX = Box(np.array([0.3, 0.2, 0.04]), np.array([0.16, 0.12, 0.08]), np.eye(3))
VOXEL_M = 0.01
PLAN = np.stack(np.meshgrid(np.arange(-0.0775, 0.08, 0.005), np.arange(-0.0575, 0.06, 0.005)), -1).reshape(-1, 2)


def top(drop_m: np.ndarray) -> np.ndarray:
    return np.column_stack([PLAN, 0.04 - drop_m]) + BOX.center


def test_a_flat_top_has_no_drop_though_sides_are_seen_and_one_rim_is_mixed() -> None:
    far = 0.08 - np.abs(PLAN[:, 0]) < 0.01
    points = top(np.where(far & (PLAN[:, 0] > 0.0), 0.015, 0.0))
    below = np.column_stack([np.full(40, -0.08), np.linspace(-0.05, 0.05, 40), np.linspace(-0.04, 0.03, 40)])
    assert rim_drop_m(side_drops(BOX, np.concatenate([points, below + BOX.center]), VOXEL_M)) == 0.0


def test_a_rounded_top_drops_at_all_sides() -> None:
    inside = np.minimum(0.08 - np.abs(PLAN[:, 0]), 0.06 - np.abs(PLAN[:, 1]))
    assert rim_drop_m(side_drops(BOX, top(np.maximum(0.0, 0.01 - inside)), VOXEL_M)) == pytest.approx(0.005, abs=0.003)


def test_a_lower_part_at_one_side_is_a_step_and_mixed_readings_are_none() -> None:
    edge = (0.08 - np.abs(PLAN[:, 0]) < 0.01) & (PLAN[:, 0] > 0.0)
    noise = 0.001 * np.random.default_rng(0).standard_normal(len(PLAN))
    stepped = top(np.where(edge, 0.03, 0.0) + noise)
    np.testing.assert_allclose(steps_m(side_drops(BOX, stepped, VOXEL_M), VOXEL_M), [0.03, 0.0], atol=0.002)
    assert rim_drop_m(side_drops(BOX, stepped, VOXEL_M)) < 0.002
    mixed = top(np.where(edge, np.random.default_rng(1).uniform(0.0, 0.06, len(PLAN)), 0.0))
    np.testing.assert_array_equal(steps_m(side_drops(BOX, mixed, VOXEL_M), VOXEL_M), [0.0, 0.0])


def test_a_top_without_a_middle_tells_nothing() -> None:
    assert rim_drop_m(side_drops(BOX, np.zeros((0, 3)), VOXEL_M)) == 0.0


def test_a_cup_is_hollow_and_a_flat_or_rounded_top_is_not() -> None:
    inside = np.minimum(0.08 - np.abs(PLAN[:, 0]), 0.06 - np.abs(PLAN[:, 1]))
    assert is_hollow(side_drops(BOX, top(np.where(inside > 0.01, 0.06, 0.0)), VOXEL_M), VOXEL_M)
    assert not is_hollow(side_drops(BOX, top(np.zeros(len(PLAN))), VOXEL_M), VOXEL_M)
    assert not is_hollow(side_drops(BOX, top(np.maximum(0.0, 0.02 - inside)), VOXEL_M), VOXEL_M)
