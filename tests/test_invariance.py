"""Two properties of all results: they depend neither on how the camera is turned about its sight nor on the world."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from cuboid.core.frame import Float64Array, Frame, Intrinsics
from cuboid.core.results import Sighting
from cuboid.geometry.box import Box
from cuboid.geometry.overlap import iou
from cuboid.readers import open_recording
from cuboid.tracking.posed_tracker import PosedTracker
from cuboid.tracking.rolling import Roll
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
    tracker = PosedTracker(camera)
    sightings = [tracker.update(frame).sightings for frame in frames]
    return [one.box for one in tracker.objects], sightings


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
    roll, frames = Roll(CAMERA, turns), made()
    expected, seen = track(frames, CAMERA)
    found, seen_turned = track([roll.frame(one) for one in frames], roll.camera)
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


def test_a_made_table_in_another_world_gives_the_same_objects() -> None:
    frames, A = made(), a_motion()
    expected, _ = track(frames, CAMERA)
    found, _ = track(moved(frames, A), CAMERA)
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        there = Box(A[:3, :3] @ other.center + A[:3, 3], other.size, A[:3, :3] @ other.rotation)
        assert iou(one, there) > 0.8


@pytest.mark.parametrize(("name", "every", "limit"), [("office-scan", 1, 40), ("desk-realsense", 2, 40)])
def test_turned_images_of_real_places_give_the_same_objects(data_dir: Path, name: str, every: int, limit: int) -> None:
    recording = open_recording(data_dir / name)
    frames = [recording.read(k) for k in range(0, every * limit, every)]
    expected, _ = track(frames, recording.intrinsics)
    for turns in (1, 2):
        roll = Roll(recording.intrinsics, turns)
        assert_same(track([roll.frame(one) for one in frames], roll.camera)[0], expected)


def test_a_scanned_office_in_another_world_keeps_most_objects(data_dir: Path) -> None:
    """The grid of the map lies otherwise in it: boxes differ by some voxels, and a doubtful object may come or go."""
    recording = open_recording(data_dir / "office-scan")
    frames, A = [recording.read(k) for k in range(len(recording))], a_motion()
    expected, _ = track(frames, recording.intrinsics)
    there = [Box(A[:3, :3] @ o.center + A[:3, 3], o.size, A[:3, :3] @ o.rotation) for o in expected]
    found, _ = track(moved(frames, A), recording.intrinsics)
    overlap = np.array([[iou(one, other) for other in there] for one in found])
    rows, columns = linear_sum_assignment(-overlap)
    assert np.count_nonzero(overlap[rows, columns] > 0.5) >= 0.75 * max(len(found), len(there))
