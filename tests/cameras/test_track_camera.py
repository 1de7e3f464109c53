"""`cuboid track --camera`, as a process that a user ends with Ctrl-C, and its mistakes."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from played import PlayedDriver

from cuboid.cli import main
from cuboid.ground.core.errors import InputError
from cuboid.inputs.cameras.live import LiveCamera
from cuboid.inputs.readers import open_recording
from cuboid.results.files import read_run
from slowed import SAID, slowed, started

PLAYED = """
from cuboid.inputs.cameras import CAMERAS
from played import PlayedDriver
CAMERAS.register("toy")(lambda options: PlayedDriver({frames}, paced=False, every_s=0.01, then={then}))
"""


@pytest.mark.parametrize("silent", [False, True], ids=["while frames come", "while none comes"])
def test_ctrl_c_ends_with_a_whole_result(tmp_path: Path, silent: bool) -> None:
    then = "lambda: __import__('time').sleep(0.05)" if silent else "None"
    before = PLAYED.format(then=then, frames=6 if silent else 10**9)
    words = ["track", "--camera", "toy", "--output", tmp_path / "out", "--record", tmp_path / "kept"]
    process = started(slowed(SAID, *words, before=before, folder=Path(__file__).resolve().parent), 5)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    run = read_run(tmp_path / "out" / "run.json")
    assert run.complete
    assert 6 <= run.frames_used < 1000
    assert f"{run.frames_used} of {run.frames_used} frames" in out
    assert len(open_recording(tmp_path / "kept")) >= run.frames_used
    assert run.recording == str(tmp_path / "kept")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept", "out"]


@pytest.mark.parametrize(
    ("command", "opens"),
    [
        (["track", "--camera", "oak", "--output", "never"], "cuboid.inputs.cameras.live.LiveCamera.__iter__"),
        (["ros2"], "cuboid.services.ros2.opening.open_node"),
    ],
)
def test_the_kernels_are_loaded_before_frames_are_taken(
    command: list[str], opens: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    done: list[str] = []

    def take(*_: object) -> None:
        done.append("frames")
        raise InputError("no frames")

    monkeypatch.setattr("cuboid.runs.pipeline.ahead.compile_all", lambda progress: done.append("kernels"))
    monkeypatch.setattr("cuboid.inputs.cameras.open_camera", lambda *_, **__: LiveCamera(PlayedDriver(3)))
    monkeypatch.setattr(opens, take)
    assert main(command) == 2
    assert done == ["kernels", "frames"]
    assert "no frames" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ((), "name a RECORDING, or a live camera with --camera"),
        (("r", "--camera", "oak"), "a run has one source: either the recording r or --camera oak"),
        (("r", "--record", "k"), "--record stores the frames of --camera"),
        (
            ("--camera", "oak", "--depth-scale", "1000"),
            "--depth-scale is for recordings only; a camera provides this value",
        ),
        (("--camera", "webcam"), "unknown camera 'webcam'; there are: oak, orbbec, realsense, record3d, ros2"),
    ],
)
def test_a_wrong_call_is_one_line(words: tuple[str, ...], part: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["track", *words, "--output", "never"]) == 2
    err = capfd.readouterr().err
    assert part in err
    assert err.count("\n") == 1
    assert not Path("never").exists()
