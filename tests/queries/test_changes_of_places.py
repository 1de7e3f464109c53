"""Changes of a map, found by comparing objects and told by a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cuboid.ground.core.results import ObjectEvent, TrackedObject
from cuboid.services.queries.answers import MapChange
from cuboid.services.queries.changes import KEPT_CHANGES, MOVED_M, ChangeLog
from made_place import OBJECTS


def moved(item: TrackedObject, by_m: float) -> TrackedObject:
    return replace(item, box=replace(item.box, center=item.box.center + np.array([by_m, 0.0, 0.0])))


def test_each_kind_of_change() -> None:
    log, heard = ChangeLog(), list[MapChange]()
    one, two, three, four, _ = OBJECTS
    log.update([one, two, three])
    stop = log.listen(heard.extend)
    log.update([moved(one, 2 * MOVED_M), replace(two, name="tin"), replace(four, merged_labels=(3,))])
    assert [(one.number, one.change, one.label) for one in heard] == [
        (1, "moved", 1),
        (2, "renamed", 2),
        (3, "confirmed", 4),
        (4, "merged", 3),
    ]
    assert heard[0].from_m == (-0.5, 0.0, 0.56)
    assert heard[3].into == 4
    log.update([replace(two, name="tin")])
    assert [(one.change, one.label) for one in log.after(4)] == [("gone", 1), ("gone", 4)]
    stop()
    log.update([])
    assert (len(heard), log.last) == (6, 7)


def test_small_steps_add_up_to_a_move() -> None:
    log, item = ChangeLog(), OBJECTS[0]
    steps = [moved(item, 0.4 * k * MOVED_M) for k in range(6)]
    for step in steps:
        log.update([step])
    assert [one.change for one in log.after(0)] == ["moved"]


def test_events_of_a_run_are_told_with_the_others() -> None:
    log = ChangeLog()
    log.update(OBJECTS)
    log.add_events([ObjectEvent("back", 5, None, np.array([1.0, 2.0, 3.0]), 0.9)])
    (event,) = log.after(0)
    assert (event.change, event.label, event.name, event.to_m) == ("back", 5, "mug", (1.0, 2.0, 3.0))


def test_the_list_is_bounded() -> None:
    log = ChangeLog()
    log.update([])

    def flip(objects: Sequence[TrackedObject]) -> None:
        log.update(objects)

    for k in range(KEPT_CHANGES):
        flip(OBJECTS[: 1 + k % 2])
    assert len(log.after(0)) <= KEPT_CHANGES
    assert log.last >= KEPT_CHANGES - 1
