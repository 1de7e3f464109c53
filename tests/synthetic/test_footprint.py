from __future__ import annotations

import numpy as np
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from cuboid.synthetic.footprint import gap_m, hull, smallest_rectangle

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
