from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from cuboid import open_recording
from cuboid.lab.evaluation import read_keyframes
from cuboid.lab.evaluation.keyframes import check_frames
from place_list import FURTHER

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks" / "truth"
FILES = sorted(FOLDER.glob("*.json"))
JUDGED = 0.3


def recording_of(path: Path) -> str:
    return path.stem.removesuffix("-second").removesuffix("-third")


# Those of recordings that are among the data of the tests.
WITH_RECORDING = [path for path in FILES if recording_of(path) not in {place.name for place in FURTHER}]


def test_the_table_of_drawn_truth_says_what_the_files_hold() -> None:
    rows = re.findall(
        r"^\| `(\S+)` \|.*\| (\d+) \| (\d+) \| (\d+) \| (\d+) \|$", (FOLDER / "README.md").read_text(), re.M
    )
    held = {}
    for path in FILES:
        drawn = [item for frame in read_keyframes(path).frames for item in frame.drawn]
        seen = sum(item.visible >= JUDGED for item in drawn)
        held[path.name] = (len(read_keyframes(path).frames), len(drawn), seen, len(read_keyframes(path).objects))
    assert held
    assert {name: tuple(map(int, figures)) for name, *figures in rows} == held


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_drawn_things_have_names_and_the_file_says_how_it_was_drawn(path: Path) -> None:
    document = json.loads(path.read_text())
    named = {item["id"] for item in document["objects"] if item["name"]}
    assert {box["id"] for frame in document["frames"] for box in frame["boxes"]} == named
    assert "by hand" in document["note"]


@pytest.mark.parametrize("path", WITH_RECORDING, ids=lambda path: path.stem)
def test_drawn_truth_lies_in_the_pictures_of_its_recording(path: Path, data_dir: Path) -> None:
    recording = open_recording(data_dir / recording_of(path))
    keyframes = read_keyframes(path)
    check_frames(keyframes, recording)
    width, height = recording.intrinsics.width, recording.intrinsics.height
    for frame in keyframes.frames:
        recording.read(frame.frame)  # refuses a frame without depth
        assert frame.rects_xyxy.min() >= 0
        assert (frame.rects_xyxy[:, 2:] <= [width, height]).all()
