"""A fixed camera straight above a table: no side of an object is visible."""

from __future__ import annotations

import numpy as np

from cuboid import Tracker
from cuboid.ground.core.frame import Frame
from made_scenes import CAMERA, cast, look_at, upright

TABLE = upright((0.0, 0.0), (1.4, 1.0, 0.05), z=-0.05)
FLOOR = upright((0.0, 0.0), (6.0, 6.0, 0.05), z=-0.8)
BOXES = [
    upright((0.0, 0.0), (0.14, 0.08, 0.26)),
    upright((0.2, 0.08), (0.15, 0.09, 0.18)),
    upright((-0.2, -0.05), (0.2, 0.15, 0.15)),
]
COLORS = np.array([[120, 110, 100], [90, 90, 90], [200, 40, 40], [40, 160, 60], [50, 60, 190], [0, 0, 0]], np.uint8)


def test_boxes_of_which_only_the_tops_are_seen_are_found_down_to_the_table() -> None:
    pose = look_at((0.0, 1e-3, 0.9), (0.0, 0.0, 0.0))
    exact_m, surface = cast([TABLE, FLOOR, *BOXES], pose)
    rng = np.random.default_rng(1)
    tracker = Tracker(CAMERA, poses="given")
    for k in range(12):
        noise_m = 1.4e-3 * exact_m**2 * rng.standard_normal(exact_m.shape)
        depth_m = np.where(exact_m > 0, exact_m + noise_m, 0.0).astype(np.float32)
        tracker.update(Frame(k, k / 30.0, COLORS[surface], depth_m, pose))
    found = sorted((tuple(np.round(o.box.center[:2], 1)), float(o.box.size[2])) for o in tracker.objects)
    expected = sorted((tuple(np.round(box.center[:2], 1)), float(box.size[2])) for box in BOXES)
    assert [place for place, _ in found] == [place for place, _ in expected]
    np.testing.assert_allclose([height for _, height in found], [height for _, height in expected], atol=0.01)
