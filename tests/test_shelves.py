"""Shelves: found from afar by their boards, and no object themselves."""

from __future__ import annotations

import numpy as np

from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou
from cuboid.runs.tracking.posed_tracker import PosedTracker
from made_scenes import CAMERA, frame_of, look_at, upright

FLOOR = upright((0, 0), (8, 8, 0.1), z=-0.1)
WALL = upright((0, 0.75), (8, 0.1, 2.6))
# A shelf of 1 m, 0.8 m high: sides that rise above its board, a back, a board half way up.
SHELF = [
    upright((-0.49, 0.5), (0.02, 0.34, 0.8)),
    upright((0.49, 0.5), (0.02, 0.34, 0.8)),
    upright((0, 0.66), (0.96, 0.02, 0.8)),
    upright((0, 0.5), (0.96, 0.34, 0.02), z=0.36),
    upright((0, 0.5), (0.96, 0.34, 0.02), z=0.76),
]
THINGS = [upright((-0.2, 0.48), (0.14, 0.1, 0.2), 0.3, z=0.78), upright((0.22, 0.5), (0.12, 0.12, 0.12), 0.1, z=0.78)]


def walk(first_m: float, last_m: float, frames: int) -> PosedTracker:
    """What is known after a walk towards the shelf, from so far to so far, at 15 Hz."""
    tracker, way = PosedTracker(CAMERA), np.linspace(first_m, last_m, frames)
    for k in range(0, frames, 2):
        away = way[k]
        T = look_at((0.3 * np.sin(k / 12), 0.5 - away, 1.3), (0, 0.5, 0.6))
        tracker.update(frame_of([FLOOR, WALL, *SHELF, *THINGS], T, k, noise_per_m=1.4e-3))
    return tracker


def best(tracker: PosedTracker, thing: Box) -> float:
    return max((iou(o.box, thing) for o in tracker.objects), default=0.0)


def test_things_on_a_shelf_are_told_from_it_three_metres_away() -> None:
    tracker = walk(3.0, 2.6, 40)
    assert any(abs(p.offset + 0.78) < 0.03 for p in tracker.planes)
    assert len(tracker.objects) == 2
    assert all(best(tracker, thing) > 0.25 for thing in THINGS)


def test_no_part_of_a_shelf_is_an_object() -> None:
    tracker = walk(2.8, 1.4, 70)
    assert all(best(tracker, thing) > 0.6 for thing in THINGS)
    on_top = [o for o in tracker.objects if o.box.center[2] > 0.74]
    assert len(on_top) == 2
    beneath = [o for o in tracker.objects if o.box.center[2] < 0.74]
    assert not beneath, [o.box for o in beneath]
