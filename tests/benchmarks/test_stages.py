from __future__ import annotations

import sys
from pathlib import Path

from cuboid import open_recording
from cuboid.lab.synthetic import make_scene, render_recording
from stages import STAGES, measure


def test_all_stages_are_measured_on_the_same_frames(tmp_path: Path) -> None:
    render_recording(make_scene("table", 3, frames=16), tmp_path / "table", size=(320, 240))
    found = measure(open_recording(tmp_path / "table"), Path(sys.executable), 14, ["OpenCV"])
    assert list(found) == ["Cuboid", "OpenCV"]
    for row in found.values():
        assert row["frames"] == 14
        assert all(row[stage] > 0 for stage in STAGES)
        assert row["ATE cm"] < 5.0
    assert found["Cuboid"]["fusion"] < found["Cuboid"]["whole, given poses"] < found["Cuboid"]["whole, own poses"]
    assert found["Cuboid"]["labels"] > 0
