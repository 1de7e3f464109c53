"""Two touching boxes side by side, and what detections over them say."""

from __future__ import annotations

import numpy as np
import pytest
from made_maps import box_of, map_of

from cuboid.method.detection.types import Detections
from cuboid.method.objects.affinity import DIFFERENT_LOG_ODDS, SAME_LOG_ODDS
from cuboid.method.objects.detection_votes import add_votes
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.visibility import Visibility

LEFT, RIGHT = (0, 0, 100, 100), (100, 0, 200, 100)
BOTH = (0, 0, 200, 100)


def affinity_after(*rects: tuple[int, ...], gap_m: float = 0.0, beside: bool = True, weight: float = 0.5) -> float:
    grid = np.stack(np.meshgrid(*[np.arange(0.0, 0.1, 0.01)] * 3), -1).reshape(-1, 3).astype(np.float32)
    points = grid, grid + np.array([0.1 + gap_m, 0.0, 0.0], np.float32)
    store = ObjectStore(map_of((points[0], 1), (points[1], 2)))
    entries = [store.add(box_of(own), 0) for own in points]
    for entry, own in zip(entries, points, strict=True):
        entry.points = own
    if beside:
        store.affinity.add_evidence(1, 2, SAME_LOG_ODDS, novelty=0.0)
    visible = [
        (entry, Visibility(1.0, np.array(rect, np.float64), True))
        for entry, rect in zip(entries, (LEFT, RIGHT), strict=True)
    ]
    found = Detections(np.array(rects, np.int32).reshape(-1, 4), np.full((len(rects), 1), 0.3, np.float32), ("cup",))
    add_votes(found, visible, store, weight)
    return store.affinity.of(1, 2) or 0.0


def test_two_detections_are_a_vote_for_two() -> None:
    assert affinity_after(LEFT, RIGHT) == pytest.approx(0.5 * DIFFERENT_LOG_ODDS)
    assert affinity_after(LEFT, RIGHT, BOTH) == pytest.approx(0.5 * DIFFERENT_LOG_ODDS)


def test_one_detection_over_both_is_a_vote_for_one() -> None:
    wide = (0, 0, 210, 105)
    assert affinity_after(wide) == pytest.approx(0.5 * SAME_LOG_ODDS)


@pytest.mark.parametrize("rects", [(), (LEFT,), ((0, 0, 130, 100),), ((300, 0, 400, 100), LEFT)])
def test_other_detections_are_no_votes(rects: tuple[tuple[int, ...], ...]) -> None:
    assert affinity_after(*rects) == 0.0


def test_objects_that_do_not_touch_or_were_never_seen_side_by_side_get_no_votes() -> None:
    assert affinity_after(LEFT, RIGHT, gap_m=0.2) == 0.0
    assert affinity_after(LEFT, RIGHT, beside=False) == 0.0
