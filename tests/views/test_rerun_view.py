"""`--rerun`: what a run tells the rerun viewer while it goes."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from cuboid.cli import main
from cuboid.ground.core.errors import MissingExtraError, OutputError
from cuboid.results.views.rerun_view import SPAWNED, RerunView
from fakes import INTRINSICS, FakeTracker, write_recording


def test_without_the_sdk_one_line_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"'--rerun' needs rerun, .* pip install '\.\[rerun\]'"):
        RerunView(SPAWNED, "recording", INTRINSICS)


def test_a_run_is_written_while_it_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rerun", reason="the rerun SDK (170 MB) is not installed: pip install '.[rerun]'")
    monkeypatch.setattr("cuboid.runs.pipeline.run._tracker", FakeTracker)
    recording, file = write_recording(tmp_path / "recording", 6), tmp_path / "run.rrd"
    words = ["track", str(recording), "--output", str(tmp_path / "out"), "--rerun", str(file)]
    assert main(words) == 0
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "print", str(file)], capture_output=True, text=True, check=True
    )
    for entity in (
        "world",
        "world/map",
        "world/planes/0",
        "world/objects/1",
        "world/camera",
        "world/camera_path",
        "world/camera/image",
        "world/camera/image/objects",
        "world/camera/depth",
    ):
        assert f" /{entity} " in done.stdout, entity
    assert (
        sum(int(n) for n in re.findall(r"(\d+) rows?.* /world/camera/depth ", done.stdout)) == 7
    )  # six frames and the pinhole
    with pytest.raises(OutputError, match="exists; name another file"):
        RerunView(str(file), "recording", INTRINSICS)


def test_a_file_in_no_folder_is_one_line(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the rerun SDK (170 MB) is not installed: pip install '.[rerun]'")
    with pytest.raises(OutputError, match="there is no folder"):
        RerunView(str(tmp_path / "none" / "a.rrd"), "recording", INTRINSICS)
