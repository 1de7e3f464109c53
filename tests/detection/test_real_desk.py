"""A detector beside depth on a real desk: more of it is found, and its names are right."""

from __future__ import annotations

from pathlib import Path

from cuboid import ResultOptions, TrackOptions, open_recording, track_recording
from cuboid.lab.evaluation import evaluate_keyframes
from cuboid.lab.evaluation.evaluate_keyframes import KeyframeEvaluation

# The keyframes up to here show the desk with its screens, keyboard and mice.
FRAMES = 120


def judged(data_dir: Path, output: Path, detector: str | None) -> KeyframeEvaluation:
    recording = data_dir / "desk-realsense"
    track_recording(
        open_recording(recording),
        output,
        TrackOptions(limit=FRAMES, detector=detector),
        results=ResultOptions(page=False),
    )
    return evaluate_keyframes(output, recording / "keyframes.json")


def test_screens_and_keyboards_are_found_and_named(data_dir: Path, tmp_path: Path) -> None:
    plain = judged(data_dir, tmp_path / "plain", None)
    found = judged(data_dir, tmp_path / "found", str(data_dir / "yolox-nano" / "yolox_nano.onnx"))
    before, after = plain.at[0], found.at[0]
    assert plain.names is None
    assert before.recall is not None
    assert after.recall is not None
    assert after.recall >= before.recall + 0.1
    assert after.false <= before.false + 1, "one rectangle is the resolution of this truth"
    assert found.names is not None
    assert found.names.right == found.names.named >= 3
