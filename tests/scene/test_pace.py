"""Work beside a tracker takes its share of the time, a little at a stretch; who waits for it does not wait long."""

from __future__ import annotations

import threading
import time
from itertools import pairwise

import numpy as np

from cuboid.config import TrackerConfig
from cuboid.geometry.box import Box
from cuboid.objects.entry import MapObject, together
from cuboid.scene.freezing import Freezer, freeze
from cuboid.scene.pace import Pace
from cuboid.tracker import Tracker
from worlds import CAMERA

PIECES, PIECE_S, SHARE = 20, 0.0022, 0.2


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
    pace, ended = Pace(SHARE, 60.0), list[tuple[float, float]]()
    thread = threading.Thread(target=work, args=(pace, ended))
    thread.start()
    while thread.is_alive():
        burn(0.002)
        time.sleep(0)
    rests = [after - before for before, after in ended]
    assert np.median(rests) > 0.9 * PIECE_S * (1 / SHARE - 1), "the others have their share between two pieces"
    assert all(later[0] > earlier[1] for earlier, later in pairwise(ended))


def test_who_waits_and_who_is_alone_need_not_wait_long() -> None:
    for hurried, pace in ((True, Pace(SHARE, 60.0)), (False, Pace(SHARE, 0.2))):
        thread = threading.Thread(target=work, args=(pace, []))
        thread.start()
        time.sleep(0.05)
        if hurried:
            pace.hurry()
        thread.join(30.0)
        assert not thread.is_alive()


def test_what_was_taken_stays_as_it_was() -> None:
    """It is turned into parts in another thread while the tracker goes on."""
    tracker, freezer = Tracker(CAMERA, TrackerConfig()), Freezer()
    store = tracker._map.store
    entries = [store.add(Box(np.full(3, float(k)), np.full(3, 0.1), np.eye(3)), k) for k in range(3)]
    expected, taken = freeze(tracker), freezer.take(tracker)
    _change(entries[1])
    store.retire(entries[2])
    first = freezer.parts(taken)
    assert repr(first) == repr(expected)
    second = freezer.freeze(tracker)
    assert repr(second) == repr(freeze(tracker))
    assert second["MapObject 1"] is first["MapObject 1"], "what did not change is the same part"
    assert second["MapObject 2"] is not first["MapObject 2"]
    assert "MapObject 3" not in second


def _change(entry: MapObject) -> None:
    entry.log_odds, entry.supports = 1.5, together(entry.supports, {1: 4})
    entry.points = np.ones((5, 3), np.float32)
