from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from cuboid.kernels.pieces import (
    drop_unread,
    gather_regions,
    join_surfaces,
    drop_filled,
    label_regions,
    sum_regions,
)
from cuboid.kernels.pixels import drop_mixed, stand_on
from cuboid.tolerances import JUMP_SIGMAS

CAMERA = np.array([50.0, 50.0, 31.5, 23.5])


def test_a_reading_that_hangs_between_two_surfaces_goes() -> None:
    depth = np.full((5, 7), 1.0, np.float32)
    depth[:, 4:] = 2.0
    depth[2, 3] = 1.5
    out = np.empty_like(depth)
    drop_mixed(depth, 0.014, out)
    assert out[2, 3] == 0
    out[2, 3] = depth[2, 3]
    np.testing.assert_array_equal(out, depth)


def test_an_edge_and_a_slope_stay() -> None:
    depth = np.tile(np.linspace(1.0, 1.06, 7, dtype=np.float32), (5, 1))
    depth[:, 4:] += 1.0
    out = np.empty_like(depth)
    drop_mixed(depth, 0.014, out)
    np.testing.assert_array_equal(out, depth)


def regions_by_scipy(depth: np.ndarray, share: np.ndarray, noise: float, jump: float) -> np.ndarray:
    h, w = depth.shape
    pairs = []
    for v in range(h):
        for u in range(w):
            for dv, du in ((-1, -1), (-1, 0), (-1, 1), (0, -1)):
                y, x = v + dv, u + du
                if y >= 0 and 0 <= x < w and share[v, u] >= 0 and share[v, u] == share[y, x]:
                    z = float(depth[v, u])
                    if abs(float(depth[y, x]) - z) < jump + JUMP_SIGMAS * noise * z * z:
                        pairs.append((v * w + u, y * w + x))
    i, j = np.array(pairs).T
    graph = coo_matrix((np.ones(len(i)), (i, j)), (h * w, h * w))
    return connected_components(graph, directed=False)[1].reshape(h, w)


def test_regions_are_those_of_a_graph_search() -> None:
    rng = np.random.default_rng(2)
    depth = rng.choice([1.0, 1.005, 1.1, 2.0], (30, 40)).astype(np.float32)
    share = np.repeat(np.arange(2, dtype=np.int32), 20)[None].repeat(30, 0)  # two of them, side by side
    share[rng.random(depth.shape) > 0.7] = -1
    labels, parent = np.empty(depth.shape, np.int32), np.empty(depth.size, np.int32)
    number = label_regions(depth, share, 1.4e-3, 0.01, parent, labels)
    truth = regions_by_scipy(depth, share, 1.4e-3, 0.01)
    inside = share >= 0
    assert (labels[~inside] == 0).all()
    assert number == len(np.unique(truth[inside]))
    assert len(set(zip(labels[inside].tolist(), truth[inside].tolist(), strict=True))) == number
    first = [np.flatnonzero(labels.ravel() == k)[0] for k in range(1, number + 1)]
    assert (np.diff(first) > 0).all()


def test_the_inside_and_the_outside_of_a_mug_are_one_thing_and_what_is_behind_is_not() -> None:
    share, depth = np.full((20, 30), -1, np.int32), np.zeros((20, 30), np.float32)
    share[4:16, 5:15], depth[4:16, 5:15] = 0, 1.0
    depth[4:9, 5:15] = 1.06  # its inside, as deep again as 12 pixels at 1 m are long, halved: 6 cm
    share[4:16, 15:17], depth[4:16, 15:17] = 0, 1.05  # a sliver
    share[4:16, 20:28], depth[4:16, 20:28] = 1, 1.0  # another share
    labels, parent = np.empty(share.shape, np.int32), np.empty(share.size, np.int32)
    number = label_regions(depth, share, 1e-3, 0.005, parent, labels)
    assert number == 4
    inside, outside, sliver, other = labels[5, 6], labels[12, 6], labels[12, 16], labels[12, 24]
    for deep, joined in ((0.4, False), (0.6, True)):
        after = labels.copy()
        join_surfaces(after, number, share, depth, 100.0, 0.4, deep)
        assert after[5, 6] == (outside if joined else inside)
        assert (after[12, 6], after[12, 16], after[12, 24], after[0, 0]) == (outside, sliver, other, 0)
    none = np.zeros_like(labels)
    join_surfaces(none, 0, np.full_like(share, -1), depth, 100.0, 0.4, 0.5)
    assert not none.any()


def test_regions_are_gathered_as_array_operations_do_it() -> None:
    rng = np.random.default_rng(3)
    labels = rng.integers(0, 6, (24, 40)).astype(np.int32)
    labels[labels == 3] = 0
    labels[5, 7:10] = 3  # too small
    labels[20:, 20:] = 6
    depth = rng.uniform(0.5, 2.0, labels.shape).astype(np.float32)
    first, pixels, points = np.empty(7, np.int64), np.empty(labels.size, np.int64), np.empty((labels.size, 3))
    corners, claim = np.empty((6, 4), np.int64), np.empty_like(labels)
    T = np.array([[1.0, 0, 0, 5], [0, 0, 1, 6], [0, -1, 0, 7], [0, 0, 0, 1]])
    kept = gather_regions(labels, 6, 4, depth, CAMERA, T, first, pixels, points, corners, claim)
    numbers = [1, 2, 4, 5, 6]
    assert kept == len(numbers)
    np.testing.assert_array_equal(claim, np.array([-1, 0, 1, -1, 2, 3, 4])[labels])
    assert first[kept] == (labels > 0).sum() - 3
    for k, number in enumerate(numbers):
        own = slice(first[k], first[k + 1])
        v, u = np.nonzero(labels == number)
        np.testing.assert_array_equal(pixels[own], v * 40 + u)
        z = depth[v, u].astype(float)
        seen = np.column_stack([(u - CAMERA[2]) / CAMERA[0] * z, (v - CAMERA[3]) / CAMERA[1] * z, z])
        np.testing.assert_allclose(points[own], seen @ T[:3, :3].T + T[:3, 3], atol=1e-12)
        assert corners[k].tolist() == [u.min(), v.min(), u.max(), v.max()]
    heat = rng.random(labels.shape).astype(np.float32)
    support = rng.integers(-1, 3, labels.shape).astype(np.int32)
    warmth, beneath = np.empty(kept), np.empty((kept, 3), np.int64)
    sum_regions(first[: kept + 1], pixels, heat, support, warmth, beneath)
    for k, number in enumerate(numbers):
        own = labels == number
        assert warmth[k] == pytest.approx(heat[own].sum(dtype=float))
        assert beneath[k].tolist() == [(support[own] == p).sum() for p in range(3)]


def test_what_is_beneath_is_the_highest_plane() -> None:
    """A camera looks straight down from 2 m: floor at 0, a table top at 0.7 m in one half, a box of 0.2 m on each."""
    depth = np.full((48, 64), 2.0, np.float32)
    depth[:, 32:] = 1.3
    depth[10:20, 5:15] = 1.8
    depth[10:20, 45:55] = 1.1
    T_plan_camera = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2.0], [0, 0, 0, 1]])
    planes = np.array([[0, 0, -1.0, 2.0], [0, 0, -1.0, 1.3]])
    ground = np.ones((2, 80, 80), np.uint8)
    ground[1, :40] = 0  # plan x < 0 is beyond the table's rim
    on_plane, support = np.empty(depth.shape, np.int32), np.empty(depth.shape, np.int32)
    seen = np.zeros((2, 80, 80), np.int32)
    numbers = np.array([200, 40000], np.int32)
    patches = np.full((6, 8), 200, np.int32)
    patches[:, 4:] = 40000
    stand_on(
        depth, CAMERA, T_plan_camera, planes, numbers, ground, np.array([-2.0, -2.0]), 0.05, patches, 8,
        1.4e-3, 0.01, 0.005, 4.0, on_plane, support, seen,
    )  # fmt: skip
    on_floor, on_table = depth == 2.0, depth == np.float32(1.3)
    np.testing.assert_array_equal(on_plane, np.where(on_floor, 0, np.where(on_table, 1, -1)))
    np.testing.assert_array_equal(support, np.repeat([0, 1], 32)[None].repeat(48, 0))
    assert seen[0].sum() == on_floor.sum()
    assert seen[1].sum() == on_table.sum()


def test_regions_with_too_few_readings_go_and_readings_come_first() -> None:
    rng = np.random.default_rng(7)
    labels = rng.integers(0, 5, (12, 20)).astype(np.int32)
    readings = np.where(rng.random(labels.shape) < 0.5, 1.0, 0.0).astype(np.float32)
    readings[labels == 2] = 0.0
    before, sizes = labels.copy(), np.empty(6, np.int64)
    drop_unread(labels, readings, 8, sizes)
    np.testing.assert_array_equal(labels, np.where(before == 2, 0, before))
    assert sizes.tolist() == [(before == 0).sum(), *((labels == k).sum() for k in range(1, 6))]
    pixels = np.concatenate([np.flatnonzero(labels == k) for k in (1, 3, 4)])
    first, points = np.cumsum([0, *sizes[[1, 3, 4]]]), np.repeat(pixels[:, None], 3, axis=1).astype(float)
    own = np.empty(3, np.int64)
    drop_filled(first, pixels, points, readings, own)
    for k, number in enumerate((1, 3, 4)):
        kept = np.flatnonzero((labels == number) & (readings > 0))
        np.testing.assert_array_equal(pixels[first[k] : own[k]], kept)
        np.testing.assert_array_equal(points[first[k] : own[k], 2], kept)
