"""The things that a frame shows: shares of its pixels, parted where depth jumps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.working import WorkingImage
from cuboid.method.heatmap.pixel_heat import WeighedProposals
from cuboid.method.surfaces.frame_segments import MIN_PIXELS, FrameSegments, PixelPlanes, points_of, segment_frame
from cuboid.method.surfaces.kernels.outlines import BOTTOM, FREE, LEFT, RIGHT, SUPPORT, TOP

CAMERA = Intrinsics(60.0, 60.0, 29.5, 19.5, 60, 40)
T_WORLD_CAMERA = np.array([[1.0, 0, 0, 5], [0, 0, 1, 6], [0, -1, 0, 7], [0, 0, 0, 1]])
PLANES = np.array([3, 7])
SIDES = np.array([BOTTOM, TOP, RIGHT, LEFT])


def found(
    depth: np.ndarray,
    support: np.ndarray,
    heights: np.ndarray,
    boxes: list[tuple[int, int, int, int]],
    weights: list[float],
    prior: list[float] | None = None,
    filled: np.ndarray | None = None,
    moving: np.ndarray | None = None,
) -> FrameSegments:
    """The things of a frame whose proposals are whole boxes; `filled` are holes that were given their depth."""
    image = WorkingImage(depth.astype(np.float32), np.zeros((*depth.shape, 3), np.uint8), CAMERA, 1, (0, 0))
    read = image if filled is None else replace(image, depth_m=np.where(filled, np.float32(0), image.depth_m))
    candidate = ((depth > 0) & (heights != 0)).astype(np.uint8)
    covered = [candidate[y0:y1, x0:x1].ravel() for x0, y0, x1, y1 in boxes]
    weighed = WeighedProposals(
        np.array(boxes, np.int64),
        np.cumsum([0, *(len(one) for one in covered)]),
        np.concatenate(covered),
        np.array(weights, np.float32),
    )
    on_plane = np.where(heights == 0, support, -1).astype(np.int32)
    return segment_frame(
        Observation(0, read, image, T_WORLD_CAMERA, None, 0, True, 0.0, moving),
        PixelPlanes(on_plane, support.astype(np.int32), PLANES),
        np.full(depth.shape, 0.5, np.float32),
        weighed,
        np.array(prior or [1.0] * len(boxes)),
        SIDES,
        TrackerConfig(),
    )


def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two boxes 33 cm long, one 20 cm before the other in the picture's middle, on the second plane; a far wall."""
    depth, heights, support = np.full((40, 60), 3.0), np.full((40, 60), np.nan), np.full((40, 60), -1)
    depth[10:30, 15:30], depth[10:30, 30:45] = 1.0, 1.2
    heights[10:30, 15:45], support[10:30, 15:45] = 0.1, 1
    depth[30:], heights[30:], support[30:] = 1.0, 0.0, 1
    return depth, support, heights


def test_a_share_is_parted_where_depth_jumps() -> None:
    things = found(*scene(), [(15, 10, 45, 30)], [0.8])
    assert len(things.segments) == 2
    left, right = things.segments
    assert left.rect_xyxy.tolist() == [15, 10, 30, 30]
    assert right.rect_xyxy.tolist() == [30, 10, 45, 30]
    assert things.proposal.tolist() == [0, 0], "both are pieces of one proposal"
    assert (left.score, left.heat, left.supports) == (np.float32(0.8), 0.5, {7: 300})
    assert things.contact[0, 1] == things.contact[1, 0] == 20
    assert left.outline[BOTTOM].tolist() == [0, 15, 0, 0, 0, 0]
    assert left.outline[TOP, FREE] == 15
    assert left.outline[:, SUPPORT].sum() == 15
    assert (things.claim[10:30, 15:30] == 0).all()
    assert (things.claim >= 0).sum() == 600


def test_a_part_behind_a_depth_jump_that_is_a_proposal_too_belongs_to_that_one() -> None:
    # The first proposal covers both boxes. The third one covers the right box, the second one little of the left box.
    boxes = [(15, 10, 45, 30), (15, 10, 20, 30), (31, 10, 45, 30)]
    both = found(*scene(), boxes, [0.8, 0.5, 0.4])
    assert [one.rect_xyxy.tolist() for one in both.segments] == [[15, 10, 30, 30], [30, 10, 45, 30]]
    assert both.proposal.tolist() == [0, 2]
    assert both.segments[1].score == np.float32(0.8), "its pixels were taken by the first one"


def test_surfaces_of_one_proposal_that_are_about_as_large_and_near_are_one_thing() -> None:
    depth, support, heights = scene()
    depth[10:30, 30:45] = 1.1
    (thing,) = found(depth, support, heights, [(15, 10, 45, 30)], [0.8]).segments
    assert thing.rect_xyxy.tolist() == [15, 10, 45, 30]
    assert len(found(depth, support, heights, [(15, 10, 30, 30), (30, 10, 45, 30)], [0.8, 0.7]).segments) == 2


def test_a_part_of_a_body_that_moves_elsewhere_is_touched_and_a_thing_behind_it_is_not() -> None:
    # A hand on the left is joined to an arm, whose far end moves; the wall behind begins at a jump of depth.
    depth, support, heights = scene()
    depth[10:30, 30:45] = 1.005
    depth[10:30, 50:58], heights[10:30, 50:58], support[10:30, 50:58] = 1.2, 0.1, 1
    moving = np.zeros((40, 60), np.uint8)
    moving[10:30, 40:44] = 1
    boxes = [(15, 10, 25, 30), (25, 10, 45, 30), (50, 10, 58, 30)]
    things = found(depth, support, heights, boxes, [0.8, 0.7, 0.6], moving=moving)
    assert things.touched.tolist() == [True, True, False]
    assert not found(depth, support, heights, boxes, [0.8, 0.7, 0.6]).touched.any()


def test_a_thing_knows_how_much_of_it_was_read() -> None:
    filled = np.zeros((40, 60), bool)
    filled[10:25, 15:30] = True
    left, right = found(*scene(), [(15, 10, 30, 30), (30, 10, 45, 30)], [0.8, 0.7], filled=filled).segments
    assert (left.read, right.read) == (0.25, 1.0)
    assert len(left.pixels) == 75


def test_points_are_in_the_world() -> None:
    depth, *others = scene()
    thing = found(depth, *others, [(15, 10, 45, 30)], [0.8]).segments[0]
    image = WorkingImage(depth.astype(np.float32), np.zeros((40, 60, 3), np.uint8), CAMERA, 1, (0, 0))
    v, u = np.divmod(thing.pixels, 60)
    in_camera = np.column_stack([(u - 29.5) / 60, (v - 19.5) / 60, np.ones(len(u))])
    points = points_of(thing.pixels, image, T_WORLD_CAMERA)
    np.testing.assert_allclose(points, in_camera @ T_WORLD_CAMERA[:3, :3].T + [5, 6, 7], atol=1e-6)


def test_what_the_map_expects_wins_over_what_is_a_little_stronger() -> None:
    boxes = [(15, 10, 30, 30), (15, 10, 45, 30)]
    one = found(*scene(), boxes, [0.5, 0.6])
    assert [segment.score for segment in one.segments] == [np.float32(0.6)] * 2, "the larger one has all"
    other = found(*scene(), boxes, [0.5, 0.6], [2.0, 1.0])
    assert len(other.segments) == 1, "of the larger one too little is left"
    assert other.segments[0].rect_xyxy.tolist() == [15, 10, 30, 30]


def test_what_is_too_small_or_weighs_nothing_is_no_thing() -> None:
    depth, support, heights = scene()
    few = MIN_PIXELS - 1
    assert found(depth, support, heights, [(15, 10, 15 + few, 11)], [0.8]).segments == []
    assert found(depth, support, heights, [(15, 10, 45, 30)], [0.0]).segments == []
    nothing = found(np.zeros((40, 60)), support, heights, [(15, 10, 45, 30)], [0.8])
    assert nothing.segments == []
    assert nothing.contact.shape == (0, 0)
    assert (nothing.claim == -1).all()
