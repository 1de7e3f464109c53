"""What moves: marked and counted as array operations do it."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cuboid.ground.core.tolerances import JUMP_SIGMAS, NEAREST_M
from cuboid.ground.geometry import se3
from cuboid.method.heatmap.kernels.motion import grow
from cuboid.method.objects.kernels.clusters import score_shifts
from cuboid.method.objects.kernels.leaving import count_passed
from cuboid.method.poses.kernels.free_space import mark_freed, mark_unseen, spread

CAMERA = np.array([30.0, 32.0, 19.5, 14.5])
SHAPE = (30, 40)
NOISE, WITHIN_M, MAX_COLOR_DIFFERENCE = 1.4e-3, 0.01, 48


def any_depth(rng: np.random.Generator) -> np.ndarray:
    depth = rng.uniform(0.5, 2.5, SHAPE).astype(np.float32)
    depth[rng.random(SHAPE) < 0.2] = 0.0
    return depth


def any_pose(rng: np.random.Generator) -> np.ndarray:
    return se3.exp(rng.normal(0.0, 0.1, 6))


def seen_at(points: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Column, row and depth of points (N, 3) in the camera that T leads to."""
    there = points.astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    z = np.maximum(there[:, 2], NEAREST_M)
    return there[:, 0] / z * CAMERA[0] + CAMERA[2], there[:, 1] / z * CAMERA[1] + CAMERA[3], there[:, 2]


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_a_reading_is_freed_where_a_reference_saw_what_lies_behind_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth, references = any_depth(rng), np.array([any_depth(rng) for _ in range(3)])
    T, error_m = np.array([any_pose(rng) for _ in range(3)]), rng.uniform(0.0, 0.1, 3)
    freed = np.empty(SHAPE, np.uint8)
    mark_freed(depth, CAMERA, references, np.tile(CAMERA, (3, 1)), T, error_m, NOISE, freed)

    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    z = depth.astype(np.float64)
    points = np.stack([(u - CAMERA[2]) / CAMERA[0] * z, (v - CAMERA[3]) / CAMERA[1] * z, z], -1).reshape(-1, 3)
    expected, unsure = np.zeros(depth.size, np.int64), np.zeros(depth.size, bool)
    for k in range(3):
        x, y, ahead = seen_at(points, T[k])
        # Half a pixel from a border either side is right.
        unsure |= (np.abs(x - np.floor(x) - 0.5) < 1e-6) | (np.abs(y - np.floor(y) - 0.5) < 1e-6)
        column, row = np.floor(x + 0.5).astype(int), np.floor(y + 0.5).astype(int)
        inside = (depth.ravel() > 0) & (ahead >= NEAREST_M) & (x >= -0.5) & (y >= -0.5)
        inside &= (column < SHAPE[1]) & (row < SHAPE[0])
        behind = np.where(inside, references[k][np.where(inside, row, 0), np.where(inside, column, 0)], 0.0)
        expected |= np.where(behind - ahead > error_m[k] + JUMP_SIGMAS * NOISE * behind**2, 1 << k, 0) * inside
    assert (freed.ravel() == expected)[~unsure].all()
    assert expected.any()


def test_marks_grow_over_their_surface_and_not_beyond_its_end() -> None:
    depth = np.full((5, 9), 1.0, np.float32)
    depth[:, 5:], depth[2, 3] = 1.5, 0.0
    marked = np.zeros((5, 9), np.uint8)
    marked[2, 4] = marked[0, 0] = 1
    out = marked.copy()
    grow(depth, marked, 0.01, NOISE, out)
    expected = marked.copy()
    expected[1, 4] = expected[3, 4] = expected[0, 1] = expected[1, 0] = 1
    assert (out == expected).all()


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_a_point_is_in_its_place_or_passed_as_the_readings_around_it_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth = np.where(rng.random(SHAPE) < 0.7, np.float32(2.0), any_depth(rng))
    points, T = rng.uniform([-0.8, -0.6, 0.5], [0.8, 0.6, 2.1], (200, 3)).astype(np.float32), any_pose(rng)
    x, y, z = seen_at(points, T)
    column, row = np.rint(x).astype(int), np.rint(y).astype(int)
    in_place = passed = 0
    for u, v, ahead in zip(column, row, z, strict=True):
        if ahead < NEAREST_M or not (1 <= u < SHAPE[1] - 1 and 1 <= v < SHAPE[0] - 1):
            continue
        within = WITHIN_M + JUMP_SIGMAS * NOISE * ahead**2
        if depth[v, u] > 0 and abs(depth[v, u] - ahead) <= within:
            in_place += 1
        elif (depth[v - 1 : v + 2, u - 1 : u + 2] > ahead + within).all():
            passed += 1
    assert count_passed(points, depth, CAMERA, T, WITHIN_M, NOISE) == (in_place, passed)


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_a_shifted_cluster_agrees_where_depth_and_color_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth, color = any_depth(rng), rng.integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
    points = rng.uniform([-0.5, -0.4, 0.8], [0.5, 0.4, 2.0], (150, 3)).astype(np.float32)
    normals, T = rng.normal(size=(150, 3)).astype(np.float32), any_pose(rng)
    shifts, colors = rng.uniform(-0.1, 0.1, (4, 3)), rng.integers(0, 256, (150, 3)).astype(np.uint8)
    counts = np.empty((4, 3), np.int64)
    score_shifts(points, normals, colors, shifts, (depth, color), CAMERA, T, 0.2, NOISE, MAX_COLOR_DIFFERENCE, counts)
    for shift, found in zip(shifts, counts, strict=True):
        moved = points.astype(np.float64) + shift
        x, y, z = seen_at(moved, T)
        facing = ((moved @ T[:3, :3].T + T[:3, 3]) * (normals.astype(np.float64) @ T[:3, :3].T)).sum(1) <= 0
        u, v = np.rint(x).astype(int), np.rint(y).astype(int)
        shown = facing & (z >= NEAREST_M) & (u >= 0) & (v >= 0) & (u < SHAPE[1]) & (v < SHAPE[0])
        u, v = np.where(shown, u, 0), np.where(shown, v, 0)
        reading, within = depth[v, u], 0.2 + JUMP_SIGMAS * NOISE * z**2
        alike = (np.abs(color[v, u].astype(int) - colors) <= MAX_COLOR_DIFFERENCE).all(1)
        agree = shown & (reading > 0) & (np.abs(reading - z) <= within) & alike
        assert found.tolist() == [agree.sum(), (shown & (reading > z + within)).sum(), shown.sum()]


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_a_reading_is_unseen_where_every_reference_misses_it_or_hides_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth, references = any_depth(rng), np.array([any_depth(rng) for _ in range(2)])
    T, error_m = np.array([any_pose(rng) for _ in range(2)]), 0.03
    unseen = np.empty(SHAPE, np.uint8)
    mark_unseen(depth, CAMERA, references, T, error_m, NOISE, unseen)

    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    z = depth.astype(np.float64)
    points = np.stack([(u - CAMERA[2]) / CAMERA[0] * z, (v - CAMERA[3]) / CAMERA[1] * z, z], -1).reshape(-1, 3)
    expected, unsure = depth.ravel() > 0, np.zeros(depth.size, bool)
    for reference, T_reference in zip(references, T, strict=True):
        column, row, there = seen_at(points, T_reference)
        x, y = np.floor(column + 0.5).astype(int), np.floor(row + 0.5).astype(int)
        inside = (there >= NEAREST_M) & (x >= 0) & (y >= 0) & (x < SHAPE[1]) & (y < SHAPE[0])
        farthest = np.where(inside, reference[np.clip(y, 0, SHAPE[0] - 1), np.clip(x, 0, SHAPE[1] - 1)], 0.0)
        beyond = there - farthest - (error_m + JUMP_SIGMAS * NOISE * there**2)
        expected &= ~(inside & (beyond <= 0.0))
        near_edge = (np.abs(column + 0.5 - np.rint(column + 0.5)) < 1e-6) | (
            np.abs(row + 0.5 - np.rint(row + 0.5)) < 1e-6
        )
        unsure |= near_edge | (np.abs(beyond) < 1e-6)
    np.testing.assert_array_equal(unseen.ravel()[~unsure], expected[~unsure])


def test_marks_spread_over_a_surface_as_far_as_allowed_and_over_no_jump() -> None:
    depth = np.full((6, 12), 1.0, np.float32)
    depth[:, 8:] = 1.5
    depth[0] = 0.0
    marked, allowed = np.zeros(depth.shape, np.uint8), np.ones(depth.shape, np.uint8)
    marked[3, 1] = 1
    allowed[:, 5] = 0
    allowed[4, 5] = 1
    spread(depth, marked, allowed, 0.005, NOISE)
    expected = np.zeros(depth.shape, np.uint8)
    expected[1:, :8] = allowed[1:, :8]
    np.testing.assert_array_equal(marked, expected)
