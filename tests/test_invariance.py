"""Two properties of all results: they depend neither on how the camera is turned about its sight nor on the world."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult, Sighting
from cuboid.ground.geometry.box import Box
from cuboid.inputs.readers import open_recording
from cuboid.runs.tracking.posed_tracker import PosedTracker
from cuboid.runs.tracking.rolling import Roll
from cuboid.runs.tracking.tracker import Tracker
from made_scenes import CAMERA, frame_of, look_at, upright

SCENE = [
    upright((0, 0), (1.6, 1.2, 0.05), z=-0.05),
    upright((-0.35, 0.0), (0.2, 0.12, 0.1), 0.4),
    upright((0.15, 0.15), (0.1, 0.1, 0.18)),
    upright((0.4, -0.2), (0.16, 0.1, 0.07), 1.0),
]


def made() -> list[Frame]:
    angles = np.linspace(-0.6, 0.6, 24) - np.pi / 2
    poses = [look_at((1.0 * np.cos(a), 1.0 * np.sin(a), 0.8), (0, 0, 0)) for a in angles]
    return [frame_of(SCENE, T, k) for k, T in enumerate(poses)]


def track(frames: Iterable[Frame], camera: Intrinsics) -> tuple[list[Box], list[tuple[Sighting, ...]]]:
    tracker = Tracker(camera)
    sightings = [result.sightings for frame in frames if isinstance(result := tracker.update(frame), FrameResult)]
    return [one.box for one in tracker.objects], sightings


@dataclasses.dataclass(frozen=True)
class Tracked:
    """Frames with their results; each place is tracked once."""

    frames: list[Frame]
    camera: Intrinsics
    boxes: list[Box]
    sightings: list[tuple[Sighting, ...]]


@cache
def made_table() -> Tracked:
    return Tracked(made(), CAMERA, *track(made(), CAMERA))


@cache
def real_place(folder: Path, every: int, limit: int) -> Tracked:
    recording = open_recording(folder)
    frames = [recording.read(k) for k in range(0, every * limit, every)]
    return Tracked(frames, recording.intrinsics, *track(frames, recording.intrinsics))


def moved(frames: Iterable[Frame], A: Float64Array) -> list[Frame]:
    return [
        dataclasses.replace(one, T_world_camera=None if one.T_world_camera is None else A @ one.T_world_camera)
        for one in frames
    ]


def a_motion() -> Float64Array:
    A = np.eye(4)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    A[:3, :3], A[:3, 3] = turn * np.linalg.det(turn), [3.1, -7.3, 11.7]
    return A


def assert_same(found: list[Box], expected: list[Box]) -> None:
    assert len(found) == len(expected) > 0
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.corners(), other.corners(), atol=0.01)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_turned_images_of_a_made_table_give_the_same_objects(turns: int) -> None:
    roll, table = Roll(CAMERA, turns), made_table()
    expected, seen = table.boxes, table.sightings
    found, seen_turned = track([roll.frame(one) for one in table.frames], roll.camera)
    assert len(expected) == 3
    assert_same(found, expected)
    # What is seen where is told in the pixels of the images as they came.
    back = Roll(roll.camera, -turns % 4)
    for one, other in zip(seen, seen_turned, strict=True):
        assert [s.label for s in one] == [s.label for s in other]
        for a, b in zip(one, other, strict=True):
            picture = np.zeros((CAMERA.height, CAMERA.width), bool)
            x0, y0, x1, y1 = np.rint(a.rect_xyxy).astype(int)
            picture[y0:y1, x0:x1] = True
            turned = np.zeros((roll.camera.height, roll.camera.width), bool)
            x0, y0, x1, y1 = np.rint(b.rect_xyxy).astype(int)
            turned[y0:y1, x0:x1] = True
            np.testing.assert_array_equal(np.rot90(turned, -back.turns), picture)


def assert_same_elsewhere(place: Tracked) -> None:
    """Frames in another world give the same labels and boxes there."""
    A = a_motion()
    expected, seen = place.boxes, place.sightings
    found, seen_there = track(moved(place.frames, A), place.camera)
    assert len(found) == len(expected) > 0
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.corners(), other.moved(A).corners(), atol=1e-6)
    for here, there in zip(seen, seen_there, strict=True):
        assert [one.label for one in here] == [one.label for one in there]
        for one, other in zip(here, there, strict=True):
            np.testing.assert_allclose(one.rect_xyxy, other.rect_xyxy, atol=1e-6)
            np.testing.assert_allclose(one.box.moved(A).corners(), other.box.corners(), atol=1e-6)


def test_a_made_table_in_another_world_gives_the_same_objects() -> None:
    assert_same_elsewhere(made_table())


@pytest.mark.parametrize(("name", "every", "limit"), [("office-scan", 1, 24), ("desk-realsense", 2, 24)])
def test_turned_images_of_real_places_give_the_same_objects(data_dir: Path, name: str, every: int, limit: int) -> None:
    place = real_place(data_dir / name, every, limit)
    for turns in (1, 2):
        roll = Roll(place.camera, turns)
        assert_same(track([roll.frame(one) for one in place.frames], roll.camera)[0], place.boxes)


@pytest.mark.parametrize(("name", "every", "limit"), [("office-scan", 1, 24), ("desk-realsense", 2, 24)])
def test_real_places_in_another_world_give_the_same_objects(data_dir: Path, name: str, every: int, limit: int) -> None:
    assert_same_elsewhere(real_place(data_dir / name, every, limit))


def test_points_planes_and_up_lie_in_the_world_of_the_poses() -> None:
    frames, A = made(), a_motion()
    here, there = Tracker(CAMERA), Tracker(CAMERA)
    for one, other in zip(frames, moved(frames, A), strict=True):
        here.update(one)
        there.update(other)
    assert here.up is not None
    assert there.up is not None
    np.testing.assert_allclose(here.up, [0, 0, 1], atol=0.01)
    np.testing.assert_allclose(there.up, A[:3, :3] @ here.up, atol=1e-9)
    (one,), (other,) = here.planes, there.planes
    np.testing.assert_allclose(one.extent @ one.normal + one.offset, 0.0, atol=1e-6)
    np.testing.assert_allclose(other.extent, one.extent @ A[:3, :3].T + A[:3, 3], atol=1e-6)
    np.testing.assert_allclose(other.extent @ other.normal + other.offset, 0.0, atol=1e-6)
    points, points_there = here.map_points(), there.map_points()
    np.testing.assert_allclose(points_there.xyz, points.xyz @ A[:3, :3].T + A[:3, 3], atol=1e-4)
    np.testing.assert_array_equal(points_there.label, points.label)


@pytest.mark.parametrize(("name", "every", "limit"), [("office-scan", 2, 30), ("rgbd_dataset_freiburg1_xyz", 8, 30)])
def test_the_third_axis_of_a_box_is_the_normal_of_its_plane(data_dir: Path, name: str, every: int, limit: int) -> None:
    recording = open_recording(data_dir / name)
    tracker = Tracker(recording.intrinsics)
    for frame in recording.iterate(every=every, limit=limit):
        tracker.update(frame)
    resting = [item for item in tracker.objects if item.plane is not None]
    assert len(resting) >= 3
    for item in resting:
        assert item.plane is not None
        # Planes are refined after the last fit of a box, by less than what a camera pose errs by.
        assert item.box.up @ tracker.planes[item.plane].normal > np.cos(np.radians(3.0)), item


def test_a_later_visit_may_hold_the_camera_upside_down() -> None:
    roll = Roll(CAMERA, 2)
    assert roll.camera == CAMERA
    tracker, frames = PosedTracker(CAMERA), made()
    for frame in frames:
        tracker.update(frame)
    before = {item.label: item.box for item in tracker.objects}
    tracker.begin_visit()
    seen = set()
    for frame in frames:
        turned = dataclasses.replace(roll.frame(frame), index=frame.index + len(frames))
        seen |= {one.label for one in tracker.update(turned).sightings}
    assert seen == set(before)
    assert_same([item.box for item in tracker.objects], list(before.values()))
