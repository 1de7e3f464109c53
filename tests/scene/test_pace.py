"""Commits come in time; work beside a tracker takes its share, a little at a stretch; who waits does not wait long."""

from __future__ import annotations

import threading
import time
from itertools import pairwise

import numpy as np
import pytest

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.geometry.box import Box
from cuboid.method.objects.entry import MapObject, summed_counts
from cuboid.runs.scene.codec import Encoder, take
from cuboid.runs.scene.pace import CommitTimer, Pace
from cuboid.runs.tracking.posed_tracker import PosedTracker
from worlds import CAMERA

PIECES, PIECE_S, FRACTION = 20, 0.0022, 0.2


def burn(seconds: float) -> None:
    begun_s = time.thread_time()
    while time.thread_time() - begun_s < seconds:
        pass


def work(pace: Pace, ended: list[tuple[float, float]]) -> None:
    """Work piece by piece, noting the processor time of the process before each rest and after it."""
    for _ in range(PIECES):
        burn(PIECE_S)
        begun_s = time.process_time()
        pace.rest()
        ended.append((begun_s, time.process_time()))


def test_work_is_spread_over_what_the_others_do() -> None:
    pace, ended = Pace(FRACTION, 60.0), list[tuple[float, float]]()
    thread = threading.Thread(target=work, args=(pace, ended))
    thread.start()
    while thread.is_alive():
        burn(0.002)
        time.sleep(0)
    rests = [after - before for before, after in ended]
    assert np.median(rests) > 0.9 * PIECE_S * (1 / FRACTION - 1), "the others have their share between two pieces"
    assert all(later[0] > earlier[1] for earlier, later in pairwise(ended))


def test_where_others_have_the_processor_work_is_spread_over_its_time() -> None:
    """Nobody works beside it: by shares it would rest until its time is over, and do all at the end."""
    begun_s, ended = time.monotonic(), list[float]()
    pace = Pace(FRACTION, 1.0, PIECES * PIECE_S)
    for _ in range(PIECES):
        burn(PIECE_S)
        pace.rest()
        ended.append(time.monotonic() - begun_s)
    assert ended[PIECES // 2 - 1] < 0.8
    assert max(later - earlier for earlier, later in pairwise(ended)) < 0.5


def test_who_waits_and_who_is_alone_need_not_wait_long() -> None:
    for hurried, pace in ((True, Pace(FRACTION, 60.0)), (False, Pace(FRACTION, 0.2))):
        thread = threading.Thread(target=work, args=(pace, []))
        thread.start()
        time.sleep(0.05)
        if hurried:
            pace.hurry()
        thread.join(30.0)
        assert not thread.is_alive()


def commits(monkeypatch: pytest.MonkeyPatch, cost_s: float, height_fraction: float) -> list[float]:
    """Return how long the commits of a minute wait, each of some cost, given a fraction of the processor."""
    now_s = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(time, "process_time", lambda: height_fraction * now_s[0])
    timer, begun = CommitTimer(1.0), [now_s[0]]
    while now_s[0] < 160.0:
        now_s[0] += 0.01
        if timer.due():
            begun.append(now_s[0])
            timer.begin(cost_s / 2)
            timer.cost_s += cost_s / 2
    monkeypatch.undo()
    return [after - before for before, after in pairwise(begun)][1:]


def test_commits_come_as_often_as_they_should_or_as_they_cost_little(monkeypatch: pytest.MonkeyPatch) -> None:
    for cost_s, height_fraction, expected_s in (
        (0.04, 1.0, 1.0),
        (0.1, 1.0, 2.0),  # a twentieth
        (2.0, 1.0, 5.0),  # however much they cost
        (0.04, 0.2, 2.0),  # however little is left of the processor
        (0.1, 0.2, 4.0),
        (0.1, 0.8, 2.5),
    ):
        waits_s = commits(monkeypatch, cost_s, height_fraction)
        assert waits_s == pytest.approx([expected_s] * len(waits_s), abs=0.03)
        assert len(waits_s) > 5


def test_what_was_taken_stays_as_it_was() -> None:
    """It is encoded in another thread while the tracker goes on."""
    tracker, encoder = PosedTracker(CAMERA, TrackerConfig()), Encoder()
    store = tracker._map.store
    entries = [store.add(Box(np.full(3, float(k)), np.full(3, 0.1), np.eye(3)), k) for k in range(3)]
    expected, taken = Encoder().parts(take(tracker.state())), take(tracker.state())
    _change(entries[1])
    store.retire(entries[2])
    first = encoder.parts(taken)
    assert repr(first) == repr(expected)
    second = encoder.parts(take(tracker.state()))
    assert repr(second) == repr(Encoder().parts(take(tracker.state())))
    assert second["map/store/objects/1"] is first["map/store/objects/1"], "what did not change is the same part"
    assert second["map/store/objects/2"] is not first["map/store/objects/2"]
    assert "map/store/objects/3" not in second


def _change(entry: MapObject) -> None:
    entry.probability, entry.supports = 0.4, summed_counts(entry.supports, {1: 4})
    entry.points = np.ones((5, 3), np.float32)
