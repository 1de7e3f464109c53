from __future__ import annotations

import numpy as np
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from cuboid.lab.synthetic.footprint import gap_m, hull, is_round, smallest_rectangle

coordinate = st.floats(-1, 1, allow_nan=False).map(lambda x: round(x, 4))
clouds = st.lists(st.tuples(coordinate, coordinate), min_size=4, max_size=30, unique=True)


def outline_of(cloud):
    assume(shapely.MultiPoint(cloud).convex_hull.area > 1e-4)
    return hull(cloud)


@given(clouds)
def test_smallest_rectangle_holds_all_points_and_has_the_least_area(cloud):
    outline = outline_of(cloud)
    center, size, angle = smallest_rectangle(outline)
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    own = (np.array(cloud) - center) @ np.column_stack([along, across])
    assert (np.abs(own) <= size / 2 + 1e-9).all()
    assert size[0] >= size[1]
    least = shapely.MultiPoint(cloud).minimum_rotated_rectangle.area
    np.testing.assert_allclose(size.prod(), least, rtol=1e-6, atol=1e-9)


@given(clouds, clouds, st.floats(-2, 2), st.floats(-2, 2))
def test_gap_is_the_distance_of_the_outlines(first, second, x, y):
    a, b = outline_of(first), outline_of(second) + np.array([x, y])
    expected = shapely.Polygon(a).distance(shapely.Polygon(b))
    np.testing.assert_allclose(gap_m(a, b), expected, atol=1e-9)


@given(st.integers(10, 60), st.floats(0.01, 2.0), st.floats(0, 6.3))
def test_a_disc_is_round_and_what_has_a_front_is_not(corners, radius, turn):
    angle = turn + np.linspace(0, 2 * np.pi, corners, endpoint=False)
    disc = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    assert is_round(hull(disc))
    assert not is_round(hull(disc * [1.2, 1.0]))
    square = radius * np.column_stack(
        [np.cos(angle[0] + np.pi / 2 * np.arange(4)), np.sin(angle[0] + np.pi / 2 * np.arange(4))]
    )
    assert not is_round(hull(square))
