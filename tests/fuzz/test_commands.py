"""Command lines put together at random: each is done, or refused in one line."""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest
from engine import alarm, quiet_libraries
from mutations import WORDS
from scene_files import SCENES
from targets import TARGETS

import cuboid.runs.pipeline.run
from cuboid.cli import main
from fakes import FakeTracker

COMMANDS = (
    "track", "evaluate", "evaluate trajectory", "render", "report", "export", "slam", "calibrate", "synth", "bench",
    "info", "convert", "find", "sql", "scene", "store compact", "completion",
)  # fmt: skip
OPTIONS = (
    "--output", "--force", "--poses", "--every", "--limit", "--scale", "--proposals", "--intrinsics", "--depth-scale",
    "--format", "--set", "--threads", "--recording", "--to", "--json", "--plot", "--within", "--cloud", "--trajectory",
    "--show", "--gif", "--no-pictures", "--meshes", "--kind", "--seed", "--faults", "--help", "--version", "--unknown",
    "--scene", "--same-world", "--resume", "--since", "--recording", "--picture", "--rescue", "--near", "--size",
    "--like",
)  # fmt: skip
VALUES = (
    "recording", "results", "truth.json", "cloud.ply", "true_trajectory.txt", "new", "new.json", "new.csv", "new.png",
    "given", "estimated", "heat", "1", "2", "ply", "coco", "kitti", "json", "csv", "mcap", "table", "plain", "tum",
    "voxel_m=0.02", "voxel_m=nan", "min_size_m=9", "edgeboxes", "precomputed:results", "onnx:truth.json", "64,64,32,24",
    "64,64,nan,24",
    "a.cuboid", "2026-01-01", "0001-01-01T00:00+05:00", "1,2,3", "select 1",
    "camera.json", "1000", "--", "-1", *(word for word in WORDS if "\x00" not in word),
)  # fmt: skip
# More with CUBOID_LINES=5000.
LINES = int(os.environ.get("CUBOID_LINES", "350"))


def line(rng: random.Random) -> list[str]:
    """Return a command line, most of which make some sense."""
    words = [rng.choice(COMMANDS) if rng.random() < 0.95 else rng.choice(VALUES)]
    words += rng.choices(("results", "recording", "truth.json", rng.choice(VALUES)), k=rng.choice((0, 1, 1, 2)))
    for _ in range(rng.choice((0, 1, 2, 4))):
        words += [rng.choice(OPTIONS), *([rng.choice(VALUES)] if rng.random() < 0.8 else [])]
    if rng.random() < 0.5:
        words += ["--output", rng.choice(("new", "new.json", "new.csv", "results", "recording", "truth.json"))]
    if words[0] == "scene":
        words[1:1] = [rng.choice(("list", "show", "changes", "name", "merge", "forget", "export", "compact", "check"))]
    if words[0] == "synth":
        words += ["--frames", "2", "--size", "80x60", "--workers", "1"]
    return words


# Lines that may follow an error: what a folder without a recording holds, and which layouts are near.
NOTES = ("  seen: ", "  near: ")


def test_any_command_line_is_done_or_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    quiet_libraries()
    TARGETS["results"].make(tmp_path)
    SCENES["scenes"].make(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cuboid.runs.pipeline.run, "_tracker", FakeTracker)
    done = 0
    for number in range(LINES):
        words = line(random.Random(number))
        try:
            with alarm(30.0):
                status = main(words)
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 1
        said = capsys.readouterr()
        assert status in (0, 2), (words, said.err)
        assert "Traceback" not in said.err, words
        assert "\x1b" not in said.out + said.err, words
        if status == 2:
            lines = [text for text in said.err.splitlines() if not text.startswith("cuboid: warning")]
            errors = [text for text in lines if not text.startswith(NOTES)]
            assert len(errors) == 1, (words, said.err)
            assert lines[0] == errors[0], (words, said.err)
            assert errors[0].startswith("cuboid: error: "), words
            assert len(errors[0]) < 300, words
        done += status == 0
    assert 10 < done < LINES - 10
