"""An object whose probability falls below the least one keeps its label, and no result contains it meanwhile."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import cuboid
from cuboid.ground.core.results import FrameResult, ObjectEvent
from cuboid.ground.geometry.box import Box
from cuboid.method.objects.entry import MapObject
from cuboid.method.objects.store.evidence import ObjectEvidence
from cuboid.results.files import Results
from cuboid.runs.scene import RecordingInfo, Scene
from cuboid.runs.tracking.posed_tracker import PosedTracker
from made_scenes import CAMERA, frame_of, look_at, upright

TABLE = upright((0.0, 0.0), (1.4, 1.0, 0.7), z=-0.7)
FLOOR = upright((0.0, 0.0), (8.0, 8.0, 0.1), z=-0.8)
THINGS = (upright((-0.25, 0.1), (0.12, 0.08, 0.15), 0.4), upright((0.2, -0.1), (0.1, 0.1, 0.1), 0.2))
LEAST, LOW, HIGH = 0.5, 0.3, 0.8
CONFIG = cuboid.TrackerConfig(min_probability=LEAST)

Judged = Callable[[float], None]


@pytest.fixture
def judge(monkeypatch: pytest.MonkeyPatch) -> Judged:
    """Give label 2 a probability from now on; all other objects have a high one."""
    of_second = [HIGH]

    def judged(store: ObjectEvidence, entry: MapObject, probability: float) -> None:
        entry.probability = of_second[0] if entry.label == 2 else HIGH

    def set_second(probability: float) -> None:
        of_second[0] = probability

    monkeypatch.setattr(ObjectEvidence, "judge", judged)
    return set_second


def frame(k: int, things: tuple[Box, ...] = THINGS) -> cuboid.Frame:
    angle = -0.6 + 0.03 * k - np.pi / 2
    return frame_of([FLOOR, TABLE, *things], look_at((1.3 * np.cos(angle), 1.3 * np.sin(angle), 0.8), (0, 0, 0.05)), k)


def show(tracker: cuboid.Tracker | PosedTracker, frames: range) -> FrameResult:
    for k in frames:
        result = tracker.update(frame(k))
        assert isinstance(result, FrameResult)
    return result


def test_results_leave_it_out_while_it_is_unlikely_and_its_label_stays(judge: Judged) -> None:
    tracker = PosedTracker(CAMERA, CONFIG)
    first = show(tracker, range(20))
    second = tracker.objects.find(2)
    assert {seen.label: seen.probability for seen in first.sightings} == {1: HIGH, 2: HIGH}
    assert (second.probability, second.score) == (HIGH, HIGH)

    judge(LOW)
    hidden = show(tracker, range(20, 24))
    assert [item.label for item in tracker.objects] == [1]
    assert [seen.label for seen in hidden.sightings] == [1]
    assert hidden.objects_known == 1
    assert {proposal.label for proposal in hidden.proposals} == {0, 1}
    assert {*tracker.map_points().label.tolist()} == {0, 1}

    judge(LEAST)
    again = show(tracker, range(24, 26))
    assert [seen.label for seen in again.sightings] == [1, 2]
    assert tracker.objects.find(2).frames_seen == second.frames_seen + 6
    assert (tracker.objects.find(2).first_frame, tracker.objects.find(2).last_frame) == (second.first_frame, 25)


def test_files_agree_about_it(judge: Judged, tmp_path: Path) -> None:
    tracker = cuboid.Tracker(CAMERA, CONFIG)
    show(tracker, range(20))
    judge(LOW)
    show(tracker, range(20, 24))
    tracker.save(tmp_path / "results", furniture=False)
    results = Results(tmp_path / "results")
    assert [item.label for item in results.objects] == [1]
    assert {*results.map_points().label.tolist()} == {0, 1}
    assert max(row.frame for row in results.tracks if row.label == 2) == 19
    assert {row.label for row in results.proposals if row.frame >= 20} == {0, 1}
    lines = csv.DictReader((tmp_path / "results" / "tracks.csv").read_text().splitlines())
    assert {float(line["probability"]) for line in lines} == {HIGH}
    (entry,) = json.loads((tmp_path / "results" / "objects.json").read_text())["objects"]
    assert (entry["score"], entry["probability"]) == (HIGH, HIGH)
    assert results.report.config["tracker"]["min_probability"] == LEAST


def test_no_event_names_it(judge: Judged) -> None:
    assert [(event.event, event.label) for event in events_of_a_move(lambda: None)] == [("moved", 2)]
    judge(HIGH)
    assert events_of_a_move(lambda: judge(LOW)) == []


def events_of_a_move(before: Callable[[], None]) -> list[ObjectEvent]:
    """Carry the second thing across the table before a camera at rest; return the events."""
    tracker, events, count = PosedTracker(CAMERA, CONFIG), list[ObjectEvent](), 0

    def show_second(x: float, y: float, z: float) -> None:
        nonlocal count
        things = THINGS[0], upright((x, y), (0.12, 0.12, 0.15), z=z)
        seen_from = look_at((0.0, -1.1, 0.8), (0.0, 0.0, 0.0))
        events.extend(tracker.update(frame_of([FLOOR, TABLE, *things], seen_from, count)).events)
        count += 1

    for _ in range(75):
        show_second(0.05, -0.1, 0.0)
    assert [item.label for item in tracker.objects] == [1, 2]
    before()
    for up in np.linspace(0.0, 0.25, 9):
        show_second(0.05, -0.1, up)
    for along in np.linspace(0.05, 0.4, 12):
        show_second(along, -0.1, 0.25)
    for down in np.linspace(0.25, 0.0, 9):
        show_second(0.4, -0.1, down)
    for _ in range(30):
        show_second(0.4, -0.1, 0.0)
    return events


def test_a_scene_keeps_it_as_unlikely(judge: Judged, tmp_path: Path) -> None:
    with Scene.open(tmp_path / "place.cuboid") as scene:
        source = RecordingInfo("/made", "made", "given", 24, CAMERA, {"every": 1})
        tracker = scene.tracker(CAMERA, CONFIG, source=source)
        for k in range(24):
            if k == 20:
                judge(LOW)
            tracker.update(frame(k))
        tracker.close()
    with Scene.open(tmp_path / "place.cuboid") as scene:
        assert [item.label for item in scene.objects] == [1]
        assert [(item.label, item.state) for item in scene.all_objects] == [(1, "present"), (2, "unlikely")]
        assert {*scene.map_points().label.tolist()} == {0, 1}
        scene.write_results(tmp_path / "results")
    assert [item.label for item in Results(tmp_path / "results").objects] == [1]
