"""Which points lie on which planes, against asking each plane for each point; and what it costs that they move."""

from __future__ import annotations

import time

import numpy as np
import pytest

from cuboid.config import TrackerConfig
from cuboid.geometry import se3
from cuboid.heatmap.carrying import motions_of
from cuboid.surfaces.lying import points_on
from cuboid.surfaces.plane import Plane
from cuboid.surfaces.planes import PlaneTracker

T_PLAN_WORLD = se3.exp(np.array([0, 0, 0, 0.1, -0.2, 0.3]))


def planes(rng: np.random.Generator, count: int, side_m: float) -> list[Plane]:
    made = []
    for k in range(count):
        plane = Plane(index=k, identity=k, in_use=True, weight=1.0)
        middle = rng.uniform(-1, 1, 3)
        x, y = (a.ravel() for a in np.mgrid[-side_m / 2 : side_m / 2 : 0.1, -side_m / 2 : side_m / 2 : 0.1])
        slope = rng.normal(0, 0.05, 2)
        ground = middle + np.column_stack([x, y, slope[0] * x + slope[1] * y])
        plane.add(ground, np.ones(len(ground)))
        plane.fit()
        plane.plan.begin(ground, np.full(len(ground), 0.02))
        made.append(plane)
    return made


@pytest.mark.parametrize("scattered", [False, True])
def test_points_are_on_the_planes_that_say_so(scattered: bool) -> None:
    rng = np.random.default_rng(3)
    some = planes(rng, 14, 1.2)
    points = rng.uniform(-1.8, 1.8, (30_000, 3))
    points = points if scattered else points[np.lexsort((points // 0.3).T)]
    in_world = (points @ T_PLAN_WORLD[:3, :3]).astype(np.float32)
    plan = in_world.astype(np.float64) @ T_PLAN_WORLD[:3, :3].T
    total = 0
    for plane, on in zip(some, points_on(some, in_world, T_PLAN_WORLD, 0.02), strict=True):
        np.testing.assert_array_equal(on, np.flatnonzero((np.abs(plane.height(plan)) < 0.02) & plane.plan.covers(plan)))
        total += len(on)
    assert total > 500
    assert points_on([], in_world, T_PLAN_WORLD, 0.02) == []
    assert [len(on) for on in points_on(some, in_world[:0], T_PLAN_WORLD, 0.02)] == [0] * 14


def test_more_pairs_than_points_are_all_found() -> None:
    rng = np.random.default_rng(5)
    stacked = planes(rng, 1, 1.0) * 9
    points = (np.array([stacked[0].mean]) + rng.normal(0, (0.2, 0.2, 0.001), (500, 3))) @ T_PLAN_WORLD[:3, :3]
    found = points_on(stacked, points.astype(np.float32), T_PLAN_WORLD, 0.02)
    assert len(found[0]) > 400
    assert all(np.array_equal(found[0], on) for on in found)


def test_only_planes_whose_points_move_are_moved() -> None:
    tracker, rng = PlaneTracker(TrackerConfig()), np.random.default_rng(7)
    tracker.T_plan_world = np.eye(4)
    tracker.planes = planes(rng, 2, 1.0)
    one, other = tracker.planes
    for plane, height in ((one, 0.0), (other, 0.7)):
        tracker._windows.note(plane)
        plane.mean[2] = height
        plane.fit()
    x, y = (a.ravel() for a in np.mgrid[-0.4:0.4:0.01, -0.4:0.4:0.01])
    points = np.concatenate(
        [
            np.column_stack([x + p.mean[0], y + p.mean[1], -(np.column_stack([x, y]) @ p.normal[:2]) / p.normal[2] + h])
            for p, h in ((one, 0.0), (other, 0.7))
        ]
    ).astype(np.float32)
    anchor = np.repeat(np.array([1, 2], np.uint16), len(x))
    before, readings = (other.offset, other.mean.copy()), other.plan.seen.copy()
    offset = one.offset
    tracker.carry(points, anchor, motions_of({1: se3.exp(np.array([0, 0, 0.1, 0, 0, 0]))}, anchor))
    assert one.offset == pytest.approx(offset - 0.1 * one.normal[2], abs=0.003)
    assert other.offset == before[0]
    np.testing.assert_array_equal(other.mean, before[1])
    np.testing.assert_array_equal(other.plan.seen, readings)


def test_a_correction_of_a_large_map_with_many_planes_takes_a_fraction_of_a_second() -> None:
    """360,000 points and 35 planes over one another, as a sensor gone mad sees them."""
    rng = np.random.default_rng(11)
    tracker = PlaneTracker(TrackerConfig())
    tracker.T_plan_world = np.eye(4)
    tracker.planes = planes(rng, 35, 6.0)
    for plane in tracker.planes:
        tracker._windows.note(plane)
    points = rng.uniform(-3, 3, (360_000, 3)).astype(np.float32)
    points = points[np.lexsort((points // 0.32).T)]
    anchor = rng.integers(1, 9, len(points)).astype(np.uint16)
    took_s = []
    for _ in range(4):  # the first one loads the kernels
        motions = motions_of({k: se3.exp(rng.normal(0, 0.002, 6)) for k in range(1, 9)}, anchor)
        begun_s = time.thread_time()
        tracker.carry(points, anchor, motions)
        took_s.append(time.thread_time() - begun_s)
    assert min(took_s[1:]) < 0.25, took_s
