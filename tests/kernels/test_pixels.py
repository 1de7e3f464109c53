from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from cuboid.ground.core.kernels.pixels import PlanesInView, assign_planes, back_project, drop_mixed
from cuboid.ground.core.tolerances import JUMP_SIGMAS
from cuboid.method.surfaces.kernels.pieces import gather_regions, judge_regions, label_regions

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


def regions_by_scipy(depth: np.ndarray, fraction: np.ndarray, noise: float, jump: float) -> np.ndarray:
    h, w = depth.shape
    pairs = []
    for v in range(h):
        for u in range(w):
            for dv, du in ((-1, -1), (-1, 0), (-1, 1), (0, -1)):
                y, x = v + dv, u + du
                if y >= 0 and 0 <= x < w and fraction[v, u] >= 0 and fraction[v, u] == fraction[y, x]:
                    z = float(depth[v, u])
                    if abs(float(depth[y, x]) - z) < jump + JUMP_SIGMAS * noise * z * z:
                        pairs.append((v * w + u, y * w + x))
    i, j = np.array(pairs).T
    graph = coo_matrix((np.ones(len(i)), (i, j)), (h * w, h * w))
    return connected_components(graph, directed=False)[1].reshape(h, w)


def test_regions_are_those_of_a_graph_search() -> None:
    rng = np.random.default_rng(2)
    depth = rng.choice([1.0, 1.005, 1.1, 2.0], (30, 40)).astype(np.float32)
    fraction = np.repeat(np.arange(2, dtype=np.int32), 20)[None].repeat(30, 0)  # two of them, side by side
    fraction[rng.random(depth.shape) > 0.7] = -1
    labels, parent = np.empty(depth.shape, np.int32), np.empty(depth.size, np.int32)
    number = label_regions(depth, fraction, 1.4e-3, 0.01, parent, labels)
    truth = regions_by_scipy(depth, fraction, 1.4e-3, 0.01)
    inside = fraction >= 0
    assert (labels[~inside] == 0).all()
    assert number == len(np.unique(truth[inside]))
    assert len(set(zip(labels[inside].tolist(), truth[inside].tolist(), strict=True))) == number
    first = [np.flatnonzero(labels.ravel() == k)[0] for k in range(1, number + 1)]
    assert (np.diff(first) > 0).all()


def test_the_inside_and_the_outside_of_a_mug_are_one_thing_and_what_is_behind_is_not() -> None:
    fraction, depth = np.full((20, 30), -1, np.int32), np.zeros((20, 30), np.float32)
    fraction[4:16, 5:15], depth[4:16, 5:15] = 0, 1.0
    depth[4:9, 5:15] = 1.06  # its inside, as deep again as 12 pixels at 1 m are long, halved: 6 cm
    fraction[4:16, 15:17], depth[4:16, 15:17] = 0, 1.05  # a sliver
    fraction[4:16, 20:28], depth[4:16, 20:28] = 1, 1.0  # another share
    labels, parent = np.empty(fraction.shape, np.int32), np.empty(fraction.size, np.int32)
    number = label_regions(depth, fraction, 1e-3, 0.005, parent, labels)
    assert number == 4
    inside, outside, sliver, other = labels[5, 6], labels[12, 6], labels[12, 16], labels[12, 24]
    for deep, joined in ((0.4, False), (0.6, True)):
        after, sizes, owner = judged(labels, fraction, depth, depth, 1, deep)
        assert (owner[outside], owner[other]) == (0, 1)
        assert sizes[outside] == (120 if joined else 70)
        assert after[5, 6] == (outside if joined else inside)
        assert (after[12, 6], after[12, 16], after[12, 24], after[0, 0]) == (outside, sliver, other, 0)
    none = np.zeros_like(labels)
    after, sizes, _ = judged(none, np.full_like(fraction, -1), depth, depth, 1, 0.5)
    assert not after.any()
    assert sizes.tolist() == [0]


def judged(
    labels: np.ndarray, fraction: np.ndarray, depth: np.ndarray, readings: np.ndarray, least: int, deep: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What each pixel belongs to in the end, with sizes and shares of regions."""
    count = labels.max() + 1
    become, sizes, owner = np.empty(count, np.int32), np.empty(count, np.int64), np.empty(count, np.int64)
    judge_regions(labels, fraction, depth, readings, least, 100.0, 0.4, deep, become, sizes, owner)
    return become[labels], sizes, owner


def test_regions_with_too_few_readings_are_none() -> None:
    rng = np.random.default_rng(7)
    labels = rng.integers(0, 5, (12, 20)).astype(np.int32)
    readings = np.where(rng.random(labels.shape) < 0.5, 1.0, 0.0).astype(np.float32)
    readings[labels == 2] = 0.0
    depth = np.where(labels > 0, 1.0, 0.0).astype(np.float32)
    after, sizes, owner = judged(labels, labels - 1, depth, readings, 8, 0.5)
    np.testing.assert_array_equal(after, np.where(labels == 2, 0, labels))
    assert sizes.tolist() == [0, (labels == 1).sum(), 0, (labels == 3).sum(), (labels == 4).sum()]
    assert owner.tolist() == [-1, 0, 1, 2, 3]


def test_regions_are_gathered_as_array_operations_do_it() -> None:
    rng = np.random.default_rng(3)
    labels = rng.integers(0, 6, (24, 40)).astype(np.int32)
    labels[labels == 3] = 0
    labels[5, 7:10] = 3  # too small
    labels[20:, 20:] = 6
    labels[0, :9] = 7  # a part of the second
    become = np.array([0, 1, 2, 3, 4, 5, 6, 2], np.int32)
    whole = become[labels]
    sizes = np.bincount(whole.ravel(), minlength=8)
    readings = np.where(rng.random(labels.shape) < 0.7, 1.0, 0.0).astype(np.float32)
    heat = rng.random(labels.shape).astype(np.float32)
    support = rng.integers(-1, 3, labels.shape).astype(np.int32)
    first, pixels, corners = np.empty((8, 2), np.int64), np.empty(labels.size, np.int64), np.empty((7, 4), np.int64)
    claim, warmth, beneath = np.empty_like(labels), np.empty(7), np.empty((7, 3), np.int64)
    kept = gather_regions(
        labels, become, sizes, 4, readings, heat, support, first, pixels, corners, claim, warmth, beneath
    )
    numbers = [1, 2, 4, 5, 6]
    assert kept == len(numbers)
    np.testing.assert_array_equal(claim, np.array([-1, 0, 1, -1, 2, 3, 4])[whole])
    for k, number in enumerate(numbers):
        own = whole == number
        v, u = np.nonzero(own)
        np.testing.assert_array_equal(pixels[slice(*first[k])], np.flatnonzero(own & (readings > 0)))
        assert corners[k].tolist() == [u.min(), v.min(), u.max(), v.max()]
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
    in_view = PlanesInView(planes, numbers, ground, np.array([-2.0, -2.0]), 0.05, patches, 8)
    assign_planes(depth, CAMERA, T_plan_camera, in_view, 1.4e-3, 0.01, 0.005, 4.0, on_plane, support, seen)
    on_floor, on_table = depth == 2.0, depth == np.float32(1.3)
    np.testing.assert_array_equal(on_plane, np.where(on_floor, 0, np.where(on_table, 1, -1)))
    np.testing.assert_array_equal(support, np.repeat([0, 1], 32)[None].repeat(48, 0))
    assert seen[0].sum() == on_floor.sum()
    assert seen[1].sum() == on_table.sum()


def test_what_is_beneath_is_found_among_more_planes_than_a_word_has_bits() -> None:
    """A camera looks straight down on a slope over many small planes at all heights; plain Python does the same."""
    rng, count = np.random.default_rng(2), 70
    depth = np.linspace(1.0, 2.0, 64, dtype=np.float32)[None].repeat(48, 0)
    depth[rng.random(depth.shape) < 0.1] = 0.0
    T_plan_camera = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2.0], [0, 0, 0, 1]])
    planes = np.column_stack([np.tile([0.0, 0.0, -1.0], (count, 1)), rng.uniform(1.0, 2.0, count)])
    ground = (rng.random((count, 40, 40)) < 0.05).astype(np.uint8)
    numbers = np.sort(rng.choice(200, count, replace=False)).astype(np.int32)
    patches = rng.choice(np.append(numbers, -1), (6, 8)).astype(np.int32)
    on_plane, support = np.empty(depth.shape, np.int32), np.empty(depth.shape, np.int32)
    seen = np.zeros(ground.shape, np.int32)
    in_view = PlanesInView(planes, numbers, ground, np.array([-2.0, -2.0]), 0.1, patches, 8)
    assign_planes(depth, CAMERA, T_plan_camera, in_view, 1.4e-3, 0.01, 0.005, 4.0, on_plane, support, seen)
    expected, told = np.zeros_like(seen), []
    for v, u in np.ndindex(depth.shape):
        z = float(depth[v, u])
        x, y = (u - CAMERA[2]) / CAMERA[0] * z, -(v - CAMERA[3]) / CAMERA[1] * z
        cell = int(np.floor((x + 2.0) / 0.1)), int(np.floor((y + 2.0) / 0.1))
        height, limit = planes[:, 3] - z, max(0.01, 0.005 + 3 * 1.4e-3 * z * z)
        lies = [p for p in range(count) if z > 0 and abs(height[p]) < limit]
        on = [p for p in lies if ground[p][cell]]
        for p in lies:
            if patches[v // 8, u // 8] == numbers[p] and not any(q < p for q in on):
                expected[p][cell] += 1
        below = [p for p in range(count) if z > 0 and height[p] >= limit and ground[p][cell]]
        told.append((on[0], on[0]) if on else (-1, min(below, key=lambda p: height[p], default=-1)))
    np.testing.assert_array_equal(np.stack([on_plane.ravel(), support.ravel()], 1), told)
    np.testing.assert_array_equal(seen, expected)
    for some in (on_plane >= 0, seen > 0, support > 63):
        assert some.any()


def test_pixels_are_where_the_pinhole_and_the_pose_put_them() -> None:
    rng = np.random.default_rng(3)
    depth, camera = rng.uniform(0.5, 3.0, (12, 17)).astype(np.float32), np.array([20.0, 21.0, 8.2, 5.9])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)
    pixels = rng.permutation(depth.size)[:50]
    places = np.empty((50, 3))
    back_project(pixels, depth, camera, T, places)
    v, u = np.divmod(pixels, 17)
    rays = np.stack([(u - camera[2]) / camera[0], (v - camera[3]) / camera[1], np.ones(50)], axis=1)
    np.testing.assert_allclose(places, rays * depth[v, u][:, None] @ T[:3, :3].T + T[:3, 3], atol=1e-12)
