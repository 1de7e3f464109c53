"""The tracker on scenes whose truth is known to the last digit."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou
from cuboid.runs.tracking.posed_tracker import PosedTracker
from made_scenes import CAMERA, cast, frame_of, look_at, upright

FLOOR = upright((0, 0), (8, 8, 0.1), z=-0.85)
TABLE = upright((0, 0), (1.4, 1.0, 0.05), z=-0.05)
THINGS = [upright((-0.25, 0.1), (0.12, 0.08, 0.15), 0.4), upright((0.2, -0.1), (0.1, 0.1, 0.1), 0.2)]


def orbit(n: int, start: float = -0.6, end: float = 0.6, radius: float = 1.3, height: float = 0.8) -> list[np.ndarray]:
    angles = np.linspace(start, end, n) - np.pi / 2
    return [look_at([radius * np.cos(a), radius * np.sin(a), height], [0, 0, 0.05]) for a in angles]


def follow(tracker: PosedTracker, frames: Iterable[Frame]) -> list[FrameResult]:
    return [tracker.update(frame) for frame in frames]


def matched(tracker: PosedTracker, truth: list[Box]) -> list[tuple[int, float]]:
    """For each true box the label and IoU of the best object."""
    pairs = []
    for box in truth:
        label, best = max(((o.label, iou(o.box, box)) for o in tracker.objects), key=lambda p: p[1], default=(0, 0.0))
        pairs.append((label, best))
    return pairs


def test_two_boxes_on_a_table() -> None:
    tracker = PosedTracker(CAMERA)
    results = follow(tracker, (frame_of([FLOOR, TABLE, *THINGS], T, k) for k, T in enumerate(orbit(40))))
    assert len(tracker.objects) == 2
    assert [o.label for o in tracker.objects] == [1, 2]
    for _, overlap in matched(tracker, THINGS):
        assert overlap > 0.7
    for o in tracker.objects:
        assert o.plane is not None
        plane = tracker.planes[o.plane]
        foot = o.box.center - o.box.up * o.box.size[2] / 2
        assert abs(float(plane.normal @ foot) + plane.offset) < 1e-3
        assert abs(float(plane.normal @ o.box.up)) == pytest.approx(1, abs=1e-5)
        assert plane.offset == pytest.approx(0, abs=0.01)
    assert {s.label for s in results[-1].sightings} == {1, 2}
    assert all(s.visible > 0.5 for s in results[-1].sightings)
    np.testing.assert_allclose(tracker.up, [0, 0, 1], atol=0.02)


def test_rectangles_hold_the_objects_pixels() -> None:
    tracker = PosedTracker(CAMERA)
    poses = orbit(30)
    last = follow(tracker, (frame_of([FLOOR, TABLE, *THINGS], T, k) for k, T in enumerate(poses)))[-1]
    _, hit = cast([FLOOR, TABLE, *THINGS], poses[-1])
    label_of = [label for label, _ in matched(tracker, THINGS)]
    for k, label in enumerate(label_of):
        v, u = np.nonzero(hit == k + 2)
        true = np.array([u.min(), v.min(), u.max() + 1, v.max() + 1])
        rect = next(s.rect_xyxy for s in last.sightings if s.label == label)
        np.testing.assert_allclose(rect, true, atol=5)


def test_a_camera_in_portrait_finds_what_one_in_landscape_finds() -> None:
    """A quarter turn changes neither which pixels are looked at nor which way is up."""
    frames = [frame_of([FLOOR, TABLE, *THINGS], T, k) for k, T in enumerate(orbit(25))]
    portrait = PosedTracker(
        Intrinsics(CAMERA.fy, CAMERA.fx, CAMERA.height - 1 - CAMERA.cy, CAMERA.cx, CAMERA.height, CAMERA.width)
    )
    follow(portrait, (quarter_turned(frame) for frame in frames))
    assert len(portrait.objects) == 2
    np.testing.assert_allclose(portrait.up, [0, 0, 1], atol=0.02)
    for _, overlap in matched(portrait, THINGS):
        assert overlap > 0.7


def quarter_turned(frame: Frame) -> Frame:
    """The same frame by a camera that is rolled by a quarter turn."""
    T = frame.T_world_camera.copy()
    T[:3, :3] = T[:3, :3] @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    color, depth_m = (np.ascontiguousarray(np.rot90(image, -1)) for image in (frame.color, frame.depth_m))
    return replace(frame, color=color, depth_m=depth_m, T_world_camera=T)


def test_where_up_was_measured_it_is_known_from_the_first_frame() -> None:
    tracker = PosedTracker(CAMERA)
    wall = upright((0, 1.0), (6, 0.1, 4), z=-2.0)
    T = look_at([0, -1.0, 0.5], [0, 1.0, 0.5])
    frame = frame_of([wall], T, 0)
    tracker.update(replace(frame, up_camera=T[:3, :3].T @ [0, 0, 2.0]))
    np.testing.assert_allclose(tracker.up, [0, 0, 1], atol=1e-6)
    with pytest.raises(FrameError, match="frame 0: up is no direction"):
        replace(frame, up_camera=np.zeros(3))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_any_world_frame_will_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    T_new_world = np.eye(4)
    T_new_world[:3, :3] = Q * np.sign(np.linalg.det(Q))
    T_new_world[:3, 3] = rng.normal(size=3)
    tracker = PosedTracker(CAMERA)
    frames = (frame_of([FLOOR, TABLE, *THINGS], T, k, T_shown=T_new_world @ T) for k, T in enumerate(orbit(30)))
    follow(tracker, frames)
    turned = [
        Box(T_new_world[:3, :3] @ b.center + T_new_world[:3, 3], b.size, T_new_world[:3, :3] @ b.rotation)
        for b in THINGS
    ]
    assert len(tracker.objects) == 2
    assert min(overlap for _, overlap in matched(tracker, turned)) > 0.6
    np.testing.assert_allclose(tracker.up, T_new_world[:3, 2], atol=0.03)


def test_a_hidden_object_has_its_old_label_when_it_comes_back() -> None:
    """A screen stands before one of the things for 60 frames."""
    screen = upright((0.2, -0.35), (0.3, 0.01, 0.35))
    tracker = PosedTracker(CAMERA)
    poses = orbit(40, -0.3, 0.3) + orbit(40, 0.3, -0.3)
    hidden = [FLOOR, TABLE, *THINGS, screen]
    before = follow(tracker, (frame_of([FLOOR, TABLE, *THINGS], T, k) for k, T in enumerate(poses[:40])))
    label = matched(tracker, THINGS)[1][0]
    assert label in {s.label for s in before[-1].sightings}
    # The camera goes down, behind the screen: the thing is out of sight.
    low = [look_at([0.2, -1.1, 0.2], [0.2, 0, 0.05])] * 60
    away = follow(tracker, (frame_of(hidden, T, 40 + k) for k, T in enumerate(low)))
    assert label not in {s.label for s in away[-1].sightings}
    assert label in {o.label for o in tracker.objects}
    after = follow(tracker, (frame_of([FLOOR, TABLE, *THINGS], T, 100 + k) for k, T in enumerate(poses[:20])))
    assert matched(tracker, THINGS)[1][0] == label
    assert label in {s.label for s in after[2].sightings}


def test_labels_last_while_the_camera_is_turned_away() -> None:
    wall = upright((0, 4), (8, 0.1, 3), z=-0.85)
    scene = [FLOOR, TABLE, wall, *THINGS]
    tracker = PosedTracker(CAMERA)
    follow(tracker, (frame_of(scene, T, k) for k, T in enumerate(orbit(30))))
    labels = matched(tracker, THINGS)
    away = [look_at([0, -1.3, 0.8], [2.5 * np.cos(a), -1.3 + 2.5 * np.sin(a), 0.9]) for a in np.linspace(0.2, 2.9, 60)]
    results = follow(tracker, (frame_of(scene, away[k], 30 + k) for k in range(0, 60, 3)))
    assert not any(s.label in dict(labels) for s in results[0].sightings)
    back = follow(tracker, (frame_of(scene, T, 90 + k) for k, T in enumerate(orbit(20))))
    assert {label for label, _ in labels} <= {s.label for s in back[0].sightings}
    assert [label for label, _ in matched(tracker, THINGS)] == [label for label, _ in labels]


def test_first_frames_without_any_plane() -> None:
    """The camera looks at a far wall first; nothing there becomes an object, and the table is found all the same."""
    wall = upright((0, 3), (8, 0.1, 3), z=-0.85)
    scene = [FLOOR, TABLE, wall, *THINGS]
    up_there = [look_at([0, -1.3, 0.8], [0.2 * k / 40, 2.5, 1.4]) for k in range(40)]
    tracker = PosedTracker(CAMERA)
    poses = [*up_there, *orbit(40)]
    follow(tracker, (frame_of(scene, poses[k], k) for k in range(0, 80, 2)))
    assert len(tracker.objects) == 2
    assert min(overlap for _, overlap in matched(tracker, THINGS)) > 0.6


def test_neighbours_two_centimetres_apart_are_two() -> None:
    pair = [upright((-0.06, 0), (0.1, 0.1, 0.12)), upright((0.06, 0), (0.1, 0.1, 0.12))]
    tracker = PosedTracker(CAMERA)
    follow(tracker, (frame_of([FLOOR, TABLE, *pair], T, k) for k, T in enumerate(orbit(30, radius=0.9))))
    assert len(tracker.objects) == 2
    assert min(overlap for _, overlap in matched(tracker, pair)) > 0.6


def test_neighbours_that_touch_are_two() -> None:
    table = Box(np.array([0, 0, -0.05]), np.array([1.4, 1.0, 0.1]), np.eye(3))
    tall, low = upright((-0.05, 0.0), (0.1, 0.1, 0.24)), upright((0.07, 0.02), (0.14, 0.1, 0.1))
    tracker = PosedTracker(CAMERA)
    follow(tracker, (frame_of([table, tall, low], T, k) for k, T in enumerate(orbit(60))))
    pairs = matched(tracker, [tall, low])
    assert len({label for label, _ in pairs}) == 2
    assert min(iou for _, iou in pairs) > 0.6


def test_a_partial_view_starts_no_second_label() -> None:
    """The first frames see a third of a long box; it grows, and stays one."""
    long = upright((0, 0), (0.5, 0.12, 0.15))
    sweep = [look_at([x, -0.9, 0.6], [x, 0, 0.05]) for x in np.linspace(-0.9, 0.5, 60)]
    tracker = PosedTracker(CAMERA)
    results = follow(tracker, (frame_of([FLOOR, TABLE, long], T, k) for k, T in enumerate(sweep)))
    assert {s.label for r in results for s in r.sightings} == {1}
    assert len(tracker.objects) == 1
    assert matched(tracker, [long])[0][1] > 0.7


def test_poses_that_drift_do_not_double_an_object() -> None:
    tracker = PosedTracker(CAMERA)
    labels = set()
    poses = orbit(90)
    for k in range(0, 90, 3):
        T = poses[k]
        shown = T.copy()
        shown[:3, 3] += np.array([0.03, 0.01, 0.015]) * k / 90
        labels |= {s.label for s in tracker.update(frame_of([FLOOR, TABLE, *THINGS], T, k, T_shown=shown)).sightings}
    assert labels == {1, 2}


def test_things_on_a_table_and_on_the_floor_stand_on_their_own_planes() -> None:
    on_floor = upright((0.95, 0.0), (0.25, 0.2, 0.3), z=-0.75)
    scene = [FLOOR, TABLE, THINGS[0], on_floor]
    poses = [look_at([1.0 + x, -1.6, 0.9], [0.35, 0, -0.2]) for x in np.linspace(-0.5, 0.5, 50)]
    tracker = PosedTracker(CAMERA)
    follow(tracker, (frame_of(scene, T, k) for k, T in enumerate(poses)))
    pairs = matched(tracker, [THINGS[0], on_floor])
    assert min(overlap for _, overlap in pairs) > 0.6
    heights = []
    for label, _ in pairs:
        plane = next(o.plane for o in tracker.objects if o.label == label)
        assert plane is not None
        heights.append(-tracker.planes[plane].offset)
    np.testing.assert_allclose(heights, [0.0, -0.75], atol=0.02)


def test_an_object_that_proves_not_to_be_there_is_retired_and_its_label_not_used_again() -> None:
    tracker = PosedTracker(CAMERA)
    follow(tracker, (frame_of([FLOOR, TABLE, *THINGS], T, k) for k, T in enumerate(orbit(20))))
    assert len(tracker.objects) == 2
    gone = matched(tracker, THINGS)[1][0]
    left = [FLOOR, TABLE, THINGS[0]]
    poses = orbit(20)[::-1] + orbit(20)
    follow(tracker, (frame_of(left, poses[k % 40], 20 + k) for k in range(0, 240, 3)))
    assert gone not in {o.label for o in tracker.objects}
    new = upright((0.45, 0.25), (0.1, 0.1, 0.1))
    follow(tracker, (frame_of([*left, new], poses[k % 40], 260 + k) for k in range(0, 100, 3)))
    assert matched(tracker, [new])[0][1] > 0.5
    assert matched(tracker, [new])[0][0] == 3


def empty_wall(k: int) -> Frame:
    return frame_of([upright((0, 3), (8, 0.1, 3), z=-0.85)], look_at([0, 0, 0.8], [0.1, 2.5, 0.8]), k)


def readings_without_end(k: int) -> Frame:
    frame = empty_wall(k)
    depth = frame.depth_m.copy()
    depth[::2], depth[1::3] = 3e38, np.inf
    return Frame(k, k / 30, frame.color, depth, frame.T_world_camera)


@pytest.mark.parametrize("make", [empty_wall, readings_without_end])
def test_nothing_to_see_is_no_error(make: Callable[[int], Frame]) -> None:
    tracker = PosedTracker(CAMERA)
    results = follow(tracker, (make(k) for k in range(40)))
    assert tracker.objects == []
    assert results[-1].sightings == ()


def test_a_frame_that_cannot_be_used_says_why() -> None:
    tracker = PosedTracker(CAMERA)
    good = frame_of([TABLE], orbit(1)[0], 0)
    with pytest.raises(FrameError, match="no camera pose"):
        tracker.update(Frame(0, 0.0, good.color, good.depth_m, None))
    with pytest.raises(FrameError, match="160 x 120 pixels, expected 320 x 240"):
        tracker.update(Frame(0, 0.0, good.color[::2, ::2], good.depth_m[::2, ::2], np.eye(4)))
    assert tracker.points_known == 0
    assert good.T_world_camera is not None
    tracker.update(good)
    far = good.T_world_camera.copy()
    far[:3, 3] += 3e5 * far[:3, 2]
    with pytest.raises(FrameError, match="is 300000 m from the first one, the map reaches 167772 m"):
        tracker.update(Frame(1, 0.0, good.color, good.depth_m, far))


def test_poses_far_from_their_origin_are_taken() -> None:
    """As those of a map of the country: the map begins at the first camera."""
    near, far = PosedTracker(CAMERA), PosedTracker(CAMERA)
    away = np.array([4.5e5, -9.0e5, 120.0])
    frames = [frame_of([FLOOR, TABLE, *THINGS], T, k) for k, T in enumerate(orbit(12))]
    follow(near, frames)
    follow(far, [frame.at(moved_by(frame.T_world_camera, away)) for frame in frames])
    assert len(near.objects) == len(far.objects) > 0
    for one, other in zip(near.objects, far.objects, strict=True):
        np.testing.assert_allclose(other.box.center - away, one.box.center, atol=1e-5)


def moved_by(T: np.ndarray | None, away: np.ndarray) -> np.ndarray:
    assert T is not None
    far = T.copy()
    far[:3, 3] += away
    return far


def test_the_same_frames_give_the_same_bytes() -> None:
    def once() -> tuple[bytes, ...]:
        tracker = PosedTracker(CAMERA)
        follow(tracker, (frame_of([FLOOR, TABLE, *THINGS], T, k) for k, T in enumerate(orbit(25))))
        points = tracker.map_points()
        boxes = b"".join(
            o.box.center.tobytes() + o.box.size.tobytes() + o.box.rotation.tobytes() for o in tracker.objects
        )
        return (
            boxes,
            points.xyz.tobytes(),
            points.rgb.tobytes(),
            points.heat.tobytes(),
            points.label.tobytes(),
        )

    assert once() == once()


def test_the_top_of_a_box_is_no_supporting_plane() -> None:
    """A box of 36 x 30 cm, 20 cm high: its top is larger than the least plane, and still it is an object."""
    big = upright((0.1, 0.05), (0.36, 0.3, 0.2), 0.3)
    tracker = PosedTracker(CAMERA)
    follow(tracker, (frame_of([FLOOR, TABLE, big], T, k) for k, T in enumerate(orbit(40))))
    assert len(tracker.objects) == 1
    assert matched(tracker, [big])[0][1] > 0.7


def test_a_thing_in_plain_view_has_its_label_within_ten_frames() -> None:
    tracker = PosedTracker(CAMERA)
    results = follow(tracker, (frame_of([FLOOR, TABLE, *THINGS], T, k) for k, T in enumerate(orbit(40)[:11])))
    assert len(results[10].sightings) == 2


def test_what_one_frame_shows_clearly_has_its_label_at_once() -> None:
    tracker = PosedTracker(CAMERA)
    results = follow(tracker, (frame_of([FLOOR, TABLE, *THINGS], T, 10 * k) for k, T in enumerate(orbit(4))))
    assert [len(result.sightings) for result in results] == [2, 2, 2, 2]


def test_what_the_border_of_the_picture_always_cuts_is_unsure_and_grows_when_its_end_is_seen() -> None:
    tracker = PosedTracker(CAMERA, TrackerConfig(min_probability=0.2))
    tower = upright((0.0, 0.0), (0.15, 0.15, 0.8), 0.3)
    low = [look_at([1.2 * np.cos(a), 1.2 * np.sin(a), 0.5], [0, 0, 0.0]) for a in np.linspace(-2.0, -1.7, 24)]
    follow(tracker, (frame_of([FLOOR, TABLE, tower], T, k) for k, T in enumerate(low)))
    assert all(o.probability < 0.7 for o in tracker.objects)
    high = [look_at([1.9 * np.cos(a), 1.9 * np.sin(a), 1.1], [0, 0, 0.35]) for a in np.linspace(-1.7, -1.4, 48)]
    follow(tracker, (frame_of([FLOOR, TABLE, tower], high[k], 24 + k) for k in range(0, 48, 3)))
    assert [o.label for o in tracker.objects] == [1]
    assert tracker.objects[0].box.size[2] == pytest.approx(0.8, abs=0.02)


def test_a_thing_without_depth_is_known_by_its_color() -> None:
    tracker = PosedTracker(CAMERA)
    poses = orbit(30)
    scene = [FLOOR, TABLE, *THINGS]
    follow(tracker, (frame_of(scene, T, k) for k, T in enumerate(poses[:24])))
    label = matched(tracker, THINGS)[0][0]
    blind = frame_of(scene, poses[24], 24)
    hole = np.zeros(blind.depth_m.shape, bool)
    hole[cast(scene, poses[24])[1] == 2] = True
    shadow = replace(blind, depth_m=np.where(hole, 0, blind.depth_m).astype(np.float32))
    seen = next(s for s in tracker.update(shadow).sightings if s.label == label)
    assert seen.visible > 0.7
    painted = replace(shadow, index=25, color=np.where(hole[..., None], 255 - shadow.color, shadow.color))
    assert label not in {s.label for s in tracker.update(painted).sightings}


def test_what_proves_to_hold_up_a_plane_is_furniture_and_what_stands_on_it_an_object() -> None:
    tracker = PosedTracker(CAMERA, TrackerConfig(min_probability=0.05))
    floor, block = upright((0, 0), (8, 8, 0.1), z=-0.1), upright((0, 0), (0.8, 0.5, 0.4), 0.2)
    cup = upright((0.1, 0.05), (0.1, 0.1, 0.12), z=0.4)
    scene = [floor, block, cup]
    low = [look_at([2.2 * np.cos(a), 2.2 * np.sin(a), 0.38], [0, 0, 0.25]) for a in np.linspace(-1.9, -1.6, 30)]
    follow(tracker, (frame_of(scene, T, k) for k, T in enumerate(low)))
    first = {o.label for o in tracker.objects if iou(o.box, block) > 0.3}
    assert first, "from below its top, its front is a thing"
    high = [look_at([1.5 * np.cos(a), 1.5 * np.sin(a), 1.3], [0, 0, 0.3]) for a in np.linspace(-1.6, -1.1, 100)]
    follow(tracker, (frame_of(scene, high[k], 30 + k) for k in range(0, 100, 3)))
    assert max(iou(o.box, cup) for o in tracker.objects) > 0.6
    assert all(iou(o.box, block) < 0.3 for o in tracker.objects)
    assert not first & {o.label for o in tracker.objects}


def test_what_was_taken_away_is_retired_and_what_was_not_stays() -> None:
    tracker = PosedTracker(CAMERA)
    poses = orbit(30)
    follow(tracker, (frame_of([FLOOR, TABLE, *THINGS], T, k) for k, T in enumerate(poses)))
    assert [o.label for o in tracker.objects] == [1, 2]
    left = [FLOOR, TABLE, THINGS[1]]
    kept, _ = max(matched(tracker, THINGS[1:]))
    results = follow(tracker, (frame_of(left, poses[k % 30], 30 + k) for k in range(0, 240, 3)))
    assert [o.label for o in tracker.objects] == [kept]
    assert results[-1].objects_known == 1
