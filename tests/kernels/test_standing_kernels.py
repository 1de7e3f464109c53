"""Pieces of surface that rise from flat areas: numbered, listed and classified as plain loops over pixels do it."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cuboid.ground.core.tolerances import JUMP_SIGMAS, SIGMAS
from cuboid.method.surfaces.kernels import standing as kernel

CAMERA = np.array([30.0, 32.0, 11.5, 8.5])
SHAPE = (18, 24)
NOISE, JUMP_M, REACH = 1.4e-3, 0.02, 3.0
STEPS = [(1, 0), (-1, 0), (0, 1), (0, -1)]


def any_image(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Depth of a few levels with holes, and codes of three planes, surface and nothing."""
    blocks = rng.integers(0, 3, (6, 8)).repeat(3, 0).repeat(3, 1)
    depth = (1.0 + 0.3 * blocks + rng.normal(0.0, 0.01, SHAPE)).astype(np.float32)
    depth[rng.random(SHAPE) < 0.1] = 0.0
    on = rng.choice([0, 1, 2, kernel.SURFACE, kernel.SURFACE, kernel.SURFACE], (6, 8)).repeat(3, 0).repeat(3, 1)
    return depth, np.where(depth > 0.0, on, kernel.NOTHING).astype(np.int8)


def numbered(depth: np.ndarray, on: np.ndarray) -> tuple[int, np.ndarray]:
    labels, pixels = np.empty(SHAPE, np.int32), np.empty((depth.size, 2), np.int32)
    return kernel.label_pieces(depth, on, NOISE, JUMP_M, labels, pixels), labels


def limit_m(z: float) -> float:
    return JUMP_M + JUMP_SIGMAS * NOISE * z * z


def inside(v: int, u: int) -> bool:
    return 0 <= v < SHAPE[0] and 0 <= u < SHAPE[1]


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_pieces_are_what_steps_without_a_jump_reach(seed: int) -> None:
    depth, on = any_image(np.random.default_rng(seed))
    count, labels = numbered(depth, on)
    expected = np.full(SHAPE, -1)
    pieces = 0
    for start in zip(*np.nonzero(on == kernel.SURFACE), strict=True):
        if expected[start] >= 0:
            continue
        expected[start], rest = pieces, [start]
        while rest:
            v, u = rest.pop()
            for dv, du in STEPS:
                there = v + dv, u + du
                if not inside(*there) or on[there] != kernel.SURFACE or expected[there] >= 0:
                    continue
                if abs(depth[there] - depth[v, u]) <= limit_m(float(depth[v, u])):
                    expected[there] = pieces
                    rest.append(there)
        pieces += 1
    assert count == pieces
    assert (labels == expected).all()


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_the_pixels_of_each_piece_are_listed_in_the_order_of_the_image(seed: int) -> None:
    count, labels = numbered(*any_image(np.random.default_rng(seed)))
    starts, pixels = np.empty(count + 1, np.int64), np.empty((labels.size, 2), np.int32)
    kernel.gather_pieces(labels, starts, pixels)
    assert starts[0] == 0
    for k in range(count):
        assert pixels[starts[k] : starts[k + 1]].tolist() == np.argwhere(labels == k).tolist()


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_the_first_reading_outwards_decides_what_borders_on_a_piece(seed: int) -> None:
    depth, on = any_image(np.random.default_rng(seed))
    count, labels = numbered(depth, on)
    touches, others = np.empty((count, 3), np.int64), np.empty((count, kernel.KINDS), np.int64)
    groups = np.empty(count, np.int64)
    kernel.bounds(depth, on, labels, NOISE, JUMP_M, REACH, touches, others, groups)
    joined = list(range(count))
    expected_touches, expected_others = np.zeros_like(touches), np.zeros_like(others)
    for v, u in np.argwhere(labels >= 0).tolist():
        z, piece = float(depth[v, u]), labels[v, u]
        for dv, du in STEPS:
            for n in range(1, max(2, int(REACH / z)) + 1):
                there = v + n * dv, u + n * du
                if not inside(*there):
                    expected_others[piece, kernel.BORDER] += 1
                    break
                if depth[there] > 0.0:
                    if labels[there] == piece:
                        break
                    step = float(depth[there]) - z
                    if abs(step) > limit_m(z):
                        expected_others[piece, kernel.FREE if step > 0.0 else kernel.HIDDEN] += 1
                    elif on[there] >= 0:
                        expected_touches[piece, on[there]] += 1
                    else:
                        expected_others[piece, kernel.CONTACT] += 1
                        if labels[there] >= 0:
                            pair = {joined[piece], joined[labels[there]]}
                            joined = [min(pair) if one in pair else one for one in joined]
                    break
    assert (touches == expected_touches).all()
    assert (others == expected_others).all()
    assert groups.tolist() == joined


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_a_reading_lies_on_the_nearest_plane_within_its_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth, _ = any_image(rng)
    normals = rng.normal(0.0, 1.0, (3, 3))
    normals *= -np.sign(normals[:, 2:]) / np.linalg.norm(normals, axis=1, keepdims=True)  # towards the camera
    planes = np.column_stack([normals, rng.uniform(0.5, 1.5, 3)])
    min_height_m, bias_m, max_depth_m = 0.03, 0.01, 1.5
    on = np.empty(SHAPE, np.int8)
    kernel.lie_on(depth, CAMERA, planes, NOISE, min_height_m, bias_m, max_depth_m, on)

    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    z = depth.astype(np.float64)
    along = np.stack([(u - CAMERA[2]) / CAMERA[0], (v - CAMERA[3]) / CAMERA[1], np.ones(SHAPE)], -1) @ planes[:, :3].T
    height_m = along * z[..., None] + planes[:, 3]
    least_m = np.maximum(min_height_m, bias_m - SIGMAS * NOISE * z[..., None] ** 2 * along)
    off = np.abs(height_m) / least_m
    expected = np.where(off.min(-1) < 1.0, off.argmin(-1), kernel.SURFACE)
    expected[(depth <= 0.0) | (depth > max_depth_m)] = kernel.NOTHING
    assert (on == expected)[np.abs(off.min(-1) - 1.0) > 1e-9].all()
