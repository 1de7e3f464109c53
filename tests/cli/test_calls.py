"""What the command line says to a call that is right or wrong, whatever the tracker finds."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from called import called
from cuboid import __version__
from cuboid.cli import COMMANDS, GROUPS
from cuboid.results.files import read_run
from fakes import FakeTracker, write_recording


def call(*words: str | Path) -> tuple[int, str, str]:
    """Call the command line with a quick tracker; return status, output and errors."""
    done = called(*words, tracker=FakeTracker)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return write_recording(tmp_path / "recording", 6)


def assert_mistake(result: tuple[int, str, str], *parts: str) -> None:
    status, out, err = result
    assert status == 2, err
    assert out == ""
    assert err.startswith("cuboid: error: ")
    assert err.count("\n") == 1
    for part in parts:
        assert part in err


def test_help_names_every_command_and_loads_nothing_heavy() -> None:
    script = (
        "import sys; from cuboid.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted({'numpy', 'cv2', 'numba', 'scipy', 'rich', 'av'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    *shown, loaded = done.stdout.splitlines()
    assert loaded == "[]"
    assert all(any(line.split()[: len(name.split())] == name.split() for line in shown) for name in COMMANDS)


def test_the_help_lists_the_commands_in_groups_and_comes_without_a_command_too() -> None:
    status, shown, err = call()
    assert (status, err) == (0, "")
    assert call("--help") == (0, shown, "")
    for group, commands in GROUPS.items():
        after = shown.split(f"\n{group}:\n")[1].split("\n\n")[0].splitlines()
        assert [line.strip().split("  ")[0] for line in after] == list(commands)


@pytest.mark.parametrize("words", [("info", "RECORDING"), ("info", "RECORDING", "--json"), ("track", "--help"), ()])
def test_a_reader_that_has_read_enough_is_no_fault(words: tuple[str, ...], recording: Path) -> None:
    call = [str(recording) if word == "RECORDING" else word for word in words]
    for unbuffered in ("", "1"):
        process = subprocess.Popen(
            [sys.executable, "-m", "cuboid", *call],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        )
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()  # as 'head' does, only sooner
        err = process.stderr.read()
        process.stderr.close()
        assert process.wait(timeout=60) in (0, 141), err
        assert err == b""


def test_version() -> None:
    assert call("--version") == (0, f"cuboid {__version__}\n", "")


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("trakc",), "invalid choice: 'trakc'; did you mean 'track'?"),
        (("store",), "invalid choice: 'store'; did you mean 'store compact'?"),
        (("--verison",), "unrecognized arguments: --verison; did you mean '--version'?"),
        (("scene", "lst", "f"), "invalid choice: 'lst'; did you mean 'list'?"),
        (("scene", "list", "f", "--al"), "unrecognized arguments: --al; did you mean '--all'?"),
        (("render", "r", "--show", "haet"), "invalid choice: 'haet'; did you mean 'heat'?"),
        (("track", "r", "--ouput", "o"), "unrecognized arguments: --ouput; did you mean '--output'?"),
        (("track", "r", "-o", "o", "--evry=2"), "unrecognized arguments: --evry; did you mean '--every'?"),
        (("track", "r", "-o"), "argument --output: expected one argument"),
        (("track",), "required: RECORDING, --output; for example: cuboid track RECORDING --output DIR"),
        (("track", "r", "--output", "o", "--scale", "3"), "--scale: invalid choice: 3"),
        (("track", "r", "--output", "o", "--every", "0"), "whole number of at least 1, got '0'"),
        (("track", "r", "--output", "o", "--limit", "x"), "whole number of at least 1, got 'x'"),
        (("track", "r", "--output", "o", "--intrinsics", "1,2,3"), "expected FX,FY,CX,CY in pixels"),
        (("track", "r", "--output", "o", "--intrinsics", "1,nan,3,4"), "FX, FY > 0"),
        (("track", "r", "--output", "o", "--depth-scale", "-1"), "depth units per metre"),
        (("track", "r", "--output", "o", "--set", "voxel_m"), "expected NAME=VALUE"),
        (("track", "r", "--output", "o", "--min-probability", "80"), "expected a probability from 0 to 1, got '80'"),
        (("track", "r", "--output", "o", "--out", "o"), "unrecognized arguments: --out"),
        (("track", "no-such-folder", "--output", "o"), "no-such-folder does not exist"),
    ],
)
def test_a_wrong_call_is_one_line(words: tuple[str, ...], part: str) -> None:
    assert_mistake(call(*words), part)


def test_results_and_table(recording: Path, tmp_path: Path) -> None:
    status, out, err = call("track", recording, "--output", tmp_path / "out")
    assert (status, err) == (0, "")
    assert "10.0 x 20.0 x 30.0" in out
    assert "probability" in out
    assert "0.90" in out
    assert "6 of 6 frames in" in out
    assert f"open {tmp_path / 'out' / 'report.html'} in a browser\n" in out
    assert "skipped" not in out
    assert read_run(tmp_path / "out" / "run.json").frames_used == 6


def test_options_reach_the_run(recording: Path, tmp_path: Path) -> None:
    words = ("--every", "2", "--limit", "2", "--scale", "2", "--threads", "1", "--set", "voxel_m=0.02")
    words += ("--min-probability", "0.65")
    assert call("track", recording, "--output", tmp_path / "out", *words)[0] == 0
    run = read_run(tmp_path / "out" / "run.json")
    assert (run.frames_read, run.threads, run.complete, run.poses) == (2, 1, True, "given")
    assert {name: run.config[name] for name in ("every", "limit", "scale")} == {
        "every": 2,
        "limit": 2,
        "scale": 2,
    }
    assert run.config["tracker"]["voxel_m"] == 0.02
    assert run.config["tracker"]["min_probability"] == 0.65


def test_a_setting_that_does_not_exist_or_is_out_of_range_is_refused(recording: Path, tmp_path: Path) -> None:
    words = ("track", recording, "--output", tmp_path / "out", "--set")
    assert_mistake(call(*words, "speed=11"), "unknown setting 'speed'")
    assert_mistake(call(*words, "voxel_m=7"), "voxel_m must lie in")
    twice = "min_probability=0.7", "--min-probability", "0.8"
    assert_mistake(call(*words, *twice), "--min-probability and --set min_probability are one setting")
    assert not (tmp_path / "out").exists()


def test_skipped_frames_are_in_the_summary_with_their_reasons(recording: Path, tmp_path: Path) -> None:
    (recording / "color" / "000002.png").write_bytes(b"")
    (recording / "depth" / "000004.png").unlink()
    status, out, _ = call("track", recording, "--output", tmp_path / "out")
    assert status == 0
    assert "2 of 6 frames skipped:" in out
    assert "frame 2: color image color/000002.png is empty" in out
    assert "frame 4: color without depth" in out
    assert [frame for frame, _ in read_run(tmp_path / "out" / "run.json").skipped] == [2, 4]


def test_more_than_half_bad_frames_is_a_mistake(recording: Path, tmp_path: Path) -> None:
    for i in range(1, 5):
        (recording / "color" / f"{i:06d}.png").write_bytes(b"\x89PNG")
    assert_mistake(
        call("track", recording, "--output", tmp_path / "out"), "more than half of the 6 frames", "000001.png"
    )
    assert not (tmp_path / "out").exists()


def test_an_output_folder_that_exists_needs_force(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("x")
    assert_mistake(call("track", recording, "--output", tmp_path / "out"), "exists", "--force")
    assert call("track", recording, "--output", tmp_path / "out", "--force")[0] == 0
    assert (tmp_path / "out" / "mine.txt").read_text() == "x"
    assert (tmp_path / "out" / "run.json").exists()


def test_an_output_that_cannot_be_written_is_a_mistake(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert_mistake(call("track", recording, "--output", tmp_path / "file" / "out"), "cannot be written")


def test_poses_are_needed(tmp_path: Path) -> None:
    bare = write_recording(tmp_path / "bare", 3, poses=False)
    assert_mistake(call("track", bare, "--output", tmp_path / "out", "--poses", "given"), "no camera poses")
    assert_mistake(call("track", bare, "--output", tmp_path / "out", "--bridge"), "--bridge", "given poses")
    assert_mistake(call("track", bare, "--output", tmp_path / "out"), "enough depth and texture")


def test_a_fault_of_the_program_is_a_traceback(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FakeTracker, "update", lambda self, frame, anchor: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        call("track", recording, "--output", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_bench_prints_stages_and_json(tmp_path: Path) -> None:
    long = write_recording(tmp_path / "long", 40)
    status, out, _ = call("bench", long)
    assert status == 0
    assert "1 thread," in out
    assert all(stage in out for stage in ("frame", "decode", "matching", "cost over time", "frames/s", "MB"))
    assert re.search(
        r"a frame: median [\d.]+ ms = [\d.]+, 99th percentile [\d.]+ ms = [\d.]+, worst [\d.]+ ms = [\d.]+ times", out
    )
    assert "map: 40 points, 50 bytes each" in out
    status, out, _ = call("bench", long, "--json", "--scale", "2")
    measured = json.loads(out)
    assert measured["threads"] == 1
    assert measured["milliseconds"]["matching"] == {"median": 2.0, "p95": 2.0}
    tail = measured["tail"]
    assert tail["decode_ms"] <= tail["median_ms"] <= tail["p99_ms"] <= tail["worst_ms"]
    assert tail["p99_decodes"] == pytest.approx(tail["p99_ms"] / tail["decode_ms"], rel=0.02)
    assert measured["map"] == {"points": 40, "bytes": 2000, "bytes_per_point": 50.0}
    assert set(measured["over_time"]) == {"early_ms", "late_ms", "ratio"}
    assert measured["frames"]["used"] == 40
    assert measured["peak_memory_mb"] > 10
    assert list(tmp_path.iterdir()) == [long]


def test_bench_says_which_frames_it_could_not_use(recording: Path) -> None:
    (recording / "color" / "000002.png").write_bytes(b"")
    assert "1 of 6 frames skipped:" in call("bench", recording)[1]
