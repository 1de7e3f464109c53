"""The ground plan of a plane: windows that grow, and parts that are found anew alone."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.ground.geometry import se3
from cuboid.method.surfaces.grid import CELL_M, GroundPlan


def patch(
    plan: GroundPlan,
    low: tuple[int, int],
    high: tuple[int, int],
    hole: tuple[int, int] | None = None,
    keyframe: int = 0,
) -> None:
    """Readings in all cells from low to high, but one of 3 x 3 cells."""
    readings = np.full(np.subtract(high, low) + 1, MIN_READINGS, np.int32)
    if hole is not None:
        readings[hole[0] : hole[0] + 3, hole[1] : hole[1] + 3] = 0
    plan.add(readings, np.array(low), keyframe)
    plan.refresh()


def covered(plan: GroundPlan) -> set[tuple[int, int]]:
    plan.refresh_if_late()
    return {(int(i), int(j)) for i, j in np.argwhere(plan.covered) + plan.corner}


def test_a_plane_covers_what_was_seen_a_rim_and_its_holes() -> None:
    plan = GroundPlan()
    patch(plan, (-5, 3), (14, 22), hole=(8, 8))
    cells = covered(plan)
    assert {(i, j) for i in range(-5, 15) for j in range(3, 23)} <= cells
    assert (-6, 10) in cells
    assert (-7, 10) not in cells
    assert plan.area_m2() == pytest.approx((400 - 9) * CELL_M**2)
    inside, rim, beyond, far = (np.array([[x, 0.6]]) for x in (0.1, -0.27, -0.6, -0.75))
    assert plan.covers(inside)[0]
    assert plan.covers(rim)[0]
    assert not plan.covers(beyond)[0]
    assert plan.near(beyond)[0]
    assert not plan.near(far)[0]


def test_a_window_holds_all_that_is_nearby_wherever_the_plane_grows_to() -> None:
    rng = np.random.default_rng(3)
    plan, at = GroundPlan(), np.array([0, 0])
    for _ in range(12):
        at = at + rng.integers(-9, 10, 2)
        patch(plan, tuple(at), tuple(at + 12))
    for layer in (plan.covered, plan.nearby):
        assert not layer[[0, -1]].any()
        assert not layer[:, [0, -1]].any()
    fresh = GroundPlan()
    fresh.add(plan.seen, plan.corner)
    fresh.refresh()
    assert covered(fresh) == covered(plan)


def test_a_part_found_anew_is_as_if_all_were(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    steps = [(tuple(at), tuple(at + 9)) for at in rng.integers(0, 120, (40, 2))]
    whole = GroundPlan()
    for low, high in steps:
        patch(whole, low, high, hole=(3, 3))
    monkeypatch.setattr("cuboid.method.surfaces.grid.WHOLE_CELLS", 30)
    monkeypatch.setattr("cuboid.method.surfaces.grid.AROUND_CELLS", 60)
    parts = GroundPlan()
    for low, high in steps:
        patch(parts, low, high, hole=(3, 3))
    assert covered(parts) == covered(whole)
    np.testing.assert_array_equal(parts.nearby, whole.nearby)
    assert parts.area_m2() == whole.area_m2()


def test_planes_that_touch_share_ground_and_others_do_not() -> None:
    one, two, three = GroundPlan(), GroundPlan(), GroundPlan()
    patch(one, (0, 0), (9, 9))
    patch(two, (11, 0), (20, 9))
    patch(three, (40, 0), (50, 9))
    assert one.overlaps(two)
    assert not one.overlaps(three)
    one.absorb(three)
    assert covered(one) >= covered(three)
    assert one.overlaps(three)


LEVEL = np.array([0.0, 0.0, 1.0])


def test_a_plan_moves_with_the_keyframe_that_saw_it() -> None:
    plan = GroundPlan()
    patch(plan, (0, 0), (9, 9))
    patch(plan, (20, 0), (29, 9), keyframe=1)
    before = covered(plan)
    plan.apply_correction({1: se3.exp([2.0, 0, 0, 0, 0, 0])}, LEVEL, 0.0)
    assert covered(plan) == {(i + 40 if i > 15 else i, j) for i, j in before}
    assert plan.area_m2() == pytest.approx(200 * CELL_M**2)


def test_small_motions_add_up() -> None:
    """None of them is as wide as half a cell; together they are four."""
    plan = GroundPlan()
    patch(plan, (0, 0), (9, 9))
    before = covered(plan)
    for _ in range(20):
        plan.apply_correction({0: se3.exp([CELL_M / 5, 0, 0, 0, 0, 0])}, LEVEL, 0.0)
    assert covered(plan) in ({(i + 4, j) for i, j in before}, {(i + 3, j) for i, j in before})


def test_a_plan_that_turns_again_and_again_stays_whole_and_as_large() -> None:
    plan = GroundPlan()
    patch(plan, (-20, -12), (19, 11))
    area_m2 = plan.area_m2()
    for _ in range(12):
        plan.apply_correction({0: se3.exp([0, 0, 0, 0, 0, 0.1])}, LEVEL, 0.0)
    assert plan.area_m2() == pytest.approx(area_m2, rel=0.1)
    turn = se3.exp([0, 0, 0, 0, 0, 1.2])[:2, :2]
    inner = np.stack(np.meshgrid(np.arange(-0.9, 0.9, 0.05), np.arange(-0.5, 0.5, 0.05)), -1).reshape(-1, 2)
    assert plan.covers(inner @ turn.T).all()
    assert not plan.covers(np.array([[1.2, 0.0], [0.0, 0.8]]) @ turn.T).any()


@pytest.mark.parametrize("side", [8, 60, 700])
def test_a_plan_that_moved_is_as_one_that_was_seen_there(side: int) -> None:
    """Whether the window is found anew whole or in part, and wherever it has to grow to."""
    rng = np.random.default_rng(side)
    for _ in range(8):
        plan = GroundPlan()
        points = (rng.uniform(0, side, (200, 2)) + rng.integers(-side, side, 2)) * CELL_M
        plan.begin(points, rng.uniform(0, 0.05, len(points)))
        plan.add(rng.integers(0, 4, (20, 30)).astype(np.int32), plan.corner + 20)
        step = rng.integers(-side, side, 2)
        before = {tuple(cell + plan.corner + step): plan.seen[tuple(cell)] for cell in np.argwhere(plan.seen > 0)}
        plan.apply_correction({0: se3.exp([*(step * CELL_M), 0, 0, 0, 0])}, LEVEL, 0.0)
        plan.refresh()
        after = {tuple(cell + plan.corner): plan.seen[tuple(cell)] for cell in np.argwhere(plan.seen > 0)}
        assert {cell: after[cell] for cell in before} == before
        fresh = GroundPlan()
        fresh.add(plan.seen, plan.corner)
        fresh.refresh()
        assert covered(plan) == covered(fresh)
        assert plan.area_m2() == fresh.area_m2()


def test_what_moves_beyond_the_widest_window_is_lost_and_no_fault() -> None:
    plan = GroundPlan()
    patch(plan, (0, 0), (9, 9))
    patch(plan, (0, 0), (4, 4), keyframe=1)
    plan.apply_correction({0: se3.exp([1e4, 1e4, 0, 0, 0, 0])}, LEVEL, 0.0)
    plan.refresh()
    assert plan.covered.any()
    assert plan.area_m2() == pytest.approx(25 * CELL_M**2)
