from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Polygon

from cuboid.ground.geometry.box import CORNER_SIGNS, EDGES, Box
from cuboid.ground.geometry.overlap import (
    intersection_matrix,
    iou,
    iou_matrix,
    overlap_min_matrix,
    pack,
    paper_iou_matrix,
    unpack,
)

I3 = np.eye(3)
seeds = st.integers(0, 2**31)


def rotation(rng: np.random.Generator) -> np.ndarray:
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q))


def random_box(rng: np.random.Generator, upright: bool = False) -> Box:
    R = rotation(rng)
    if upright:
        c, s = np.cos(rng.uniform(0, 7)), np.sin(rng.uniform(0, 7))
        norm = np.hypot(c, s)
        R = np.array([[c, -s, 0], [s, c, 0], [0, 0, norm]]) / norm
    return Box(rng.uniform(-0.5, 0.5, 3), rng.uniform(0.2, 1.2, 3), R)


def box(center: tuple[float, float, float], size: tuple[float, float, float] = (1, 1, 1), R: np.ndarray = I3) -> Box:
    return Box(np.array(center, float), np.array(size, float), R)


def volume(a: Box, b: Box) -> float:
    return float(intersection_matrix(pack([a]), pack([b]))[0, 0])


def footprint(b: Box) -> Polygon:
    corners = [
        b.center + b.rotation @ (b.size / 2 * np.array([x, y, 0])) for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1))
    ]
    return Polygon([p[:2] for p in corners])


@given(seeds)
def test_symmetric_between_0_and_1_and_1_for_itself(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_box(rng), random_box(rng)
    assert iou(a, b) == pytest.approx(iou(b, a), abs=1e-9)
    assert 0 <= iou(a, b) <= 1
    assert iou(a, a) == pytest.approx(1, abs=1e-9)
    turned = Box(a.center, a.size[[1, 0, 2]], np.column_stack([a.rotation[:, 1], -a.rotation[:, 0], a.rotation[:, 2]]))
    assert iou(a, turned) == pytest.approx(1, abs=1e-9)


@given(seeds)
def test_a_rigid_motion_changes_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_box(rng), random_box(rng)
    R, t = rotation(rng), rng.normal(size=3) * 5
    moved = [Box(R @ x.center + t, x.size, R @ x.rotation) for x in (a, b)]
    assert iou(*moved) == pytest.approx(iou(a, b), abs=1e-7)


@given(seeds)
def test_boxes_with_common_up_are_as_shapely_has_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_box(rng, upright=True), random_box(rng, upright=True)
    low = max(a.center[2] - a.size[2] / 2, b.center[2] - b.size[2] / 2)
    high = min(a.center[2] + a.size[2] / 2, b.center[2] + b.size[2] / 2)
    expected = footprint(a).intersection(footprint(b)).area * max(0.0, high - low)
    assert volume(a, b) == pytest.approx(expected, abs=1e-9)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_tilted_boxes_are_as_monte_carlo_has_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_box(rng), random_box(rng)
    n = 200_000
    points = a.center + (rng.uniform(-0.5, 0.5, (n, 3)) * a.size) @ a.rotation.T
    inside = (np.abs((points - b.center) @ b.rotation) <= b.size / 2).all(1).mean()
    sigma = np.sqrt(max(inside * (1 - inside), 1 / n) / n) * a.volume
    assert abs(volume(a, b) - inside * a.volume) < 5 * sigma


def numpy_volume(a: Box, b: Box) -> float:
    """The readable truth: clip the solid a by b's half spaces, as the hull of its corners and cut points."""
    from scipy.optimize import linprog
    from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

    rows = []
    for x in (a, b):
        for axis in range(3):
            for sign in (-1.0, 1.0):
                n = sign * x.rotation[:, axis]
                rows.append([*n, -float(n @ x.center) - x.size[axis] / 2])
    H = np.array(rows)
    best = linprog(
        [0, 0, 0, -1], A_ub=np.column_stack([H[:, :3], np.ones(12)]), b_ub=-H[:, 3], bounds=[(None, None)] * 4
    )
    if not best.success or best.x[3] < 1e-6:
        return 0.0
    try:
        return float(ConvexHull(HalfspaceIntersection(H, best.x[:3]).intersections).volume)
    except QhullError:
        return 0.0


@settings(max_examples=60, deadline=None)
@given(seeds)
def test_the_kernel_is_the_half_space_intersection(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_box(rng), random_box(rng)
    assert volume(a, b) == pytest.approx(numpy_volume(a, b), abs=1e-6)


def test_two_unit_cubes_shifted_by_half_along_every_axis() -> None:
    a, b = box((0, 0, 0)), box((0.5, 0.5, 0.5))
    assert iou(a, b) == pytest.approx(1 / 15)
    assert iou(a, b, "paper") == pytest.approx(1 / 27)


def test_the_papers_interval_example() -> None:
    """[0, 2] and [1, 3] have 1 in common and 3 together, whatever the other axes."""
    a, b = box((1, 0, 0), (2, 1, 1)), box((2, 0, 0), (2, 1, 1))
    assert paper_iou_matrix(pack([a]), pack([b]))[0, 0] == pytest.approx(1 / 3)
    assert iou(a, b) == pytest.approx(1 / 3)


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (box((0, 0, 0)), 1.0),
        (box((0, 0, 1.0)), 0.0),  # touching faces
        (box((1.0, 1.0, 1.0)), 0.0),  # touching corners
        (box((0, 0, 0.5)), 0.5),  # coinciding sides
        (box((0.25, 0, 0), (0.5, 1, 1)), 0.5),  # three coinciding faces
        (box((0, 0, 0), (0.5, 0.5, 0.5)), 0.125),  # one inside the other
        (box((0, 0, 0), (2, 2, 2)), 1.0),
        (box((0, 0, 0), (1, 1, 0)), 0.0),  # no volume
        (box((5, 0, 0)), 0.0),
    ],
)
def test_special_positions(other: Box, expected: float) -> None:
    R = rotation(np.random.default_rng(0))
    for Q in (I3, R):
        a = box((0, 0, 0), R=Q)
        b = Box(Q @ other.center, other.size, Q @ other.rotation)
        assert volume(a, b) == pytest.approx(expected, abs=1e-8)
        assert volume(b, a) == pytest.approx(expected, abs=1e-8)
        assert np.isfinite(iou(a, b))


def test_a_cube_turned_by_45_degrees_leaves_an_octagon() -> None:
    c = np.sqrt(0.5)
    turned = box((0, 0, 0), R=np.array([[c, -c, 0], [c, c, 0], [0, 0, 1.0]]))
    assert volume(box((0, 0, 0)), turned) == pytest.approx(2 * (np.sqrt(2) - 1))


def test_a_part_inside_its_object_overlaps_it_wholly() -> None:
    fraction = overlap_min_matrix(pack([box((0.1, 0, 0), (0.2, 0.3, 0.4))]), pack([box((0, 0, 0)), box((9, 0, 0))]))
    np.testing.assert_allclose(fraction, [[1, 0]], atol=1e-9)


def test_two_boxes_without_volume_have_no_overlap() -> None:
    flat = pack([box((0, 0, 0), (0, 0, 0))])
    assert iou_matrix(flat, flat)[0, 0] == 0
    assert overlap_min_matrix(flat, flat)[0, 0] == 0


def test_pack_and_unpack() -> None:
    b = random_box(np.random.default_rng(4))
    (back,) = unpack(pack([b]))
    np.testing.assert_array_equal(back.corners(), b.corners())
    assert len(EDGES) == 12
    assert CORNER_SIGNS.shape == (8, 3)
