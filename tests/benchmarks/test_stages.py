from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from cuboid import open_recording
from cuboid.lab.synthetic import make_scene, render_recording
from made_scenes import look_at
from stages import STAGES, figures, measure, timed_poses


def test_all_stages_are_measured_on_the_same_frames(tmp_path: Path) -> None:
    render_recording(make_scene("table", 3, frames=16), tmp_path / "table", size=(320, 240))
    found = measure(open_recording(tmp_path / "table"), Path(sys.executable), 14, ["OpenCV"])
    assert list(found) == ["Cuboid", "OpenCV"]
    for row in found.values():
        assert row["frames"] == 14
        assert all(row[stage] > 0 for stage in STAGES)
        assert row["ATE cm"] < 5.0
    assert found["Cuboid"]["labels"] > 0


def test_poses_are_compared_frame_by_frame_where_one_has_none() -> None:
    true = {k: look_at((np.cos(k), np.sin(k), 0.8), (0.0, 0.0, 0.0)) for k in range(6)}
    times_s = {k: 0.1 * k for k in true}
    truth = timed_poses(Path("true"), true, times_s)
    without = timed_poses(Path("found"), {k: T for k, T in true.items() if k != 2}, times_s)
    assert figures([{"count": 1}], without, truth)["ATE cm"] == pytest.approx(0.0, abs=1e-6)
