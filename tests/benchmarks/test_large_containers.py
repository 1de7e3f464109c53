from __future__ import annotations

import json
import sys

import pytest

pytest.importorskip("rosbags", reason="bags are written with rosbags: pip install '.[ros]'")

from pathlib import Path

import numpy as np

import large_containers
from cuboid.cli import main

# The tracker's map grows with what is seen; a container kept in memory would take ten times as much.
MAX_GROWTH_MB = 15.0
MEGABYTES, FRAMES = 150, 20


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("made") / "table"
    words = ["synth", "--output", str(path), "--frames", "12", "--size", "160x120", "--workers", "1"]
    assert main(words) == 0
    return path


@pytest.mark.parametrize("kind", ["bag", "mkv", "sens", "zip"])
def test_a_large_container_opens_at_once_and_takes_no_more_memory_at_its_end(
    table: Path, tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["large_containers.py", str(table), kind, "--gigabytes", str(MEGABYTES / 1000), "--frames", str(FRAMES)]
    monkeypatch.setattr(sys, "argv", [*words, "--folder", str(tmp_path), "--json"])
    assert large_containers.main() == 0
    (found,) = json.loads(capsys.readouterr().out)
    assert found["frames"] == FRAMES
    assert found["gb"] > 0.9 * MEGABYTES / 1000
    assert found["mb"]["1.0"] - found["mb"]["0.5"] < MAX_GROWTH_MB
    if kind == "sens":  # with holes
        assert found["disk_gb"] < 0.1 * found["gb"]
    assert list(tmp_path.iterdir()) == []


def test_what_is_written_is_the_recording(table: Path, tmp_path: Path) -> None:
    from cuboid import open_recording

    recording = open_recording(table)
    source = large_containers.Source(recording, 15)
    for kind in ("bag", "sens", "zip"):
        (tmp_path / kind).mkdir()
        made = open_recording(large_containers.KINDS[kind](source, tmp_path / kind, 10_000))
        np.testing.assert_array_equal(made.read(3).color, recording.read(3).color)
        np.testing.assert_allclose(made.read(3).depth_m, recording.read(3).depth_m, atol=6e-4)
        np.testing.assert_allclose(made.read(3).T_world_camera, recording.read(3).T_world_camera, atol=1e-5)
