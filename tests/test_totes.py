"""Totes: objects that touch each other in a tote have labels of their own."""

from __future__ import annotations

from pathlib import Path

from cuboid import open_recording
from cuboid.ground.geometry.overlap import iou
from cuboid.lab.evaluation.truth import read_truth
from cuboid.lab.synthetic import make_scene, render_recording
from cuboid.runs.tracking.posed_tracker import PosedTracker


def test_objects_that_touch_in_a_tote_have_boxes_of_their_own(tmp_path: Path) -> None:
    render_recording(make_scene("bin", 503, frames=30), tmp_path / "bin", size=(320, 240))
    recording, truth = open_recording(tmp_path / "bin"), read_truth(tmp_path / "bin" / "truth.json")
    tracker = PosedTracker(recording.intrinsics)
    for frame in recording:
        tracker.update(frame)
    # Five objects that touch their neighbours: a parcel, a box, a can, a jar and a mug.
    overlaps = [max(iou(found.box, item.at(29)) for found in tracker.objects) for item in truth.objects]
    assert sum(overlap > 0.25 for overlap in overlaps) >= 4, overlaps
