"""Evidence counts by viewpoint and time: repeated frames change nothing, another frame rate gives the same objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.observation import NEW_SIDE_RAD, NEW_TIME_S, weight_of
from cuboid.ground.core.results import FrameResult
from cuboid.inputs.readers import open_recording
from cuboid.runs.tracking.tracker import Tracker
from made_scenes import CAMERA, frame_of, look_at, upright

SCENE = [
    upright((0, 0), (1.6, 1.2, 0.05), z=-0.05),
    upright((-0.35, 0.0), (0.2, 0.12, 0.1), 0.4),
    upright((0.15, 0.15), (0.1, 0.1, 0.18)),
    upright((0.4, -0.2), (0.16, 0.1, 0.07), 1.0),
]
REACHES = {"fixed camera": 0.0, "moving camera": 0.6}


def made(reach_rad: float, count: int = 24) -> list[Frame]:
    angles = np.linspace(-reach_rad, reach_rad, count) - np.pi / 2
    return [
        frame_of(SCENE, look_at((1.0 * np.cos(a), 1.0 * np.sin(a), 0.8), (0, 0, 0)), k) for k, a in enumerate(angles)
    ]


def given_twice(frames: Sequence[Frame]) -> list[Frame]:
    return [replace(frame, index=2 * frame.index + k) for frame in frames for k in range(2)]


def track(frames: Sequence[Frame], camera: Intrinsics, poses: str | None = None) -> tuple[Tracker, list[FrameResult]]:
    tracker = Tracker(camera, poses=poses)
    results = [tracker.update(frame) for frame in frames]
    return tracker, [result for result in results if isinstance(result, FrameResult)]


def shown(result: FrameResult) -> list[tuple[object, ...]]:
    return [(one.label, one.box.corners().tobytes(), one.rect_xyxy.tobytes()) for one in result.sightings]


def assert_same_if_given_twice(frames: Sequence[Frame], camera: Intrinsics, poses: str | None = None) -> None:
    once, results = track(frames, camera, poses)
    twice, repeated = track(given_twice(frames), camera, poses)
    assert len(once.objects) > 0
    assert [shown(one) for one in repeated] == [shown(one) for one in results for _ in range(2)]
    assert [(one.label, one.box.corners().tobytes()) for one in twice.objects] == [
        (one.label, one.box.corners().tobytes()) for one in once.objects
    ]
    assert [one.frames_seen for one in twice.objects] == [2 * one.frames_seen for one in once.objects]
    assert list(twice.trajectory) == [2 * index + k for index in once.trajectory for k in range(2)]


def test_the_weight_of_a_frame_is_its_time_and_its_turn_and_at_most_one() -> None:
    assert weight_of(0.0, 0.0) == 0.0
    assert weight_of(NEW_TIME_S / 4, 0.0) == pytest.approx(0.25)
    assert weight_of(0.0, NEW_SIDE_RAD / 2) == pytest.approx(0.5)
    assert weight_of(NEW_TIME_S / 4, NEW_SIDE_RAD / 2) == pytest.approx(0.75)
    assert weight_of(10.0, 0.0) == weight_of(0.0, 1.0) == 1.0
    assert weight_of(-3.0, NEW_SIDE_RAD / 2) == pytest.approx(0.5)
    # The sum over a second is the same at 30 Hz and at 5 Hz.
    assert 30 * weight_of(1 / 30, 0.0) == pytest.approx(5 * weight_of(1 / 5, 0.0))


@pytest.mark.parametrize("reach_rad", REACHES.values(), ids=REACHES)
def test_frames_given_twice_change_nothing(reach_rad: float) -> None:
    assert_same_if_given_twice(made(reach_rad), CAMERA)


def test_one_frame_is_enough_and_the_same_as_twenty_times() -> None:
    (frame,) = made(0.0, 1)
    once, (result,) = track([frame], CAMERA)
    often, results = track([replace(frame, index=k, timestamp_s=k / 30) for k in range(20)], CAMERA)
    assert len(once.objects) == len(SCENE) - 1, "each thing on the table"
    assert len(result.sightings) == len(once.objects)
    for seen in once.objects:
        assert 0.0 < seen.probability < 1.0
        assert min(np.linalg.norm(seen.box.center - thing.center) for thing in SCENE[1:]) < 0.03
    assert [shown(one) for one in results] == [shown(result)] * 20
    assert [(one.label, one.probability) for one in often.objects] == [
        (one.label, one.probability) for one in once.objects
    ]


def test_a_first_frame_given_fifteen_times_and_others_ten_times_change_nothing() -> None:
    frames = made(REACHES["moving camera"], 12)
    often = [frame for frame in frames for _ in range(15 if frame.index == 0 else 10)]
    once, results = track(frames, CAMERA)
    again, repeated = track([replace(frame, index=k) for k, frame in enumerate(often)], CAMERA)
    assert [shown(one) for one in repeated[14::10]] == [shown(one) for one in results]
    assert len(once.objects) > 0
    assert [(one.label, one.box.corners().tobytes()) for one in again.objects] == [
        (one.label, one.box.corners().tobytes()) for one in once.objects
    ]


def test_a_camera_that_writes_into_the_same_memory_gives_new_frames() -> None:
    frames = made(0.0, 8)
    _, expected = track(frames, CAMERA)
    color, depth_m, tracker, found = frames[0].color.copy(), frames[0].depth_m.copy(), Tracker(CAMERA), []
    for frame in frames:
        color[:], depth_m[:] = frame.color, frame.depth_m
        found.append(tracker.update(replace(frame, color=color, depth_m=depth_m)))
    assert [shown(one) for one in found] == [shown(one) for one in expected]


@pytest.fixture(scope="module", params=REACHES.values(), ids=REACHES)
def whole(request: pytest.FixtureRequest) -> tuple[list[Frame], Tracker]:
    """Two seconds at 30 Hz, and the tracker that got all frames."""
    frames = made(request.param, 60)
    return frames, track(frames, CAMERA)[0]


FEWER = {
    "15 Hz": slice(0, 60, 2),
    "10 Hz": slice(0, 60, 3),
    "5 Hz": slice(0, 60, 6),
    "a stretch left out": [*range(20), *range(40, 60)],
}


@pytest.mark.parametrize("kept", FEWER.values(), ids=FEWER)
def test_fewer_frames_give_the_same_objects_and_labels(
    whole: tuple[list[Frame], Tracker], kept: slice | list[int]
) -> None:
    frames, expected = whole
    some = frames[kept] if isinstance(kept, slice) else [frames[k] for k in kept]
    found = track(some, CAMERA)[0].objects
    assert [one.label for one in found] == [one.label for one in expected.objects] == [1, 2, 3]
    for one, other in zip(found, expected.objects, strict=True):
        np.testing.assert_allclose(one.box.center, other.box.center, atol=0.01)
        np.testing.assert_allclose(sorted(one.box.size), sorted(other.box.size), atol=0.01)


@pytest.mark.parametrize(("name", "poses"), [("office-scan", "given"), ("desk-realsense", "estimated")])
def test_real_frames_given_twice_change_nothing(data_dir: Path, name: str, poses: str) -> None:
    recording = open_recording(data_dir / name)
    frames = [frame for frame in islice(recording, 24) if isinstance(frame, Frame)]
    assert_same_if_given_twice(frames, recording.intrinsics, poses)
