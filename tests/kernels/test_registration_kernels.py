from __future__ import annotations

import cv2
import numpy as np
import pytest

from cuboid.inputs.readers.kernels.registration import (
    COVERS_PX,
    NEAREST_COLOR_M,
    NOISE_PER_M,
    STEEPEST,
    project_depth,
    splat_depth,
)

DEPTH_K = np.array([70.0, 71.0, 31.0, 24.0])
SHAPE = (48, 64)
PIXEL = 1 / 70.0
# Bits of a NaN that warns when it is read: nothing that the kernels leave unwritten is read unnoticed.
SIGNALLING = 0x7FA00000


def rays():
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    fx, fy, cx, cy = DEPTH_K
    return np.stack([(u - cx) / fx, (v - cy) / fy], -1).astype(np.float32)


def transform(turn, move):
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array(turn, np.float64))[0]
    T[:3, 3] = move
    return T


def footprint(T, K):
    steps = [np.gradient(rays().astype(np.float64), axis=axis) @ (T[:2, :2] * K[:2, None]).T for axis in (1, 0)]
    return np.concatenate(steps, axis=2).astype(np.float32)


def a_scene(rng):
    """A tilted wall with noise and holes, and a box before it."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    depth = (1.6 + 0.004 * u + 0.003 * v + rng.normal(0, 0.001, SHAPE)).astype(np.float32)
    depth[14:34, 20:40] = 0.8 + rng.normal(0, 0.001, (20, 20))
    depth[rng.random(SHAPE) < 0.03] = 0
    return depth


def projected(depth, T, K):
    """The truth of `project_depth`: each reading as a point, moved, seen."""
    points = np.concatenate([rays() * depth[..., None], depth[..., None]], axis=2).astype(np.float64)
    moved = points @ T[:3, :3].T + T[:3, 3]
    seen = (depth > 0) & (moved[..., 2] > NEAREST_COLOR_M)
    z = np.where(seen, moved[..., 2], 1)
    return np.stack([K[0] * moved[..., 0] / z + K[2], K[1] * moved[..., 1] / z + K[3], np.where(seen, z, 0)], -1)


def drawn(uvz, steps, shape):
    """The truth of `splat_depth`: each reading asked about each pixel of the color image."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    out, offset = np.zeros(shape), np.full(shape, np.inf)
    for r, c in zip(*np.nonzero(uvz[..., 2] > 0), strict=True):
        u, v, z = uvz[r, c]
        same = STEEPEST * PIXEL * z + NOISE_PER_M * z * z

        def step(dr, dc, r=r, c=c, z=z, same=same):
            """To a neighbour on the same surface, in column, row and depth of the color image; else None."""
            inside = 0 <= r + dr < uvz.shape[0] and 0 <= c + dc < uvz.shape[1]
            if not inside or uvz[r + dr, c + dc, 2] <= 0 or abs(uvz[r + dr, c + dc, 2] - z) > same:
                return None
            return uvz[r + dr, c + dc] - uvz[r, c]

        right, left, down, up = step(0, 1), step(0, -1), step(1, 0), step(-1, 0)
        a = right[:2] if right is not None else -left[:2] if left is not None else steps[r, c, :2]
        b = down[:2] if down is not None else -up[:2] if up is not None else steps[r, c, 2:]
        place = np.linalg.solve(np.column_stack([a, b]), np.stack([columns - u, rows - v]).reshape(2, -1))
        dc, dr = place.reshape(2, *shape)
        ahead, behind, below, above = (0.0 if one is None else one[2] for one in (right, left, down, up))
        depth = z + np.where(dc > 0, dc * ahead, -dc * behind) + np.where(dr > 0, dr * below, -dr * above)
        away = dc**2 + dr**2
        covers = (np.abs(dc) <= COVERS_PX) & (np.abs(dr) <= COVERS_PX)
        wins = (out == 0) | (depth < out - same) | ((depth <= out + same) & (away < offset))
        out[covers & wins], offset[covers & wins] = depth[covers & wins], away[covers & wins]
    return out


def registered(depth, T, K, shape):
    uvz, out, offset = (np.full(size, SIGNALLING, np.uint32).view(np.float32) for size in ((*SHAPE, 3), shape, shape))
    project_depth(depth, rays(), T, K, uvz)
    splat_depth(uvz, footprint(T, K), PIXEL, offset, out)
    return uvz, out


CAMERAS = [
    (transform((0, 0, 0), (-0.03, 0.0, 0.0)), np.array([60.0, 60.0, 31.5, 23.5]), (48, 64)),
    (transform((0.02, -0.03, 0.01), (0.03, 0.01, 0.002)), np.array([150.0, 150.0, 80.0, 60.0]), (120, 160)),
    (transform((0, 0, 1.6), (0.0, 0.02, 0.0)), np.array([60.0, 60.0, 24.0, 31.5]), (64, 48)),
    (transform((0.1, 0, 0), (0.0, 0.02, 0.0)), np.array([30.0, 30.0, 15.5, 11.5]), (24, 32)),
]


@pytest.mark.parametrize(("T", "K", "shape"), CAMERAS, ids=["alike", "finer", "rolled", "coarser"])
def test_the_kernels_equal_the_truth(T, K, shape):
    depth = a_scene(np.random.default_rng(1))
    uvz, out = registered(depth, T, K, shape)
    expected = projected(depth, T, K)
    np.testing.assert_allclose(uvz[..., 2], expected[..., 2], atol=1e-5)
    there = expected[..., 2] > 0
    np.testing.assert_allclose(uvz[there], expected[there], atol=2e-3)
    truth = drawn(uvz.astype(np.float64), footprint(T, K).astype(np.float64), shape)
    alike = np.isclose(out, truth, atol=1e-4)
    assert alike.mean() > 0.998  # what rounding decides: a pixel on the edge of a footprint, or as near to two


@pytest.mark.parametrize(("T", "K", "shape"), CAMERAS, ids=["alike", "finer", "rolled", "coarser"])
def test_a_wall_stays_whole_and_in_its_place(T, K, shape):
    normal, distance = np.array([0.1, -0.2, 1.0]), 1.5
    ray = np.concatenate([rays(), np.ones((*SHAPE, 1), np.float32)], axis=2)
    _, out = registered((distance / (ray @ normal)).astype(np.float32), T, K, shape)
    v, u = np.mgrid[: shape[0], : shape[1]]
    seen = np.stack([(u - K[2]) / K[0], (v - K[3]) / K[1], np.ones(shape)], -1)
    moved = T[:3, :3] @ normal
    expected = (distance + moved @ T[:3, 3]) / (seen @ moved)
    filled = out > 0
    assert filled.mean() > 0.5
    assert np.abs(out - expected)[filled].max() < 5e-3  # at the border a reading is flat for half a pixel
    for row in filled:  # what the depth camera sees is convex here: no holes
        places = np.flatnonzero(row)
        assert len(places) == 0 or (np.diff(places) == 1).all()


def test_what_stands_before_hides_what_lies_behind():
    depth = np.full(SHAPE, 2.0, np.float32)
    depth[10:38, 20:44] = 0.5
    T, K, shape = transform((0, 0, 0), (-0.06, 0, 0)), np.array([140.0, 142.0, 63.0, 48.0]), (96, 128)
    uvz, out = registered(depth, T, K, shape)
    front = uvz[10:38, 20:44].reshape(-1, 3)
    (left, top), (right, bottom) = front[:, :2].min(0), front[:, :2].max(0)
    box = out[int(np.ceil(top)) : int(bottom) + 1, int(np.ceil(left)) : int(right) + 1]
    assert (box == 0.5).all()  # though readings of the wall fall between its own
    beside = out[30:60, int(right) + 3 : int(right) + 10]
    assert (beside == 0).all()  # the wall there was hidden from the depth camera: no reading, nothing made up
    assert set(np.unique(out)) == {0.0, 0.5, 2.0}
