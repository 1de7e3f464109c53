"""Whatever moment a run is killed at, the results are the old ones or the new ones, whole."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from commands import command, contents, run, run_here

from cuboid.ground.formats import folder as folders
from cuboid.ground.formats.folder import ResultFolder
from cuboid.results.files import Results
from fakes import write_recording

# More with CUBOID_KILLS=100.
KILLS = int(os.environ.get("CUBOID_KILLS", "3"))

OLD = {"run.json": "old", "objects.json": "old", "tracks.csv": "old", "labelled.mp4": "old", "notes.txt": "theirs"}
NEW = {"run.json": "new", "objects.json": "new", "tracks.csv": "new", "map.ply": "new", "notes.txt": "theirs"}


def texts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


def replace_and_die(folder: Path, step: int) -> bool:
    """Replace results in a process that is killed at its so many-th step; return whether it came so far."""
    child = os.fork()
    if child == 0:
        left = [step]

        def deadly(function: Callable[..., object]) -> Callable[..., object]:
            def step_or_die(*args: object, **options: object) -> object:
                left[0] -= 1
                if left[0] < 0:
                    os.kill(os.getpid(), signal.SIGKILL)
                return function(*args, **options)

            return step_or_die

        for name in ("replace", "rename", "unlink", "write_text", "mkdir"):
            setattr(Path, name, deadly(getattr(Path, name)))
        folders.shutil.rmtree = deadly(folders.shutil.rmtree)  # type: ignore[assignment]
        with ResultFolder(folder, force=True) as written:
            for name, text in NEW.items():
                if name != "notes.txt":
                    written.file(name).write_text(text)
            written.commit()
        os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def test_killed_at_any_step_of_replacing(tmp_path: Path) -> None:
    seen = []
    for step in range(100):
        folder = tmp_path / f"out{step}"
        folder.mkdir()
        for name, text in OLD.items():
            (folder / name).write_text(text)
        if not replace_and_die(folder, step):
            break
        if "run.json" in texts(folder):  # looks whole: is whole
            assert texts(folder) in (OLD, NEW), step
        Results(folder)  # whoever opens it
        assert texts(folder) in (OLD, NEW), step
        seen.append(texts(folder) == NEW)
    assert step > 10
    assert seen == sorted(seen), "once the new results are there they stay"
    assert texts(folder) == NEW


def test_killed_at_any_moment(tmp_path: Path) -> None:
    recording, out = write_recording(tmp_path / "recording", 12), tmp_path / "out"
    assert run_here("track", recording, "--output", out).returncode == 0
    rng, before = random.Random(3), contents(recording)
    words = command("track", recording, "--output", out, "--force", frame_s=0.005)
    begun_s = time.monotonic()
    assert run(words).returncode == 0
    whole_s = time.monotonic() - begun_s
    ended = 0
    for _ in range(KILLS):
        old = contents(out)
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(rng.uniform(0.5, 1.05) * whole_s)
        process.kill()
        ended += process.wait() == 0
        Results(out)
        now = {name: digest for name, digest in contents(out).items() if not name.startswith(".")}
        results = Results(out)
        assert (results.report.complete, len(results.poses), len(results.tracks)) == (True, 12, 11)
        assert len(results.found.objects) == 1
        assert len(results.map_points().xyz) == 12
        same = {name: digest for name, digest in old.items() if not name.startswith(".")}
        if now != same:  # the new ones: times differ in run.json, and perhaps the page is not yet there
            assert {*now} - {*same} == set()
            assert {*same} - {*now} <= {"report.html"}
            assert run_here("report", out, "--force").returncode == 0
    assert ended < KILLS, "no run was killed"
    assert contents(recording) == before
    time.sleep(0.1)
    os.utime(tmp_path)
    for left in out.glob(".*.partial"):
        os.utime(left, (0, 0))
    assert run_here("track", recording, "--output", out, "--force").returncode == 0
    assert list(out.glob(".*")) == [], "what killed runs left is removed by the next"


def test_two_runs_into_one_folder_end_as_one_of_them(tmp_path: Path) -> None:
    out = tmp_path / "out"
    recordings = [write_recording(tmp_path / f"recording{n}", n) for n in (8, 14)]
    assert run_here("track", recordings[0], "--output", out).returncode == 0
    processes = [
        subprocess.Popen(
            command("track", recording, "--output", out, "--force"),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for recording in recordings
    ]
    for process in processes:
        assert "Traceback" not in process.communicate(timeout=120)[1]
    results = Results(out)
    frames = results.report.frames_used
    assert frames in (8, 14)
    assert (len(results.poses), len(results.map_points().xyz), len(results.tracks)) == (frames, frames, frames - 1)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_asked_to_end_with_force_it_replaces_or_keeps(tmp_path: Path, number: signal.Signals) -> None:
    recording, out = write_recording(tmp_path / "recording", 100), tmp_path / "out"
    assert run_here("track", recording, "--output", out, "--limit", 10).returncode == 0
    words = command("track", recording, "--output", out, "--force", frame_s=0.05)
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not list(out.glob(".*.partial/tracks.csv")):
        time.sleep(0.02)
    time.sleep(0.3)
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert "Traceback" not in said
    results = Results(out)
    assert len(results.poses) == results.report.frames_used
    # a terminal that is closed kills; the others end the run, which says that it is not complete
    assert results.report.complete == (number == signal.SIGHUP)
