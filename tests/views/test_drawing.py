from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.palette import UNLABELLED, color_of
from cuboid.ground.geometry.box import EDGES, Box
from cuboid.results.views.drawing import STRIP_PX, Status, dashes, draw_frame, draw_proposals
from cuboid.results.views.projection import visible_rect
from cuboid.results.views.replay import ReplayedObject
from cuboid.results.views.tags import SteadyNames, place_tag, place_tags, tag_px, unit_of
from made_crowd import camera, crowd

INTRINSICS = Intrinsics(500.0, 500.0, 319.5, 239.5, 640, 480)
LOOK = np.eye(4)
GREY = np.full((480, 640, 3), 128, np.uint8)

# Seen from above, left and in front: three faces, nine edges in front, three behind.
CORNERED = Box(np.array([0.25, 0.2, 1.0]), np.array([0.24, 0.2, 0.22]), np.eye(3))


def draw(
    seen: list[ReplayedObject],
    hidden: list[ReplayedObject] | None = None,
    status: Status | None = None,
    ground: UInt8Array = GREY,
) -> UInt8Array:
    return draw_frame(ground, LOOK, INTRINSICS, seen, hidden or [], status)


def along_edges(box: Box, picture: UInt8Array) -> Float64Array:
    """Return the pixels (12, 9, 3) at nine places between the ends of each edge."""
    fractions = np.linspace(0.1, 0.9, 9)[:, None]
    corners = box.corners()
    points = np.array([corners[a] + fractions * (corners[b] - corners[a]) for a, b in EDGES])
    u, v = np.rint(INTRINSICS.pixels(points)).astype(int).reshape(-1, 2).T
    return picture[v, u].astype(float).reshape(12, 9, 3)


def edges_behind(box: Box) -> list[bool]:
    """The three edges that meet in the corner 7, which lies behind."""
    return [7 in ends for ends in EDGES]


def test_edges_in_front_have_the_color_of_the_label_and_those_behind_are_dimmer() -> None:
    pixels = along_edges(CORNERED, draw([ReplayedObject(6, CORNERED)]))
    behind = edges_behind(CORNERED)
    distance = np.median(np.linalg.norm(pixels - color_of(6), axis=2), axis=1)
    np.testing.assert_array_less(distance[np.logical_not(behind)], 25)
    np.testing.assert_array_less(35, distance[behind])
    plain = along_edges(CORNERED, GREY)
    assert (np.median(np.abs(pixels - plain).max(axis=2), axis=1)[behind] > 10).all()


def test_edges_in_front_are_thicker() -> None:
    def width(start: Float64Array, end: Float64Array) -> int:
        """Pixels of the label's hue across the middle of an edge that runs down the image."""
        u, v = np.rint(INTRINSICS.pixels((start + end) / 2)).astype(int)
        row = picture[v, u - 6 : u + 7].astype(int)
        return int((row[:, 2] - row[:, 0] > 60).sum())

    picture = draw([ReplayedObject(6, CORNERED)])  # label 6 is blue
    corners = CORNERED.corners()
    assert width(corners[0], corners[2]) > width(corners[5], corners[7])


@pytest.mark.parametrize("level", [0, 128, 255])
def test_lines_stand_out_from_any_ground(level: int) -> None:
    ground = np.full((480, 640, 3), level, np.uint8)
    picture = draw([ReplayedObject(5, CORNERED)], ground=ground)  # label 5 is yellow, hard to see on white
    corners = INTRINSICS.pixels(CORNERED.corners())
    u, v = np.rint((corners[0] + corners[2]) / 2).astype(int)
    profile = picture[v, u - 6 : u + 7].astype(int).sum(axis=1)
    assert profile.max() - profile.min() > 250


def test_a_hidden_object_is_dashed_and_a_seen_one_is_not() -> None:
    def gaps(picture: UInt8Array) -> int:
        corners = INTRINSICS.pixels(CORNERED.corners())
        fractions = np.linspace(0, 1, 400)[:, None]
        u, v = np.rint(corners[0] + fractions * (corners[2] - corners[0])).astype(int).T
        drawn = picture[v, u, 2].astype(int) - picture[v, u, 0] > 40  # label 6 is blue
        return int((np.diff(drawn.astype(int)) == -1).sum())

    assert gaps(draw([], [ReplayedObject(6, CORNERED)])) >= 5
    assert gaps(draw([ReplayedObject(6, CORNERED)])) == 0


def test_the_nearer_of_two_boxes_is_drawn_over_the_farther() -> None:
    near = Box(np.array([0.0, 0.0, 0.9]), np.full(3, 0.2), np.eye(3))
    far = Box(np.array([0.0, 0.08, 1.5]), np.array([0.6, 0.2, 0.2]), np.eye(3))
    for order in ([ReplayedObject(1, near), ReplayedObject(7, far)], [ReplayedObject(7, far), ReplayedObject(1, near)]):
        picture = draw(order)
        left_px = round(319.5 - 500 * 0.1 / 0.8)  # the near box's left edge, where the far one's top edge crosses it
        top_px = round(239.5 + 500 * -0.02 / 1.4)
        assert np.linalg.norm(picture[top_px, left_px].astype(float) - color_of(1)) < 25


def test_a_tag_of_the_labels_color_stands_above_its_box() -> None:
    picture = draw([ReplayedObject(2, CORNERED)])
    corners = INTRINSICS.pixels(CORNERED.corners())
    top_px, middle_px = int(corners[:, 1].min()), int((corners[:, 0].min() + corners[:, 0].max()) / 2)
    above = picture[top_px - 24 : top_px - 6, middle_px - 16 : middle_px + 16].reshape(-1, 3).astype(int)
    assert (np.abs(above - color_of(2)).sum(axis=1) < 12).sum() > 200
    assert (above.sum(axis=1) < 120).sum() > 30  # its text


def test_tags_do_not_cover_each_other() -> None:
    taken: list[tuple[int, int, int, int]] = []
    for _ in range(4):
        taken.append(place_tag("#12", 14, np.array([300.0, 200.0, 360.0, 260.0]), taken, (480, 640)))
    for i, a in enumerate(taken):
        for b in taken[:i]:
            assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]


@pytest.mark.parametrize("width", [640, 1280])
@pytest.mark.parametrize("count", [5, 40, 200])
def test_tags_of_a_crowd_cover_little_and_never_each_other(width: int, count: int) -> None:
    K = Intrinsics(0.9 * width, 0.9 * width, width / 2, 0.375 * width, width, 3 * width // 4)
    rects = [visible_rect(item.box, camera(0, count), K) for item in crowd(count)]
    texts = [(f"#{item.label} {item.name}", f"#{item.label}") for item in crowd(count)]
    boxes = [(names, rect) for names, rect in zip(texts, rects, strict=True) if rect is not None]
    size_px = round(tag_px(len(boxes)) * unit_of(width))
    placed = [tag for tag in place_tags(boxes, size_px, (K.height, K.width)) if tag is not None]
    for i, (_, a) in enumerate(placed):
        for _, b in placed[:i]:
            assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
    assert len(placed) >= min(count, 40)  # of 200 there are some without
    covered = sum((x1 - x0) * (y1 - y0) for _, (x0, y0, x1, y1) in placed)
    assert covered < 0.13 * K.width * K.height
    assert (count > 100) or any(text in names[:1] for (text, _), (names, _) in zip(placed, boxes, strict=True))


def test_a_tag_has_its_name_where_there_is_room() -> None:
    texts = ("#1 box of screws", "#1")
    rects = [np.array([x, 200.0, x + 40.0, 240.0]) for x in (100.0, 400.0, 450.0)]
    placed = place_tags([(texts, rect) for rect in rects], 14, (480, 640))
    assert [tag and tag[0] for tag in placed] == ["#1 box of screws", "#1", "#1"]


def test_a_name_in_a_video_does_not_flicker() -> None:
    names, other = ("#1 box of screws", "#1"), ("#2",)
    alone = np.array([200.0, 200.0, 240.0, 240.0])
    steady, shown = SteadyNames(), []
    for k in range(60):  # every other frame, for a while, something stands in the way
        boxes = [(names, alone)]
        if k in range(20, 30, 2):
            boxes.append((other, np.add(alone, [60.0, 0.0, 60.0, 0.0])))
        placed = place_tags(boxes, 14, (480, 640), steady)
        assert placed[0] is not None
        shown.append(placed[0][0] != "#1")
        for i, tag in enumerate(placed):
            for before in placed[:i]:
                assert tag is not None
                assert before is not None
                assert tag[1][0] >= before[1][2] or before[1][0] >= tag[1][2] or tag[1][1] != before[1][1]
    assert shown == [True] * 20 + [False] * 19 + [True] * 21


def test_letters_of_a_wide_picture_are_hardly_larger() -> None:
    assert round(tag_px(5) * unit_of(640)) == 14
    assert round(tag_px(5) * unit_of(1280)) == 20
    assert round(tag_px(40) * unit_of(1280)) == 14


@pytest.mark.parametrize("corner", [(0, 0), (600, 0), (0, 440), (600, 440)])
def test_tags_stay_in_the_image(corner: tuple[int, int]) -> None:
    rect_xyxy = np.array([corner[0], corner[1], corner[0] + 30.0, corner[1] + 30.0])
    left, top, right, bottom = place_tag("#1234", 14, rect_xyxy, [], (456, 640))
    assert left >= 0
    assert top >= 0
    assert right <= 640
    assert bottom <= 456


def test_the_strip_changes_with_each_of_its_figures_and_only_the_strip_does() -> None:
    figures = [
        (1, 3, 4),
        (2, 3, 4),
        (1, 2, 4),
        (1, 3, 5),
    ]
    pictures = [draw([], status=Status(*values)) for values in figures]
    assert len({picture.tobytes() for picture in pictures}) == len(figures)
    for picture in pictures:
        assert (picture[: 480 - STRIP_PX] == 128).all()


def test_the_frame_itself_is_not_changed_and_nothing_known_draws_nothing() -> None:
    ground = np.random.default_rng(0).integers(0, 256, (480, 640, 3)).astype(np.uint8)
    before = ground.copy()
    draw([ReplayedObject(1, CORNERED)], status=Status(0, 1, 1), ground=ground)
    np.testing.assert_array_equal(ground, before)
    np.testing.assert_array_equal(draw([], ground=ground), before)


def test_a_box_partly_behind_the_camera_is_drawn() -> None:
    long = Box(np.array([0.0, 0.3, 0.5]), np.array([0.3, 0.3, 2.0]), np.eye(3))
    assert long.corners()[:, 2].min() < 0 < long.corners()[:, 2].max()
    picture = draw([ReplayedObject(6, long)])
    end = INTRINSICS.pixels(np.array([0.0, 0.15, 1.5]))  # the far end of its upper face
    u, v = np.rint(end).astype(int)
    assert np.linalg.norm(picture[v - 2 : v + 3, u].astype(float) - color_of(6), axis=1).min() < 60
    assert (picture != GREY).any(axis=2)[-1].sum() > 50  # it runs out of the image below


def test_proposals_without_a_label_are_grey() -> None:
    class Own:
        label, box, score = 0, CORNERED, 0.5

    picture = draw_proposals(np.zeros_like(GREY), LOOK, INTRINSICS, [Own()], None).astype(int)
    drawn = picture[(picture.sum(axis=2) > 200)]
    assert len(drawn) > 200
    assert (np.abs(drawn - drawn.mean(axis=1, keepdims=True)) <= 16).all()
    assert drawn.max() <= max(UNLABELLED) + 1


def test_the_same_is_drawn_twice() -> None:
    pictures = [draw([ReplayedObject(1, CORNERED)], [ReplayedObject(2, CORNERED)], Status(3, 1, 2)) for _ in range(2)]
    np.testing.assert_array_equal(*pictures)


@pytest.mark.parametrize("shape", [(48, 64), (121, 161), (1080, 1920)])
def test_images_of_any_size_are_drawn(shape: tuple[int, int]) -> None:
    height, width = shape
    K = Intrinsics(width, width, width / 2, height / 2, width, height)
    ground = np.full((height, width, 3), 90, np.uint8)
    box = Box(np.array([0.1, 0.05, 1.0]), np.full(3, 0.2), np.eye(3))
    picture = draw_frame(ground, LOOK, K, [ReplayedObject(1, box)], [ReplayedObject(2, box)], Status(1, 1, 2))
    assert picture.shape == ground.shape
    assert (picture != ground).any()


def test_dashes_cover_both_ends_of_a_line_and_leave_gaps() -> None:
    line = np.array([[[10.0, 10.0], [110.0, 10.0]], [[0.0, 0.0], [3.0, 0.0]]])
    parts = dashes(line, 7.0, 5.0)
    long, short = parts[:-1], parts[-1]
    np.testing.assert_allclose(long[0, 0], (10, 10))
    np.testing.assert_allclose(long[-1, 1], (110, 10))
    np.testing.assert_allclose(long[1:, 0, 0] - long[:-1, 1, 0], 5.0)
    np.testing.assert_allclose(short, line[1])
