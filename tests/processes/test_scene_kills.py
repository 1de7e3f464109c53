"""A scene outlives whatever becomes of the process that writes it, and the run goes on as if nothing had happened."""

from __future__ import annotations

import os
import random
import resource
import sqlite3
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from commands import refused, run, run_here

from cuboid.ground.core.errors import CuboidError
from cuboid.ground.core.threads import limit_threads
from cuboid.lab.synthetic import make_scene, render_recording
from cuboid.runs.scene import Scene
from cuboid.runs.scene.database import Writing

# More with CUBOID_KILLS=50.
KILLS = min(int(os.environ.get("CUBOID_KILLS", "2")), 50)
FRAMES = 40
RESULTS = ("objects.json", "tracks.csv", "proposals.csv", "trajectory.txt", "map.ply")


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "cuboid", *map(str, words)]


def here(words: list[str]) -> subprocess.CompletedProcess[str]:
    """Run a call in this process, which has the kernels of tracking loaded."""
    return run_here(*words[3:], tracker=None)


def track(recording: Path, out: Path, scene: Path, *words: object) -> list[str]:
    # Next to no memory: parts of the map that are out of view leave, and come back.
    return command("track", recording, "--output", out, "--scene", scene, "--threads", 1, "--memory", 1, *words)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    limit_threads(1)
    path = tmp_path_factory.mktemp("made") / "table"
    render_recording(make_scene("table", 3, frames=FRAMES), path, size=(160, 120))
    return path


@pytest.fixture(scope="module")
def whole(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The results of a run without a scene."""
    out = tmp_path_factory.mktemp("whole") / "out"
    done = here(command("track", recording, "--output", out, "--threads", 1))
    assert done.returncode == 0, done.stderr
    return results(out)


def results(out: Path) -> dict[str, bytes]:
    return {name: (out / name).read_bytes() for name in RESULTS}


def sound(scene: Path) -> None:
    """Hold a file to what SQLite and its own tables promise."""
    with sqlite3.connect(scene) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
    connection.close()


def wait_until_saved(scene: Path, process: subprocess.Popen[bytes]) -> None:
    """Wait until a commit has told of the recording, or the process has ended."""
    while process.poll() is None:
        # In its first moments the file is none yet.
        with suppress(CuboidError), Scene.open(scene) as opened:
            if opened.recordings:
                return
        time.sleep(0.01)


def test_killed_at_any_moment_a_run_goes_on_to_the_same_results(
    recording: Path, whole: dict[str, bytes], tmp_path: Path
) -> None:
    rng = random.Random(5)
    begun_s = time.monotonic()
    assert run(track(recording, tmp_path / "o", tmp_path / "s.cuboid", "--commit-every", 0.05)).returncode == 0
    whole_s = time.monotonic() - begun_s
    assert results(tmp_path / "o") == whole, "a new scene changes no result"
    resumed = 0
    for kill in range(KILLS):
        out, scene = tmp_path / f"out{kill}", tmp_path / f"{kill}.cuboid"
        words = track(recording, out, scene, "--commit-every", 0.05)
        for _ in range(rng.choice((1, 1, 2))):
            process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            if kill % 2 == 0:  # on a busy machine most of the time goes before the first commit
                wait_until_saved(scene, process)
                time.sleep(rng.uniform(0.0, 0.2) * whole_s)
            else:
                time.sleep(rng.uniform(0.35, 1.1) * whole_s)
            process.kill()
            said = process.communicate()[1].decode()
            assert "Traceback" not in said, said
            if scene.exists():
                sound(scene)
            with Scene.open(scene) as opened:
                assert all(item.label > 0 for item in opened.objects)
                runs = opened.recordings
            if runs and runs[-1].complete:
                break
            if runs:
                words = track(recording, out, scene, "--commit-every", 0.05, "--resume")
        if not runs or not runs[-1].complete:
            done = here([*words, "--force"])
            assert done.returncode == 0, done.stderr
            resumed += "--resume" in words
        assert results(out) == whole
        sound(scene)
    assert resumed > 0


def test_others_read_while_one_writes(recording: Path, tmp_path: Path) -> None:
    scene = tmp_path / "s.cuboid"
    words = track(recording, tmp_path / "a", scene, "--commit-every", 0.01)
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not scene.exists():
        time.sleep(0.01)
    seen = []
    with Scene.open(scene) as reader:
        while process.poll() is None:
            seen.append((sum(one.frames_used for one in reader.recordings), len(reader.all_objects)))
            time.sleep(0.01)
        last = sum(one.frames_used for one in reader.recordings)
    assert process.returncode == 0
    assert seen == sorted(seen)
    assert len({frames for frames, _ in seen}) > 3, "a reader sees what is committed meanwhile"
    assert last == FRAMES
    assert list(tmp_path.glob("s.cuboid?*")) == []


def test_a_second_writer_is_refused(recording: Path, tmp_path: Path) -> None:
    scene = tmp_path / "s.cuboid"
    first = Writing(scene, create=True)
    line = refused(here(track(recording, tmp_path / "out", scene)))
    assert "another program is writing this scene" in line
    assert not (tmp_path / "out").exists()
    first.close()
    assert Scene.open(scene).recordings == []


def test_a_full_disk_is_one_line_and_costs_only_what_was_not_saved(
    recording: Path, whole: dict[str, bytes], tmp_path: Path
) -> None:
    scene, out = tmp_path / "s.cuboid", tmp_path / "out"
    assert here(track(recording, tmp_path / "whole", tmp_path / "w.cuboid")).returncode == 0
    # Small: it is met by a commit, however few of these there are on a busy machine, before the results are.
    limit = (tmp_path / "w.cuboid").stat().st_size // 8

    def full() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    words = track(recording, out, scene, "--commit-every", 0.05)
    line = refused(run(words, preexec_fn=full))
    assert "the disk is full" in line
    assert not out.exists()
    sound(scene)
    with Scene.open(scene) as opened:
        saved = bool(opened.recordings)
    done = here([*words, "--resume"] if saved else words)
    assert done.returncode == 0, done.stderr
    assert results(out) == whole


def test_another_run_is_not_gone_on_with(recording: Path, tmp_path: Path) -> None:
    scene = tmp_path / "s.cuboid"
    words = track(recording, tmp_path / "out", scene)
    assert "no recording was broken off" in refused(here([*words, "--resume"]))
    process = subprocess.Popen([*words, "--commit-every", "0.01"], stderr=subprocess.DEVNULL)
    while not scene.exists() or not any(one.frames_used for one in Scene.open(scene).recordings):
        time.sleep(0.02)
    process.kill()
    process.wait()
    assert f"the run of {recording} was broken off before frame " in refused(here(words))
    assert len(Scene.open(scene).recordings) == 1
    assert "the run was begun with every = 1, not 2" in refused(here([*words, "--resume", "--every", "2"]))
    moved = tmp_path / "moved"
    moved.symlink_to(recording)
    assert here([*track(moved, tmp_path / "out", scene), "--resume"]).returncode == 0
