from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.box import EDGES, Box
from cuboid.ground.geometry.se3 import compose, inverse, transform
from cuboid.results.views.projection import (
    FACES,
    MARGIN_PX,
    NEAR_PLANE_M,
    Wireframe,
    clip_polygon,
    clip_segments,
    may_be_in_view,
    visible_rect,
    wireframes,
)

INTRINSICS = Intrinsics(500.0, 510.0, 320.0, 240.0, 640, 480)
FRONTAL = np.eye(3)

numbers = st.floats(-1.5, 1.5)
boxes = st.builds(
    lambda c, s, q: Box(np.array(c), np.array(s), compose(np.add(q, (2, 0, 0, 0)), np.zeros(3))[:3, :3]),
    st.tuples(numbers, numbers, st.floats(-1.0, 3.0)),
    st.tuples(*[st.floats(0.02, 1.5)] * 3),
    st.tuples(*[numbers] * 4),
)


def wireframe(box: Box, T_world_camera: Float64Array, intrinsics: Intrinsics) -> Wireframe:
    return wireframes([box], T_world_camera, intrinsics)[0]


def ends_of(segments: Float64Array) -> set[tuple[int, ...]]:
    return {tuple(sorted(map(tuple, np.round(ends).astype(int).tolist()))) for ends in segments}


def test_a_box_is_drawn_where_the_pinhole_puts_it() -> None:
    T_world_camera = compose((0.9, 0.1, -0.3, 0.2), (0.4, -0.2, 0.1))
    box = Box(transform(T_world_camera, np.array([0.05, -0.03, 1.2])), np.array([0.2, 0.3, 0.1]), np.eye(3))
    wire = wireframe(box, T_world_camera, INTRINSICS)
    K = np.array([[500.0, 0, 320.0], [0, 510.0, 240.0], [0, 0, 1]])
    homogeneous = (K @ inverse(T_world_camera)[:3] @ np.column_stack((box.corners(), np.ones(8))).T).T
    pixels = homogeneous[:, :2] / homogeneous[:, 2:]
    expected = np.array([[pixels[a], pixels[b]] for a, b in EDGES])
    assert ends_of(np.concatenate((wire.front, wire.back))) == ends_of(expected)
    assert wire.depth_m == pytest.approx(1.2)


def test_the_edges_behind_are_those_of_the_three_faces_turned_away() -> None:
    # From above, left and in front of it: three faces are seen, three edges meet in the corner behind.
    box = Box(np.array([0.3, 0.3, 1.0]), np.array([0.2, 0.2, 0.2]), FRONTAL)
    wire = wireframe(box, np.eye(4), INTRINSICS)
    behind = INTRINSICS.pixels(np.array([0.4, 0.4, 1.1]))
    assert (len(wire.front), len(wire.back), len(wire.faces)) == (9, 3, 3)
    assert (np.linalg.norm(wire.back - behind, axis=2).min(axis=1) < 1e-9).all()
    assert [face for face, _ in wire.faces] == [0, 2, 4]


def test_a_box_seen_flat_has_one_face_and_a_camera_inside_sees_no_back() -> None:
    flat = wireframe(Box(np.array([0, 0, 1.0]), np.full(3, 0.2), FRONTAL), np.eye(4), INTRINSICS)
    assert (len(flat.front), len(flat.back), len(flat.faces)) == (4, 8, 1)
    inside = wireframe(Box(np.zeros(3), np.full(3, 0.8), FRONTAL), np.eye(4), INTRINSICS)
    assert len(inside.back) == len(inside.faces) == 0


@given(boxes)
@settings(max_examples=150, deadline=None)
def test_what_is_drawn_lies_in_front_of_the_camera_near_the_image_and_on_the_box(box: Box) -> None:
    wire = wireframe(box, np.eye(4), INTRINSICS)
    ends = np.concatenate((wire.front, wire.back)).reshape(-1, 2)
    outlines = [outline for _, outline in wire.faces]
    for pixels in [ends, *outlines]:
        assert np.isfinite(pixels).all()
        assert (pixels >= -MARGIN_PX - 1e-6).all()
        assert (pixels <= np.array([640, 480]) + MARGIN_PX + 1e-6).all()


@given(boxes)
@settings(max_examples=150, deadline=None)
def test_no_visible_part_of_an_edge_is_missing(box: Box) -> None:
    """Points sampled on the edges that fall into the image lie on a drawn segment."""
    wire = wireframe(box, np.eye(4), INTRINSICS)
    segments = np.concatenate((wire.front, wire.back))
    corners = box.corners()
    fractions = np.linspace(0, 1, 23)[:, None]
    points = np.concatenate([corners[a] + fractions * (corners[b] - corners[a]) for a, b in EDGES])
    points = points[points[:, 2] > NEAR_PLANE_M * 1.01]
    pixels = INTRINSICS.pixels(points)
    pixels = pixels[((pixels >= 0) & (pixels < (640, 480))).all(axis=1)]
    if len(pixels) == 0:
        return
    assert may_be_in_view([box], np.eye(4), INTRINSICS)[0]
    direction = segments[:, 1] - segments[:, 0]
    along = ((pixels[:, None] - segments[:, 0]) * direction).sum(axis=2) / np.maximum((direction**2).sum(axis=1), 1e-12)
    nearest = segments[:, 0] + np.clip(along, 0, 1)[..., None] * direction
    assert np.linalg.norm(pixels[:, None] - nearest, axis=2).min(axis=1).max() < 1e-3


def test_an_edge_through_the_near_plane_ends_there() -> None:
    planes = np.array([[0.0, 0.0, 1.0, -NEAR_PLANE_M]])
    ends = np.array([[[0.0, 0.0, -1.0], [1.0, 0.0, 1.0]], [[0, 0, -1.0], [1, 1, -0.5]], [[0, 0, 1.0], [0, 1, 1]]])
    cut = clip_segments(ends, planes)
    assert len(cut) == 2  # the one behind the camera is gone
    np.testing.assert_allclose(cut[0], [[(1 + NEAR_PLANE_M) / 2, 0, NEAR_PLANE_M], [1, 0, 1]])
    np.testing.assert_array_equal(cut[1], ends[2])


def test_a_face_through_the_near_plane_is_cut_to_its_part_in_front() -> None:
    square = np.array([[0.0, 0, -1], [0, 1, -1], [0, 1, 1], [0, 0, 1]])
    cut = clip_polygon(square, np.array([[0.0, 0.0, 1.0, 0.0]]))
    assert sorted(map(tuple, cut.tolist())) == [(0, 0, 0), (0, 0, 1), (0, 1, 0), (0, 1, 1)]
    assert len(clip_polygon(square, np.array([[0.0, 0.0, 1.0, -2.0]]))) == 0


def test_a_box_behind_the_camera_or_beside_the_image_leaves_no_trace() -> None:
    for center in ((0.0, 0.0, -1.0), (3.0, 0.0, 1.0), (0.0, -3.0, 1.0)):
        box = Box(np.array(center), np.full(3, 0.2), FRONTAL)
        assert wireframe(box, np.eye(4), INTRINSICS).rect_xyxy(INTRINSICS) is None
        assert not may_be_in_view([box], np.eye(4), INTRINSICS)[0]


def test_the_rectangle_of_a_box_is_cut_to_the_image() -> None:
    wire = wireframe(Box(np.array([-0.6, 0.0, 1.0]), np.full(3, 0.2), FRONTAL), np.eye(4), INTRINSICS)
    rect_xyxy = wire.rect_xyxy(INTRINSICS)
    assert rect_xyxy is not None
    front, back = 0.9, 1.1
    expected = [0.0, 240 - 510 * 0.1 / front, 320 - 500 * 0.5 / back, 240 + 510 * 0.1 / front]
    np.testing.assert_allclose(rect_xyxy, expected)


def test_faces_are_outlines_around_the_box() -> None:
    for corners in FACES:
        assert all(tuple(sorted((corners[i - 1], corners[i]))) in EDGES for i in range(4))


def test_boxes_together_are_drawn_as_each_alone() -> None:
    whole = Box(np.array([0.1, 0.1, 1.0]), np.full(3, 0.2), FRONTAL)
    behind = Box(np.array([0.0, 0.0, -1.0]), np.full(3, 0.2), FRONTAL)
    cut = Box(np.array([0.0, 0.3, 0.5]), np.array([0.3, 0.3, 2.0]), FRONTAL)
    together = wireframes([whole, behind, cut], np.eye(4), INTRINSICS)
    for box, wire in zip((whole, behind, cut), together, strict=True):
        alone = wireframe(box, np.eye(4), INTRINSICS)
        np.testing.assert_allclose(wire.front, alone.front, atol=1e-9)
        np.testing.assert_allclose(wire.back, alone.back, atol=1e-9)
        assert [face for face, _ in wire.faces] == [face for face, _ in alone.faces]
    assert wireframes([], np.eye(4), INTRINSICS) == []


@given(boxes)
def test_the_visible_rectangle_is_around_what_of_a_box_is_in_the_picture(box: Box) -> None:
    side = np.linspace(-0.5, 0.5, 24)
    inside = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
    points = box.center + (inside * box.size) @ box.rotation.T
    seen = INTRINSICS.pixels(points[points[:, 2] > NEAR_PLANE_M])
    seen = seen[((seen >= 0) & (seen <= (INTRINSICS.width, INTRINSICS.height))).all(axis=1)]
    rect = visible_rect(box, np.eye(4), INTRINSICS)
    if rect is None:
        assert len(seen) == 0
        return
    assert (rect[2:] > rect[:2]).all()
    assert (rect[:2] >= 0).all()
    assert (rect[2:] <= (INTRINSICS.width, INTRINSICS.height)).all()
    if len(seen):
        assert (seen.min(axis=0) >= rect[:2] - 1e-6).all()
        assert (seen.max(axis=0) <= rect[2:] + 1e-6).all()


def test_the_visible_rectangle_is_that_of_the_corners_where_all_are_in_view() -> None:
    turn = compose((0.9, 0.1, -0.3, 0.2), (0, 0, 0))[:3, :3]
    box = Box(np.array([0.1, -0.05, 1.5]), np.array([0.3, 0.2, 0.4]), turn)
    pixels = INTRINSICS.pixels(box.corners())
    rect = visible_rect(box, np.eye(4), INTRINSICS)
    assert rect == pytest.approx(np.concatenate((pixels.min(axis=0), pixels.max(axis=0))))


def test_of_a_box_that_reaches_behind_the_camera_what_is_in_view_counts() -> None:
    # A board on the floor, 0.2 m below the camera, from 1 m behind it to 2 m before: it begins where it comes into
    # view, and ends at 2 m.
    box = Box(np.array([0.0, 0.25, 0.5]), np.array([0.2, 0.1, 3.0]), FRONTAL)
    rect = visible_rect(box, np.eye(4), INTRINSICS)
    assert rect is not None
    near_m = 0.2 * INTRINSICS.fy / (INTRINSICS.height - INTRINSICS.cy)
    assert rect[3] == INTRINSICS.height
    assert rect[1] == pytest.approx(240 + 510 * 0.2 / 2.0)
    assert rect[2] - rect[0] == pytest.approx(0.2 * 500 / near_m)
    assert visible_rect(box, compose((0, 0, 1, 0), (0, 0, 4.0)), INTRINSICS) is not None  # from the other side
    assert visible_rect(Box(np.array([0, 0, -1.0]), np.full(3, 0.2), FRONTAL), np.eye(4), INTRINSICS) is None
