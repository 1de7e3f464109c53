"""Borders between segments: where surfaces part (a jump, a groove) and where they continue (flat, a convex edge)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cuboid.ground.core.tolerances import JUMP_SIGMAS
from cuboid.method.surfaces.frame_segments import border_evidence
from cuboid.method.surfaces.kernels.borders import (
    DIRECTION_REACH_PX,
    GROOVE_RAD,
    GROOVE_SIGMAS,
    MAX_REACH_M,
    REACH_M,
    borders,
)

FOCAL, NOISE, JUMP_M = 300.0, 1e-4, 0.01
SHAPE = 40, 60


def counted(depth: np.ndarray, claim: np.ndarray) -> tuple[np.ndarray, ...]:
    count = int(claim.max()) + 1
    found = tuple(np.empty((count, count), np.int64) for _ in range(4))
    borders(depth.astype(np.float32), claim.astype(np.int32), FOCAL, NOISE, JUMP_M, *found)
    return found


def slow(depth: np.ndarray, claim: np.ndarray) -> tuple[np.ndarray, ...]:
    """The same, from points in metres: the angle between the directions of the two surfaces along the image axis."""
    count = int(claim.max()) + 1
    found = tuple(np.zeros((count, count), int) for _ in range(4))
    for axis in (0, 1):
        step = np.array([1, 0]) if axis == 0 else np.array([0, 1])
        for p in np.argwhere(claim >= 0):
            q = p + step
            if (q >= depth.shape).any() or claim[tuple(q)] < 0 or claim[tuple(q)] == claim[tuple(p)]:
                continue
            z0, z1 = (float(depth[tuple(x)]) for x in (p, q))
            if not (z0 > 0 and z1 > 0):
                continue
            pair = tuple(sorted((claim[tuple(p)], claim[tuple(q)])))
            found[0][pair] += 1
            z = min(z0, z1)
            if abs(z0 - z1) > JUMP_M + JUMP_SIGMAS * NOISE * z * z:
                found[1][pair] += 1
                continue
            if DIRECTION_REACH_PX * z / FOCAL > MAX_REACH_M:
                found[3][pair] += 1
                continue
            reach = max(DIRECTION_REACH_PX, int(REACH_M * FOCAL / z))
            before, behind = p - reach * step, q + reach * step
            if (before < 0).any() or (behind >= depth.shape).any():
                continue
            if claim[tuple(before)] != claim[tuple(p)] or claim[tuple(behind)] != claim[tuple(q)]:
                continue
            za, zb = (float(depth[tuple(x)]) for x in (before, behind))
            if not (za > 0 and zb > 0):
                continue
            slopes = [z * FOCAL * (1 / far - 1 / near) / reach for near, far in ((za, z0), (z1, zb))]
            sigma = 2 * NOISE / reach * z * FOCAL / (1 + np.mean(slopes) ** 2)
            turn = math.atan(slopes[1]) - math.atan(slopes[0])
            found[1 if turn > max(GROOVE_RAD, GROOVE_SIGMAS * sigma) else 2][pair] += 1
    return found


def ridge(angle_rad: float) -> np.ndarray:
    """Depth of two planes that meet in the middle column; the angle is positive for a groove, 0 for one plane."""
    tangent = math.tan(angle_rad / 2)
    columns = (np.arange(SHAPE[1]) + 0.5 - SHAPE[1] / 2) / FOCAL
    # z = 0.6 - tangent * |x|, with x = column * z
    return np.tile(0.6 / (1.0 + tangent * np.abs(columns)), (SHAPE[0], 1))


HALVES = np.tile(np.arange(SHAPE[1]) >= SHAPE[1] // 2, (SHAPE[0], 1)).astype(int)


@pytest.mark.parametrize(
    ("angle_deg", "parts"), [(0.0, False), (-90.0, False), (-30.0, False), (10.0, False), (35.0, True), (90.0, True)]
)
def test_surfaces_part_at_a_groove_and_continue_at_a_convex_edge(angle_deg: float, parts: bool) -> None:
    shared, parting, continuing, _ = counted(ridge(math.radians(angle_deg)), HALVES)
    assert shared[0, 1] == SHAPE[0]
    assert (parting[0, 1], continuing[0, 1]) == ((SHAPE[0], 0) if parts else (0, SHAPE[0]))


def test_pixels_that_are_too_coarse_for_a_shape_are_counted_apart() -> None:
    far_m = MAX_REACH_M * FOCAL / DIRECTION_REACH_PX
    for z, none in ((0.9 * far_m, False), (1.1 * far_m, True)):
        _, parting, continuing, coarse = counted(np.full(SHAPE, z), HALVES)
        assert (parting[0, 1], coarse[0, 1] > 0, continuing[0, 1] > 0) == (0, none, not none)


def test_surfaces_part_at_a_jump() -> None:
    shared, parting, continuing, _ = counted(0.6 + 0.05 * HALVES, HALVES)
    assert (shared[0, 1], parting[0, 1], continuing[0, 1]) == (SHAPE[0], SHAPE[0], 0)


@pytest.mark.parametrize("seed", range(5))
def test_the_kernel_counts_as_the_loop_over_points_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    claim = (rows + 3 * seed) // 14 * 4 + columns // 17
    claim[rng.random(SHAPE) < 0.01] = -1
    depth = 0.6 + 0.002 * np.abs(columns % 17 - 8) + 0.02 * (claim % 3) + rng.normal(0, 0.0005, SHAPE)
    depth[rng.random(SHAPE) < 0.02] = 0.0
    depth = depth.astype(np.float32).astype(float)
    for found, expected in zip(counted(depth, claim), slow(depth, claim), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_border_that_continues_is_evidence_for_one_thing_and_one_that_parts_for_two() -> None:
    shared = np.array([[0, 20], [0, 0]])
    sizes = np.array([400, 900])
    one = border_evidence(shared, shared * 0, shared, sizes)[0, 1]
    two = border_evidence(shared, shared, shared * 0, sizes)[0, 1]
    short = border_evidence(shared // 10, shared * 0, shared // 10, sizes)[0, 1]
    assert two < 0.0 < one
    assert short < one
