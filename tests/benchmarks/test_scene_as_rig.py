"""A real recording played as the recordings of two cameras, with one map."""

from __future__ import annotations

from pathlib import Path

import cuboid
from cuboid.lab.evaluation import evaluate
from cuboid.results.files import Results
from cuboid.runs.pipeline.options import ResultOptions
from rigs import as_two_cameras

# Frames of each camera: one in twenty.
EVERY = 20


def test_the_even_and_the_odd_frames_of_a_real_table_give_its_five_objects(data_dir: Path, tmp_path: Path) -> None:
    scene = data_dir / "rgbd-scenes-v2"
    rig = cuboid.open_recording(as_two_cameras(scene / "imgs" / "scene_01", tmp_path))
    options, made = cuboid.TrackOptions(every=EVERY), ResultOptions(page=False, furniture=False, relations=False)
    cuboid.track_recording(rig, tmp_path / "found", options, results=made)
    judged, found = evaluate(tmp_path / "found", scene / "ground_truth" / "01.json"), Results(tmp_path / "found")
    assert judged.map.objects == 5
    assert all(at.found == 5 for at in judged.map.at)
    assert judged.map.false_alarms == judged.map.fragments == 0
    even, odd = ({row.label for row in found.of_camera(name).tracks} for name in ("even", "odd"))
    assert {item.label for item in found.objects} <= even & odd
