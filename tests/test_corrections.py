"""What becomes of the map when camera poses are corrected."""

from __future__ import annotations

import numpy as np

from cuboid.ground.geometry import se3
from cuboid.runs.tracking.posed_tracker import PosedTracker
from made_scenes import CAMERA, frame_of, look_at, upright

SCENE = [
    upright((0, 0), (1.6, 1.2, 0.04), z=-0.04),
    upright((-0.3, 0.1), (0.2, 0.15, 0.2), 0.4),
    upright((0.3, -0.1), (0.12, 0.18, 0.15), -0.2),
]
DRIFT = se3.exp([0.02, 0.28, 0.015, 0.0, 0.0, 0.03])
BACK = se3.inverse(DRIFT)


def eye(k: int) -> np.ndarray:
    turn = -2.0 + 0.01 * k
    return look_at((1.1 * np.cos(turn), 1.1 * np.sin(turn), 0.9), (0, 0, 0.05))


def drifted_tracker() -> PosedTracker:
    """25 frames at true poses (keyframe 1), then 12 that claim drifted ones (keyframe 2).

    Twenty would have seen through what the first showed, and ended it.
    """
    tracker = PosedTracker(CAMERA)
    for k in range(37):
        shown = eye(k) if k < 25 else DRIFT @ eye(k)
        result = tracker.update(frame_of(SCENE, eye(k), k, T_shown=shown), anchor=1 if k < 25 else 2)
        assert not result.events  # poses are off, no thing moves
        assert not result.agents
    return tracker


def test_objects_that_drift_doubled_become_one_under_the_older_label() -> None:
    tracker = drifted_tracker()
    doubled = tracker.objects
    assert len(doubled) >= 3
    tracker.apply_correction({2: BACK})
    for k in range(37, 80):
        tracker.update(frame_of(SCENE, eye(k), k), anchor=2)
    objects = tracker.objects
    assert [o.label for o in objects] == [1, 2]
    assert {label for o in objects for label in o.merged_labels} == {o.label for o in doubled} - {1, 2}
    for truth in SCENE[1:]:
        nearest = min(objects, key=lambda o: float(np.linalg.norm(o.box.center - truth.center)))
        assert np.linalg.norm(nearest.box.center - truth.center) < 0.02
        assert np.abs(np.sort(nearest.box.size) - np.sort(truth.size)).max() < 0.03


def test_a_world_that_moves_as_a_whole_takes_all_with_it() -> None:
    tracker = PosedTracker(CAMERA)
    for k in range(20):
        tracker.update(frame_of(SCENE, eye(k), k), anchor=1)
    before, planes, points = tracker.objects, tracker.planes, tracker.map_points()
    T = se3.exp([0.3, -0.2, 0.1, 0.0, 0.0, 0.1])
    tracker.apply_correction({1: T})
    for old, new in zip(before, tracker.objects, strict=True):
        np.testing.assert_allclose(new.box.center, se3.transform(T, old.box.center), atol=1e-6)
        np.testing.assert_allclose(new.box.rotation, T[:3, :3] @ old.box.rotation, atol=1e-6)
    for one, two in zip(planes, tracker.planes, strict=True):
        # the plane lies 10 cm higher now, at the height of its moved points
        np.testing.assert_allclose(two.normal, one.normal, atol=0.01)
        assert abs((two.offset - one.offset) + 0.1) < 0.005
        expected = se3.transform(T, one.extent)
        assert np.abs(two.extent.min(0) - expected.min(0)).max() < 0.12
        assert np.abs(two.extent.max(0) - expected.max(0)).max() < 0.12
    assert abs(len(tracker.map_points().xyz) - len(points.xyz)) < 0.2 * len(points.xyz)
    for k in range(20, 30):
        result = tracker.update(frame_of(SCENE, eye(k), k, T_shown=T @ eye(k)), anchor=1)
    assert [s.label for s in result.sightings] == [o.label for o in before]
    assert [o.label for o in tracker.objects] == [o.label for o in before]


def test_what_was_seen_since_from_another_keyframe_moves_with_that() -> None:
    tracker = PosedTracker(CAMERA)
    for k in range(28):  # the last ones are too few for boxes to be fitted anew
        tracker.update(frame_of(SCENE, eye(k), k), anchor=1 if k < 26 else 2)
    before, T = tracker.objects, se3.exp([0.3, -0.2, 0.0, 0.0, 0.0, 0.1])
    assert len(before) == 2
    tracker.apply_correction({2: T})
    for old, new in zip(before, tracker.objects, strict=True):
        np.testing.assert_allclose(new.box.center, se3.transform(T, old.box.center), atol=1e-6)
    again = tracker.objects
    tracker.apply_correction({1: T})
    for old, new in zip(again, tracker.objects, strict=True):
        np.testing.assert_allclose(new.box.center, old.box.center, atol=1e-9)
