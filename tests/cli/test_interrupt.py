from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cuboid.results.files import read_run, read_tracks
from fakes import write_recording
from slowed import SAID, slowed, started


def start(recording: Path, output: Path) -> subprocess.Popen[str]:
    step = f"{SAID}; time.sleep(1.0 if frame.index == 4 else 0.01)"
    return started(slowed(step, "track", recording, "--output", output), 4)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_what_is_done_is_written_and_marked(tmp_path: Path, number: signal.Signals, status: int) -> None:
    process = start(write_recording(tmp_path / "recording", 200), tmp_path / "out")
    process.send_signal(number)
    out, err = process.communicate(timeout=20)
    assert process.returncode == status, err
    assert "Traceback" not in err
    assert "incomplete" in err
    run = read_run(tmp_path / "out" / "run.json")
    assert not run.complete
    assert 5 <= run.frames_used < 200
    assert read_tracks(tmp_path / "out" / "tracks.csv")[-1].frame == run.frames_used - 1
    assert f"{run.frames_used} of" in out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "recording"]


def test_the_second_ctrl_c_drops_everything(tmp_path: Path) -> None:
    process = start(write_recording(tmp_path / "recording", 200), tmp_path / "out")
    for _ in range(2):
        process.send_signal(signal.SIGINT)
        time.sleep(0.01)
    _, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert "nothing was written" in err
    assert [path.name for path in tmp_path.iterdir()] == ["recording"]


def test_a_killed_run_leaves_nothing_that_looks_whole(tmp_path: Path) -> None:
    process = start(write_recording(tmp_path / "recording", 200), tmp_path / "out")
    process.kill()
    process.communicate(timeout=20)
    assert not (tmp_path / "out").exists()
    assert not any(path.name == "run.json" for path in tmp_path.rglob("*"))
    assert all(path.name == "recording" or path.name.startswith(".out.") for path in tmp_path.iterdir())


def test_a_reader_that_goes_away_is_no_fault() -> None:
    read, write = os.pipe()
    os.close(read)
    words = [sys.executable, "-m", "cuboid", "doctor"]
    process = subprocess.run(words, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert process.stderr == ""
