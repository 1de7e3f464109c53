"""Bodies of revolution seen from one side."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy_bodies import numpy_body

from cuboid.ground.core.tolerances import MIN_SIGMA_M, SIGMAS
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou
from cuboid.lab.synthetic.footprint import hull, smallest_rectangle
from cuboid.method.boxes.fit import fit_box
from cuboid.method.boxes.kernels import bodies
from cuboid.method.boxes.kernels import revolve as kernel
from cuboid.method.boxes.revolved import revolved

UP = np.array([0.0, 0.0, 1.0])
NOISE_M = 0.002


def side(profile: list[tuple[float, float]], seen_deg: float, towards: float, noise_m: float = NOISE_M) -> np.ndarray:
    """What is seen of a turned body, (radius, height) from the foot up: so many degrees of its side, and its top."""
    rng = np.random.default_rng(5)
    radius, height = np.array(profile).T
    h = rng.uniform(0, height[-1], 2500)
    angle = towards + np.radians(rng.uniform(-seen_deg / 2, seen_deg / 2, len(h)))
    r = np.interp(h, height, radius)
    wall = np.column_stack([r * np.cos(angle), r * np.sin(angle), h])
    lid = rng.uniform(-1, 1, (400, 2)) * radius[-1]
    lid = lid[np.hypot(*lid.T) < radius[-1]]
    cloud = np.concatenate([wall, np.column_stack([lid, np.full(len(lid), height[-1])])])
    return np.asarray(cloud + rng.normal(0, noise_m, cloud.shape))


def around(cloud: np.ndarray, noise_m: float = NOISE_M) -> Box | None:
    trust = np.ones(len(cloud))
    return revolved(fit_box(cloud, UP, 0.0, 0.008, trust), cloud, trust, (UP, 0.0), noise_m, 0.01, 0.008)


@settings(deadline=None, max_examples=20)
@given(st.floats(0.03, 0.12), st.floats(160, 300), st.floats(0, 6.28))
def test_a_can_seen_from_one_side_has_its_whole_box_to_two_millimetres(
    radius: float, seen_deg: float, towards: float
) -> None:
    box = around(side([(radius, 0.0), (radius, 0.12)], seen_deg, towards))
    assert box is not None
    np.testing.assert_allclose(box.size[:2], 2 * radius, atol=0.004)
    np.testing.assert_allclose(box.center[:2], 0.0, atol=0.002)


@pytest.mark.parametrize(
    "profile",
    [
        [(0.04, 0.0), (0.04, 0.09), (0.033, 0.1), (0.033, 0.12)],
        [(0.03, 0.0), (0.03, 0.15), (0.012, 0.2), (0.012, 0.25)],
        [(0.035, 0.0), (0.05, 0.08), (0.04, 0.15), (0.02, 0.18)],
    ],
    ids=["jar", "bottle", "vase"],
)
def test_a_turned_body_is_as_wide_as_its_widest_layer(profile: list[tuple[float, float]]) -> None:
    box = around(side(profile, 180, 1.0))
    assert box is not None
    np.testing.assert_allclose(box.size[:2], 2 * max(r for r, _ in profile), atol=0.006)
    np.testing.assert_allclose(box.center[:2], 0.0, atol=0.003)


@settings(deadline=None, max_examples=20)
@given(st.floats(0.05, 0.2), st.floats(0.6, 1.0), st.floats(0, 6.28), st.booleans())
def test_a_carton_is_no_turned_body(length: float, ratio: float, turn: float, all_round: bool) -> None:
    rng = np.random.default_rng(3)
    half = np.array([length, ratio * length]) / 2
    sides = [np.column_stack([np.full(600, s), rng.uniform(-half[1], half[1], 600)]) for s in (half[0], -half[0])]
    ends = [np.column_stack([rng.uniform(-half[0], half[0], 600), np.full(600, s)]) for s in (half[1], -half[1])]
    plan = np.concatenate([*sides, *ends] if all_round else [sides[0], ends[0]])
    c, s = np.cos(turn), np.sin(turn)
    cloud = np.column_stack([plan @ np.array([[c, s], [-s, c]]), rng.uniform(0, 0.2, len(plan))])
    assert around(cloud + rng.normal(0, NOISE_M, cloud.shape)) is None


def pinned(radius: float, long: float, wide: float, low: float, high: float, seed: int) -> np.ndarray:
    """What sticks out of a body in the direction +x, filled."""
    rng = np.random.default_rng(seed)
    count = 150
    return np.column_stack(
        [rng.uniform(radius, radius + long, count), rng.uniform(-wide, wide, count), rng.uniform(low, high, count)]
    )


def turned(cloud: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return cloud @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def true_boxes(outline: np.ndarray, height: float, angle: float) -> list[Box]:
    """The least box around an outline that is its own mirror image about +x, and that box's mirror image."""
    center, size, turn = smallest_rectangle(hull(outline))
    boxes = []
    for sign in (1.0, -1.0):
        c, s = np.cos(angle + sign * turn), np.sin(angle + sign * turn)
        place = turned(np.array([[center[0], sign * center[1], height / 2]]), angle)[0]
        boxes.append(Box(place, np.array([*size, height]), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])))
    return boxes


def disc(radius: float) -> np.ndarray:
    angle = np.radians(np.arange(0.0, 360.0, 3.0))
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


@settings(deadline=None, max_examples=20)
@given(st.floats(0.035, 0.06), st.floats(200, 330), st.floats(-0.8, 0.8), st.floats(0, 6.28), st.integers(0, 1000))
def test_of_a_mug_the_far_side_follows_from_its_axis_and_its_handle_is_in_the_box(
    radius: float, seen_deg: float, towards: float, angle: float, seed: int
) -> None:
    handle = pinned(radius, 0.028, 0.006, 0.025, 0.08, seed)
    cloud = np.concatenate([side([(radius, 0.0), (radius, 0.1)], seen_deg, towards), handle])
    box = around(turned(cloud, angle))
    assert box is not None
    true = true_boxes(np.concatenate([disc(radius), handle[:, :2]]), 0.1, angle)
    assert max(iou(box, one) for one in true) > 0.82


def test_a_handle_that_reaches_up_to_the_rim_makes_a_mug_no_wider() -> None:
    wall = side([(0.044, 0.0), (0.044, 0.084)], 240, 0.8)
    wall = wall[np.hypot(*wall[:, :2].T) > 0.035]  # it is open
    handle = np.concatenate([pinned(0.044, 0.045, 0.006, 0.03, 0.084, seed) for seed in range(3)])
    outline = np.concatenate([disc(0.044), handle[:, :2]])
    for angle in (0.0, 0.4, 2.0):
        box = around(turned(np.concatenate([wall, handle]), angle))
        assert box is not None
        assert max(iou(box, one) for one in true_boxes(outline, 0.084, angle)) > 0.85


@settings(deadline=None, max_examples=20)
@given(st.floats(0.08, 0.1), st.floats(200, 330), st.floats(-0.6, 0.6), st.floats(0, 6.28), st.integers(0, 1000))
def test_the_box_of_a_cap_lies_along_its_brim_and_has_no_second_brim(
    radius: float, seen_deg: float, towards: float, angle: float, seed: int
) -> None:
    dome = side([(radius, 0.0), (radius * 0.97, 0.05), (radius * 0.6, 0.11)], seen_deg, towards)
    rng = np.random.default_rng(seed)
    way, out = rng.uniform(-1.1, 1.1, 900), rng.uniform(0.0, 1.0, 900)
    reach = radius + 0.07 * out * np.cos(way / 1.15 * np.pi / 2) ** 0.6
    brim = np.column_stack([reach * np.cos(way), reach * np.sin(way), rng.uniform(0.01, 0.02, 900)])
    box = around(turned(np.concatenate([dome, brim]), angle))
    assert box is not None
    np.testing.assert_allclose(box.size[:2], [2 * radius + 0.065, 2 * radius], atol=0.015)
    off = np.arctan2(box.rotation[1, 0], box.rotation[0, 0]) - angle
    assert abs(np.sin(off)) < np.sin(np.radians(7))
    middle = turned(np.array([[0.035, 0.0, 0.0]]), angle)[0]
    np.testing.assert_allclose(box.center[:2], middle[:2], atol=0.015)


def test_a_pot_with_a_spout_and_a_handle_has_both_in_its_box_and_no_stray() -> None:
    spout, handle = pinned(0.065, 0.05, 0.01, 0.04, 0.09, 1), pinned(0.065, 0.035, 0.006, 0.02, 0.09, 2)
    handle[:, 0] *= -1.0
    belly = [(0.045, 0.0), (0.065, 0.05), (0.04, 0.1)]
    strays = np.array([[0.0, 0.3, 0.05], [0.1, -0.3, 0.02], [0.0, 0.2, 0.09]])
    outline = np.concatenate([disc(0.065), spout[:, :2], handle[:, :2]])
    for angle in (0.0, 0.4, 2.0):
        box = around(turned(np.concatenate([side(belly, 260, 1.3), spout, handle, strays]), angle))
        assert box is not None
        assert max(iou(box, one) for one in true_boxes(outline, 0.1, angle)) > 0.8


def test_an_angle_of_two_boards_is_no_turned_body() -> None:
    rng = np.random.default_rng(4)
    along = np.column_stack([rng.uniform(0, 0.2, 900), rng.uniform(0, 0.05, 900)])
    across = np.column_stack([rng.uniform(0, 0.05, 600), rng.uniform(0.05, 0.15, 600)])
    plan = np.concatenate([along, across])
    assert around(np.column_stack([plan, rng.uniform(0, 0.1, len(plan))])) is None


def test_too_little_of_the_turn_fixes_no_axis() -> None:
    assert around(side([(0.05, 0.0), (0.05, 0.12)], 100, 0.0)) is None


def test_the_axis_is_that_of_the_least_squares_of_the_distances() -> None:
    rng = np.random.default_rng(2)
    layer = rng.integers(0, 5, 800)
    angle = rng.uniform(0, 3.5, 800)
    r = np.array([0.05, 0.04, 0.06, 0.03, 0.05])[layer] + rng.normal(0, 0.001, 800)
    plan = np.array([0.3, -0.2]) + np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    center, radius, residual = np.empty(2), np.empty(5), np.empty(800)
    assert kernel.fit_axis(plan, layer, np.ones(800), 8, center, radius, residual)

    def robust_cost(place: np.ndarray) -> float:
        out = np.hypot(*(plan - place).T)
        usual = SIGMAS * 2.0 * MIN_SIGMA_M
        weight = 1.0 / (1.0 + (residual / usual) ** 2)
        mean = np.bincount(layer, weight * out) / np.bincount(layer, weight)
        return float((weight * (out - mean[layer]) ** 2).sum())

    steps = [np.array([dx, dy]) for dx in (-2e-4, 0, 2e-4) for dy in (-2e-4, 0, 2e-4)]
    assert robust_cost(center) <= min(robust_cost(center + step) for step in steps) + 1e-12
    np.testing.assert_allclose(radius, [0.05, 0.04, 0.06, 0.03, 0.05], atol=5e-4)
    np.testing.assert_allclose(residual, np.hypot(*(plan - center).T) - radius[layer], atol=1e-12)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10_000), st.booleans(), st.floats(0.0, 0.004), st.floats(90, 340))
def test_the_body_is_that_of_plain_numpy(seed: int, trim: bool, noise_m: float, seen_deg: float) -> None:
    rng = np.random.default_rng(seed)
    radius = float(rng.uniform(0.03, 0.1))
    cloud = side([(radius, 0.0), (radius * float(rng.uniform(0.5, 1.1)), 0.1)], seen_deg, 1.0, noise_m)[::3]
    if seed % 2:
        cloud = np.concatenate([cloud, pinned(radius, 0.04, 0.01, 0.03, 0.07, seed)])
    trust, layer = rng.uniform(0.2, 1.0, len(cloud)), np.floor((cloud[:, 2] + 0.05) / 0.01).astype(np.int64)
    plan = np.ascontiguousarray(cloud[:, :2])
    rectangle = np.array([*((plan.min(0) + plan.max(0)) / 2), 1.0, 0.0, *np.ptp(plan, axis=0)])
    center, part = np.empty(2), np.empty(len(plan), bool)
    off_m = bodies.find_body(plan, layer, trust, rectangle, NOISE_M, trim, center, part)
    axis = numpy_body(plan, layer, trust, rectangle, NOISE_M, trim)
    assert (axis is not None) == (off_m > 0.0)
    if axis is not None:
        np.testing.assert_allclose(center, axis.center, atol=1e-9)
        np.testing.assert_allclose(off_m, axis.noise_m, rtol=1e-9)
        assert (part == axis.appendage(layer, trust)).all()


@given(st.lists(st.tuples(st.integers(-9, 9), st.integers(0, 4)), min_size=1, max_size=40))
def test_half_of_the_weight_lies_below_the_weighted_median(pairs: list[tuple[int, int]]) -> None:
    values, weights = np.array(pairs, np.float64).T
    if weights.sum() > 0.0:
        found = bodies.weighted_median(values, weights)
        below = [v for v in np.unique(values) if weights[values <= v].sum() >= weights.sum() / 2]
        assert found == min(below)
