"""Accuracy on two real recordings: recall, precision and labels, held against drawn truth within a band.

`benchmarks/places.py` judges alike, on more places. The counts below are those of the method on the day of this test;
whoever improves the method raises them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from cuboid import ResultOptions, open_recording, track_recording
from cuboid.lab.evaluation import evaluate_keyframes

DRAWN = Path(__file__).resolve().parents[1] / "benchmarks" / "truth"
# A result may have so many found rectangles fewer and so many false ones more, for each truth file.
BAND = 1


@dataclass(frozen=True, slots=True)
class Golden:
    """The counts of a recording against one truth file, at an IoU; 0.25 where the truth is loose."""

    recording: str
    truth: str
    iou: float
    rectangles: int
    found: int
    false: int
    objects_found: int


GOLDEN = (
    Golden("office-scan", "office-scan.json", 0.5, rectangles=26, found=20, false=1, objects_found=8),
    Golden("office-scan", "office-scan-second.json", 0.5, rectangles=24, found=15, false=2, objects_found=8),
    Golden("bin-robot-hand", "keyframes.json", 0.25, rectangles=30, found=30, false=10, objects_found=2),
)


@pytest.fixture(scope="module", params=sorted({golden.recording for golden in GOLDEN}))
def tracked(request: pytest.FixtureRequest, data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a recording, in a folder of its name."""
    output = tmp_path_factory.mktemp("tracked") / request.param
    track_recording(open_recording(data_dir / request.param), output, results=ResultOptions(page=False))
    return output


def test_recall_precision_and_labels_of_a_real_recording_stay_within_the_band(tracked: Path, data_dir: Path) -> None:
    for golden in [golden for golden in GOLDEN if golden.recording == tracked.name]:
        beside = data_dir / golden.recording / golden.truth
        judged = evaluate_keyframes(tracked, beside if beside.is_file() else DRAWN / golden.truth)
        at = next(at for at in judged.at if at.threshold == golden.iou)
        assert at.rectangles == golden.rectangles
        assert at.found >= golden.found - BAND, f"recall of {golden.truth}"
        assert at.false <= golden.false + BAND, f"precision of {golden.truth}"
        assert at.objects_found >= golden.objects_found - BAND
        assert at.one_label == 1.0, "each object keeps its label"
        labels = [label for item in judged.objects for label in set(item.labels)]
        assert len(labels) == len(set(labels)), "no two objects share a label"
