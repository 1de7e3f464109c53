"""What a camera that stands still sees of a place that has changed since it was there last."""

from __future__ import annotations

import numpy as np

from cuboid.runs.tracking.posed_tracker import PosedTracker
from made_scenes import CAMERA, frame_of, look_at, upright

TABLE = upright((0, 0), (1.6, 1.2, 0.04), z=-0.04)
STAYS = upright((-0.3, 0.1), (0.2, 0.15, 0.2), 0.4)
TAKEN = upright((0.3, -0.1), (0.12, 0.18, 0.15), -0.2)
# What a label takes with some to spare, and what certainty takes that a thing is gone: until the other one confirms the
# pose, which takes a second, and then 1.3 s.
FRAMES, MISSED_FRAMES = 12, 75


def eye(k: int) -> np.ndarray:
    turn = -2.0 + 0.02 * k
    return look_at((1.1 * np.cos(turn), 1.1 * np.sin(turn), 0.9), (0, 0, 0.05))


def test_a_still_camera_sees_what_was_taken_since_the_last_visit() -> None:
    tracker = PosedTracker(CAMERA)
    for k in range(FRAMES):
        tracker.update(frame_of([TABLE, STAYS, TAKEN], eye(k), k))
    before = {o.label: o.box.center for o in tracker.objects}
    (taken,) = [label for label, center in before.items() if np.linalg.norm(center - TAKEN.center) < 0.05]
    tracker.begin_visit()
    for k in range(FRAMES, FRAMES + MISSED_FRAMES):
        tracker.update(frame_of([TABLE, STAYS], eye(FRAMES), k))
    assert {o.label for o in tracker.objects} == set(before) - {taken}
