"""Footprints of which the camera saw a part."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy_boxes import numpy_box

from cuboid.method.boxes.fit import DIRECTIONS, box_within, fit_box, fit_boxes, plane_axes

UP = np.array([0.0, 0.0, 1.0])


def ring(radius: float, seen_deg: float, towards: float, noise_m: float = 0.0005) -> np.ndarray:
    """The side of a can, 10 cm high, over so many degrees around a direction."""
    rng = np.random.default_rng(5)
    angle = towards + np.radians(rng.uniform(-seen_deg / 2, seen_deg / 2, 3000))
    out = radius + rng.normal(0, noise_m, 3000)
    return np.column_stack([out * np.cos(angle), out * np.sin(angle), rng.uniform(0, 0.1, 3000)])


@given(st.floats(0.03, 0.15), st.floats(170, 220), st.floats(0, 6.28))
def test_a_can_seen_from_one_side_is_as_deep_as_it_is_wide(radius: float, seen_deg: float, towards: float) -> None:
    box = fit_box(ring(radius, seen_deg, towards), UP, 0.0, 0.0)
    np.testing.assert_allclose(box.size[:2], 2 * radius, rtol=0.12)
    np.testing.assert_allclose(box.center[:2], 0.0, atol=0.12 * radius)


@given(st.floats(0.03, 0.15), st.floats(0, 6.28))
def test_a_can_seen_all_round_stays_as_it_is(radius: float, towards: float) -> None:
    box = fit_box(ring(radius, 360, towards), UP, 0.0, 0.0)
    np.testing.assert_allclose(box.size[:2], 2 * radius, rtol=0.03, atol=0.003)


@given(st.floats(0.04, 0.3), st.floats(0.4, 1.0), st.floats(0, 6.28))
def test_a_carton_is_no_part_of_a_disc(length: float, ratio: float, turn: float) -> None:
    rng = np.random.default_rng(7)
    plan = rng.uniform(-0.5, 0.5, (4000, 2)) * [length, ratio * length]
    c, s = np.cos(turn), np.sin(turn)
    cloud = np.column_stack([plan @ np.array([[c, s], [-s, c]]), rng.uniform(0, 0.1, 4000)])
    box = fit_box(cloud, UP, 0.0, 0.0)
    np.testing.assert_allclose(box.size[:2], [length, ratio * length], rtol=0.08)
    np.testing.assert_allclose(box.center[:2], 0.0, atol=0.05 * length)


@given(st.floats(0.08, 0.3), st.floats(0.6, 0.9), st.floats(0, 6.28))
def test_a_carton_that_shows_two_sides_and_no_top_keeps_its_own_turn(length: float, ratio: float, turn: float) -> None:
    rng = np.random.default_rng(11)
    half = np.array([length, ratio * length]) / 2
    side = np.column_stack([np.full(700, half[0]), rng.uniform(-half[1], half[1], 700)])
    end = np.column_stack([rng.uniform(-half[0], half[0], 1000), np.full(1000, half[1])])
    plan = np.concatenate([side, end]) + rng.normal(0, 0.002, (1700, 2))
    c, s = np.cos(turn), np.sin(turn)
    cloud = np.column_stack([plan @ np.array([[c, s], [-s, c]]), rng.uniform(0, 0.2, 1700)])
    box = fit_box(cloud, UP, 0.0, 0.008)
    along = abs(float(box.rotation[:2, 0] @ [c, s]))
    assert max(along, np.sqrt(1 - min(1.0, along**2))) > np.cos(np.radians(8))
    np.testing.assert_allclose(box.center[:2], 0.0, atol=0.01)


@given(st.floats(0.03, 0.2), st.floats(0.0, 6.28), st.floats(0.5, 0.95))
def test_of_footprints_that_no_reading_tells_apart_the_one_is_taken_that_lies_along_a_direction(
    half: float, towards: float, ratio: float
) -> None:
    first, second = plane_axes(UP)
    round_one = box_within(np.full(90, -half), np.full(90, half), 0.0, 0.1, UP, towards)
    wanted = np.cos(towards) * first + np.sin(towards) * second
    along = np.abs(round_one.rotation[:, :2].T @ wanted).max()
    assert along > np.cos(np.radians(1.01))
    corner = np.abs(DIRECTIONS) @ [half, ratio * half]
    carton = box_within(-corner, corner, 0.0, 0.1, UP, towards)
    np.testing.assert_allclose(carton.size, [2 * half, 2 * ratio * half, 0.1], rtol=0.05, atol=0.002)


def clouds(kind: str, rng: np.random.Generator) -> np.ndarray:
    """Points of a carton, of a half of a can, or of a few strays."""
    if kind == "strays":
        return rng.uniform(-0.2, 0.2, (15, 3))
    if kind == "can":
        return ring(rng.uniform(0.03, 0.15), rng.uniform(90, 360), rng.uniform(0, 6.28), 0.002)[:: rng.integers(1, 20)]
    cloud = rng.uniform(-0.5, 0.5, (rng.integers(20, 800), 3)) * rng.uniform(0.03, 0.4, 3)
    # Of a carton two sides and the top show.
    nearest = (cloud / cloud.max(0)).argmax(1)
    cloud[np.arange(len(cloud)), nearest] = cloud.max(0)[nearest]
    angle = rng.uniform(0, 6.28)
    c, s = np.cos(angle), np.sin(angle)
    return cloud @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


@settings(deadline=None)
@given(
    st.integers(0, 10_000),
    st.sampled_from(["carton", "can", "strays"]),
    st.sampled_from([0.0, 0.01, 0.1]),
    st.booleans(),
    st.booleans(),
)
def test_the_compiled_fit_gives_the_box_of_the_plain_one(
    seed: int, kind: str, fraction: float, on_plane: bool, weighted: bool
) -> None:
    rng = np.random.default_rng(seed)
    cloud = clouds(kind, rng)
    normal = UP + rng.normal(0, 0.3, 3)
    normal /= np.linalg.norm(normal)
    offset = float(rng.uniform(-0.05, 0.1)) - float((cloud @ normal).min()) if on_plane else None
    weights = rng.uniform(0.2, 2.0, len(cloud)) if weighted else None
    expected, box = (fit(cloud, normal, offset, fraction, weights) for fit in (numpy_box, fit_box))
    np.testing.assert_allclose(box.size, expected.size, atol=1e-9)
    np.testing.assert_allclose(box.center, expected.center, atol=1e-9)
    np.testing.assert_allclose(box.rotation, expected.rotation, atol=1e-9)


def test_boxes_that_are_fitted_together_are_those_that_are_fitted_one_by_one() -> None:
    rng = np.random.default_rng(4)
    kinds = ["carton", "can", "strays", "carton"]
    several = [clouds(kind, rng) for kind in kinds]
    counts = [len(cloud) for cloud in several]
    planes = [(UP, 0.2), (UP, None), (np.array([0.0, -1.0, 0.0]), 0.1), (np.array([0.6, 0.0, 0.8]), None)]
    boxes = fit_boxes(np.concatenate(several), counts, planes, 0.01)
    for box, cloud, plane in zip(boxes, several, planes, strict=True):
        alone = fit_box(cloud, *plane, 0.01)
        np.testing.assert_array_equal(box.center, alone.center)
        np.testing.assert_array_equal(box.size, alone.size)
        np.testing.assert_array_equal(box.rotation, alone.rotation)
    assert fit_boxes(np.zeros((0, 3)), [], [], 0.01) == []
