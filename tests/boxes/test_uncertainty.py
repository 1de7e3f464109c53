"""How sure the measures of a box are: by the sides that were seen, the noise, and the number of views."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.geometry.box import Box
from cuboid.method.boxes.uncertainty import EDGE_PX, UNSEEN_FRACTION, Uncertainty, uncertainty_of
from cuboid.method.objects.boxing import MAP_NOISE, usual_distance_m

BOX = Box(np.array([0.0, 0.0, 0.05]), np.array([0.2, 0.14, 0.1]), np.eye(3))
DOWN, SLANTED = np.array([[0.0, 0.0, -1.0]]), np.array([[-0.6, 0.0, -0.8]])
VOXEL_M, PIXEL_M = 0.01, 0.8 / 300.0


def grid(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> np.ndarray:
    sides = [np.arange(low, high + 1e-9, VOXEL_M / 2.0) for low, high in (x, y, z)]
    return np.stack(np.meshgrid(*sides), -1).reshape(-1, 3)


TOP = grid((-0.1, 0.1), (-0.07, 0.07), (0.1, 0.1))
END = grid((0.1, 0.1), (-0.07, 0.07), (0.0, 0.1))


def sure(
    points: np.ndarray,
    directions: np.ndarray,
    noise_m: float = 0.001,
    rests: bool = True,
    pixel_m: float = PIXEL_M,
    box: Box = BOX,
    R_world_map: np.ndarray = np.eye(3),  # noqa: B008
    level_sigma_m: tuple[float, float] = (np.nan, np.nan),
) -> Uncertainty:
    known = {"level_sigma_m": np.array(level_sigma_m), "rests": rests, "R_world_map": R_world_map}
    return uncertainty_of(box, points, directions, noise_m, 0.8, pixel_m, VOXEL_M, **known)


def test_from_above_only_the_top_is_seen_and_all_measures_are_known() -> None:
    found = sure(TOP, DOWN)
    assert found.sides_seen == ("+z",)
    assert found.size_sigma_m.min() > 0.0005
    # two edges, both outwards or both inwards
    np.testing.assert_allclose(found.size_sigma_m[:2], 2.0 * EDGE_PX * PIXEL_M, rtol=0.02)
    assert found.size_sigma_m[2] < 0.0035
    assert (found.center_sigma_m < found.size_sigma_m).all()


def test_the_error_of_an_edge_is_in_pixels() -> None:
    finer = sure(TOP, DOWN, pixel_m=PIXEL_M / 2.0)
    np.testing.assert_allclose(finer.size_sigma_m[:2], EDGE_PX * PIXEL_M, rtol=0.02)


def test_seen_obliquely_all_sides_but_the_foot_are_less_sure() -> None:
    slanted, down = sure(TOP, SLANTED).size_sigma_m, sure(TOP, DOWN).size_sigma_m
    assert (slanted[:2] > 1.2 * down[:2]).all()
    assert slanted[2] > 1.1 * down[2]


def test_a_seen_end_is_listed() -> None:
    assert sure(np.concatenate([TOP, END]), SLANTED).sides_seen == ("+x", "+z")
    # the same points without a camera on that side: no camera saw the face
    assert sure(np.concatenate([TOP, END]), DOWN).sides_seen == ("+z",)


def test_a_side_without_points_is_wide_and_not_listed() -> None:
    half = TOP[TOP[:, 0] > -0.05]
    found = sure(half, DOWN)
    assert found.size_sigma_m[0] > UNSEEN_FRACTION * 0.2
    assert found.size_sigma_m[1] < 0.008
    assert found.center_sigma_m[0] > 0.02


def test_an_unknown_support_makes_the_height_wide() -> None:
    assert sure(TOP, DOWN, rests=False).size_sigma_m[2] > 5.0 * sure(TOP, DOWN).size_sigma_m[2]


def test_noise_widens_and_views_narrow() -> None:
    points = np.concatenate([TOP, END])
    assert sure(points, SLANTED, 0.008).size_sigma_m[0] > 1.2 * sure(points, SLANTED).size_sigma_m[0]
    more = np.array([[-0.6, 0.3, -0.74], [-0.6, -0.3, -0.74], [-0.8, 0.0, -0.6], *SLANTED])
    assert sure(points, more, 0.008).size_sigma_m[2] < sure(points, SLANTED, 0.008).size_sigma_m[2]


@pytest.mark.parametrize("distance_m", [0.4, 0.9, 1.5])
def test_the_distance_follows_from_noise_that_the_readings_of_a_voxel_share(distance_m: float) -> None:
    noise_per_m, voxel_px_m = 0.0015, 0.01 * 300.0
    readings = 0.5 * (voxel_px_m / distance_m) ** 2  # of a voxel that a surface fills by half
    noise_m = MAP_NOISE * noise_per_m * distance_m**2 / np.sqrt(readings)
    assert usual_distance_m(noise_m, noise_per_m, voxel_px_m) == pytest.approx(distance_m)


def test_where_a_pixel_is_wider_than_a_voxel_each_voxel_has_one_reading() -> None:
    assert usual_distance_m(MAP_NOISE * 0.0015 * 4.0**2, 0.0015, 3.0) == pytest.approx(4.0)


def test_a_turned_map_changes_nothing_in_the_world() -> None:
    c = np.sqrt(0.5)
    turn = np.array([[c, -c, 0.0], [c, c, 0.0], [0.0, 0.0, 1.0]])
    box = Box(turn @ BOX.center, BOX.size, turn)
    turned = sure(TOP[:20] @ turn.T, DOWN, box=box, R_world_map=turn.T)
    straight = sure(TOP[:20], DOWN)
    assert turned.center_sigma_m == pytest.approx(straight.center_sigma_m)
    assert straight.center_sigma_m[0] != pytest.approx(straight.center_sigma_m[1], rel=0.1)


def test_a_side_from_the_edges_of_the_top_is_as_sure_as_these() -> None:
    found, by_depth = sure(TOP, DOWN, level_sigma_m=(0.001, np.nan)), sure(TOP, DOWN)
    assert found.size_sigma_m[0] == pytest.approx(0.001, rel=0.05)
    np.testing.assert_array_equal(found.size_sigma_m[1:], by_depth.size_sigma_m[1:])


def test_a_rounded_top_widens_length_and_width() -> None:
    rounded = TOP.copy()
    inside = np.minimum(0.1 - np.abs(TOP[:, 0]), 0.07 - np.abs(TOP[:, 1]))
    rounded[:, 2] -= np.maximum(0.0, 0.01 - inside) / 2.0
    assert (sure(rounded, DOWN).size_sigma_m[:2] > 1.2 * sure(TOP, DOWN).size_sigma_m[:2]).all()


def body(radius_m: float, height_m: float, arc_rad: float) -> tuple[Box, np.ndarray]:
    """Return the box of a can and the points of its side over an arc, and of its top."""
    turn, z = np.meshgrid(np.linspace(-arc_rad / 2.0, arc_rad / 2.0, 60), np.arange(0.002, height_m, VOXEL_M / 2.0))
    side = np.column_stack([radius_m * np.cos(turn.ravel()), radius_m * np.sin(turn.ravel()), z.ravel()])
    return Box(
        np.array([0.0, 0.0, height_m / 2.0]), np.array([2.0 * radius_m, 2.0 * radius_m, height_m]), np.eye(3)
    ), side


def test_the_hidden_half_of_a_body_of_revolution_is_known_by_its_shape() -> None:
    box, side = body(0.04, 0.12, np.pi)
    found = sure(side, np.array([[-0.8, 0.0, -0.6]]), box=box)
    assert 1.96 * found.size_sigma_m[:2].max() < 0.01
    assert found.size_sigma_m[0] == found.size_sigma_m[1]
    flat = np.column_stack(
        [np.full(200, 0.04), np.tile(np.linspace(-0.04, 0.04, 20), 10), np.repeat(np.arange(10), 20) / 90]
    )
    assert sure(flat, np.array([[-0.8, 0.0, -0.6]]), box=box).size_sigma_m[0] > 0.015, "a face is no body of revolution"
    _, narrow = body(0.04, 0.12, 0.25 * np.pi)
    assert sure(narrow, np.array([[-0.8, 0.0, -0.6]]), box=box).size_sigma_m[1] > 0.008, (
        "an eighth of a turn is too little"
    )
