"""Which thing of a frame is which object of the map."""

from __future__ import annotations

import numpy as np

from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import pack
from cuboid.method.heatmap.voxel_map import PixelVoxels
from cuboid.method.objects.association import Association, SegmentedFrame, associate
from cuboid.method.objects.entry import MapObject
from cuboid.method.surfaces.frame_segments import FrameSegment, FrameSegments
from cuboid.method.surfaces.kernels.outlines import KINDS

SHAPE = (20, 40)


def box(x: float, size: float = 0.2) -> Box:
    return Box(np.array([x, 0.0, 0.0]), np.full(3, size), np.eye(3))


def entry(number: int, x: float) -> MapObject:
    return MapObject(number, 0, 0, box(x))


def frame_of(claim: np.ndarray) -> FrameSegments:
    count = int(claim.max()) + 1
    segments = []
    for k in range(count):
        pixels = np.flatnonzero(claim.ravel() == k)
        outline = np.zeros((4, KINDS), np.int64)
        segments.append(FrameSegment(pixels, {}, 1.0, 1.0, np.zeros(4), outline, 1.0))
    return FrameSegments(
        segments,
        claim.astype(np.int32),
        np.zeros((count, count), np.int64),
        np.zeros((count, count)),
        np.arange(count),
        np.zeros(count, bool),
    )


def things(*columns: tuple[int, int]) -> np.ndarray:
    """Upright strips of a picture, from column to column, numbered from 0; -1 elsewhere."""
    claim = np.full(SHAPE, -1)
    for k, (first, last) in enumerate(columns):
        claim[:, first:last] = k
    return claim


def matched(
    claim: np.ndarray, boxes: list[Box], objects: list[MapObject], owner: np.ndarray, known: np.ndarray | None = None
) -> Association:
    known = np.ones(SHAPE, bool) if known is None else known
    voxels = PixelVoxels(np.zeros(SHAPE, np.int32), owner.astype(np.int32), known)
    frame = SegmentedFrame(frame_of(claim), boxes, voxels, np.ones(SHAPE, np.uint8))
    return associate(frame, objects, pack([o.box for o in objects]))


FAR = [box(90.0), box(95.0)]  # boxes that tell nothing


def test_each_thing_is_at_most_one_object_and_each_object_at_most_one_thing() -> None:
    # Both things lie in what is seen of object 4; the larger one is it.
    claim = things((0, 12), (12, 20))
    owner = np.where(np.arange(40) < 20, 4, 0) * np.ones(SHAPE, int)
    found = matched(claim, FAR, [entry(4, 0.0)], owner)
    assert found.match.tolist() == [0, -1]
    assert found.part.tolist() == [-1, 0], "what is left over is a part of it"
    assert found.overlap.tolist() == [[240], [160]]
    assert found.object_pixels.tolist() == [400]
    np.testing.assert_allclose(found.similarity, [0.6, 0.0])


def test_the_pairs_are_those_that_are_most_alike_together() -> None:
    claim = things((0, 10), (10, 20))
    owner = things((0, 3), (3, 20)) + 1  # 1: a part of the first; 2: the rest and all of the second
    found = matched(claim, FAR, [entry(1, 0.0), entry(2, 1.0)], np.where(claim < 0, 0, owner))
    assert found.match.tolist() == [0, 1]


def test_boxes_tell_where_pixels_do_not() -> None:
    claim = things((0, 10), (20, 30))
    found = matched(claim, [box(0.02), box(1.0)], [entry(1, 1.0), entry(2, 0.0)], np.zeros(SHAPE, int))
    assert found.match.tolist() == [1, 0]
    np.testing.assert_allclose(found.iou, [[0.0, 0.18 / 0.22], [1.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(found.similarity, [0.18 / 0.22, 1.0])


def test_what_the_map_did_not_know_does_not_count_against_a_thing() -> None:
    # Half of the thing is new: of the known half all is object 3's, which shows nothing else.
    claim = things((0, 20))
    known = np.arange(40) < 10
    owner = np.where(known, 3, 0) * np.ones(SHAPE, int)
    found = matched(claim, FAR[:1], [entry(3, 0.0)], owner, known * np.ones(SHAPE, bool))
    assert found.similarity.tolist() == [1.0]
    # But of what is all but new its known part tells little: a twentieth of it is like a fifth of it at most.
    known = np.arange(40) < 1
    owner = np.where(known, 3, 0) * np.ones(SHAPE, int)
    found = matched(claim, FAR[:1], [entry(3, 0.0)], owner, known * np.ones(SHAPE, bool))
    assert found.match.tolist() == [0]
    np.testing.assert_allclose(found.similarity, [1 / 4])


def test_a_thing_in_no_object_is_none_and_no_part() -> None:
    claim = things((0, 10), (20, 30))
    owner = np.where(np.arange(40) < 4, 8, 0) * np.ones(SHAPE, int)
    owner[:, 35:] = 8
    found = matched(claim, FAR, [entry(8, 0.0)], owner)
    assert found.match.tolist() == [0, -1]
    assert found.part.tolist() == [-1, -1]


def test_no_objects_and_no_things() -> None:
    claim, nothing = things((0, 10)), np.full(SHAPE, -1)
    owner = np.full(SHAPE, 9)  # an object that is not among those in view
    found = matched(claim, FAR[:1], [], owner)
    assert (found.match.tolist(), found.part.tolist(), found.iou.shape) == ([-1], [-1], (1, 0))
    found = matched(nothing, [], [entry(9, 0.0)], owner)
    assert (found.match.shape, found.iou.shape, found.object_pixels.tolist()) == ((0,), (0, 1), [800])
    found = matched(nothing, [], [], owner)
    assert (found.match.shape, found.object_pixels.shape) == ((0,), (0,))
